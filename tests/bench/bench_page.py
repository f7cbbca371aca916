"""How soon the console answers an operator, in a real Chromium that draws in software.

- ``--first-picture 20``: from the start of the navigation to the frame with the first picture of the map with
  all vehicles, so many times with an empty cache and with a full one, for 4 and for 50 vehicles.
- ``--hold 20``: from the key to the confirmation by the vehicle, of `gcs demo`.
"""

from __future__ import annotations

import argparse
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench_console import FLAGS, free_port
from playwright.sync_api import Browser, BrowserContext, expect, sync_playwright

PICTURE = """
    window.marks = {};
    let seen;
    window.drawn = new Promise((resolve) => { seen = resolve; });
    const mark = (name) => { marks[name] ??= performance.now(); };
    window.WebSocket = class extends WebSocket {
      constructor(url) {
        super(url);
        mark("modules");
        this.addEventListener("open", () => mark("connected"));
        this.addEventListener("message", () => mark("data"));
      }
    };
    addEventListener("DOMContentLoaded", () => new MutationObserver(() => {
      if (document.querySelectorAll("#vehicles tbody tr").length < COUNT) return;
      mark("vehicles");
      requestAnimationFrame(() => requestAnimationFrame(() => { mark("picture"); seen(); }));
    }).observe(document.body, { subtree: true, childList: true }));
"""
CONFIRMATION = """
    window.waits = [];
    let pressed = null;
    addEventListener("keydown", (event) => { if (event.key === " ") pressed = event.timeStamp; }, true);
    const result = document.querySelector("#commands .result");
    new MutationObserver(() => {
      if (pressed === null || !result.textContent.startsWith("hold: 1 done")) return;
      waits.push(performance.now() - pressed);
      pressed = null;
    }).observe(result, { characterData: true, childList: true, subtree: true });
"""


@contextmanager
def demo(scenario: str, *options: str) -> Iterator[str]:
    """Fly a demo; yield the address of its console after the first plan."""
    address, folder = f"127.0.0.1:{free_port()}", Path(tempfile.mkdtemp())
    command = [
        sys.executable,
        "-P",
        "-m",
        "gcs",
        "demo",
        scenario,
        "--headless",
        "--console",
        address,
        *options,
    ]
    log = folder / "log"
    with log.open("w") as out, subprocess.Popen([*command, "--out", str(folder / "run")], stdout=out) as run:
        until_s = time.monotonic() + 200.0
        while "plan: first plan" not in log.read_text() and time.monotonic() < until_s:
            time.sleep(0.5)
        try:
            yield f"http://{address}/"
        finally:
            run.terminate()
    shutil.rmtree(folder)


def picture_ms(context: BrowserContext, url: str) -> dict[str, float]:
    """Return when each step of the first picture was done."""
    page = context.new_page()
    page.goto(url, wait_until="commit")
    marks: dict[str, float] = page.evaluate(
        "drawn.then(() => ({ html: performance.getEntriesByType('navigation')[0].responseEnd, ...marks }))"
    )
    page.close()
    return marks


def first_picture(browser: Browser, runs: int) -> None:
    for scenario, count, options in (("prescribed", 4, ()), ("swarm-50", 50, ("--pack", "25"))):
        script = PICTURE.replace("COUNT", str(count))
        with demo(scenario, *options) as url:
            kept = browser.new_context(viewport={"width": 1400, "height": 900})
            kept.add_init_script(script)
            picture_ms(kept, url)
            found: dict[str, list[dict[str, float]]] = {"empty": [], "full": []}
            for _ in range(runs):
                fresh = browser.new_context(viewport={"width": 1400, "height": 900})
                fresh.add_init_script(script)
                found["empty"].append(picture_ms(fresh, url))
                fresh.close()
                found["full"].append(picture_ms(kept, url))
            kept.close()
        for cache, times in found.items():
            last = [one["picture"] for one in times]
            steps = {name: statistics.median(one[name] for one in times) for name in times[0]}
            print(
                f"{count} vehicles, {cache} cache: first picture {statistics.median(last):.0f} ms (median), "
                f"{max(last):.0f} ms at most; " + ", ".join(f"{name} {ms:.0f}" for name, ms in steps.items())
            )


def hold(browser: Browser, runs: int) -> None:
    with demo("prescribed") as url:
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.goto(url)
        authority = page.locator('tr[data-id="1"] .c-authority')
        expect(authority).to_have_text("ours")
        page.keyboard.press("1")
        expect(page.locator('tr[data-id="1"]')).to_have_attribute("aria-selected", "true")
        page.evaluate(CONFIRMATION)
        for _ in range(runs):
            page.keyboard.press("Space")
            expect(page.locator("#commands .result")).to_contain_text("hold: 1 done")
            page.keyboard.press("r")
            expect(page.locator("#commands .result")).to_contain_text(re.compile("resume: 1 done"))
            expect(authority).to_have_text("ours")
        waits_ms: list[float] = page.evaluate("waits")
    print(
        f"hold confirmed after {statistics.median(waits_ms):.0f} ms (median), {max(waits_ms):.0f} ms at most"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first-picture", type=int, default=0, metavar="RUNS")
    parser.add_argument("--hold", type=int, default=0, metavar="RUNS")
    arguments = parser.parse_args()
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        if arguments.first_picture:
            first_picture(chromium, arguments.first_picture)
        if arguments.hold:
            hold(chromium, arguments.hold)
        chromium.close()
