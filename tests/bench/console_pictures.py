"""Pictures of the console for the documentation, from a demo that is flown for them and from its replay.

``python tests/bench/console_pictures.py docs/images`` takes two minutes. Look at each picture before it is
committed: what a demo shows at some second is not always the same.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench_console import FLAGS, free_port
from playwright.sync_api import Browser, Page, expect, sync_playwright

from gcs.config import read_text
from gcs.config.key_overrides import override_keys

WAIT_MS = 120_000.0
SIZE = {"width": 1400, "height": 820}
PLAN_S, DETAIL_S, END_S = 20.0, 66.0, 110.0
"""Elapsed time from which each picture may be taken, and after which the demo is ended."""
SEEK_S = 82.0
TERRAIN_S = 75.0


@contextmanager
def served(*command: str) -> Iterator[str]:
    """Run a command with a console; yield the console's address."""
    address = f"127.0.0.1:{free_port()}"
    run = subprocess.Popen([sys.executable, "-P", "-m", "gcs", *command, "--console", address])
    try:
        yield f"http://{address}/"
    finally:
        run.terminate()
        run.wait(30.0)


@contextmanager
def opened(browser: Browser, url: str, theme: str) -> Iterator[Page]:
    """Open the console; yield its page when the vehicles are there."""
    page = browser.new_page(viewport=SIZE, color_scheme=theme)
    page.set_default_timeout(WAIT_MS)
    until_s = time.monotonic() + WAIT_MS / 1e3
    while True:
        try:
            page.goto(url)
            break
        except Exception:
            if time.monotonic() > until_s:
                raise
            time.sleep(0.5)
    expect(page.locator("#vehicles tbody tr")).to_have_count(4, timeout=WAIT_MS)
    yield page
    page.close()


def elapsed_s(page: Page) -> float:
    """Return the time since the start of the run that the page shows."""
    found = re.search(r"elapsed\s*(\d+):(\d+)", page.locator("#head").inner_text())
    return 0.0 if found is None else 60.0 * int(found[1]) + int(found[2])


def fly(browser: Browser, folder: Path, out: Path) -> None:
    """Fly a demo whose plans are confirmed on its console; take the pictures of a live run."""
    mission = out / "prescribed.toml"
    text = read_text("prescribed")[0].replace('retask = "auto"', 'retask = "confirm"')
    mission.write_text(override_keys(text, ["tracking.lag_scans=3"], "prescribed"))
    command = ("demo", str(mission), "--seed", "1", "--headless", "--out", str(out / "run"))
    taken = set[str]()
    with served(*command) as url, opened(browser, url, "dark") as page:
        while (now_s := elapsed_s(page)) < END_S:
            button = page.locator("#plan button.main")
            if button.is_visible() and button.is_enabled():
                if now_s >= PLAN_S and "plan" not in taken:
                    page.screenshot(path=folder / "console-plan.png")
                    taken.add("plan")
                button.click()
            if now_s >= DETAIL_S and "detail" not in taken:
                page.keyboard.press("1")
                expect(page.locator("#detail dl")).to_contain_text("authority")
                page.mouse.move(0, 0)
                expect(page.locator("#detail dl")).not_to_contain_text("– frames/s")
                page.screenshot(path=folder / "console.png")
                taken.add("detail")
            time.sleep(0.3)


def replay(browser: Browser, folder: Path, out: Path) -> None:
    """Take the picture of a replay with its charts, and that of late estimates."""
    command = ("replay", str(out / "run"), "--headless", "--speed", "1")
    with served(*command) as url, opened(browser, url, "light") as page:
        page.keyboard.press("g")
        expect(page.locator("#charts figure").first).to_be_visible()
        slider = page.locator("#replay input")
        expect(slider).not_to_have_attribute("max", "1")
        slider.evaluate(
            "(one, at) => { one.value = at; one.dispatchEvent(new Event('change')); }", str(SEEK_S)
        )
        page.wait_for_function("document.querySelector('#replay .at').textContent.startsWith('1:2')")
        time.sleep(4.0)
        page.screenshot(path=folder / "console-replay.png")
        page.keyboard.press("p")
        for key in ("1", "z", *4 * "-", "Escape"):
            page.keyboard.press(key)
        time.sleep(1.0)
        page.locator("#map").screenshot(path=folder / "console-late.png")


def terrain(browser: Browser, folder: Path, recording: Path) -> None:
    """Take the picture of a flight over terrain, with the height profile of a vehicle."""
    command = ("replay", str(recording), "--headless", "--speed", "8")
    with served(*command) as url, opened(browser, url, "light") as page:
        while elapsed_s(page) < TERRAIN_S:
            time.sleep(0.1)
        page.keyboard.press("p")
        page.keyboard.press("4")
        page.keyboard.press("h")
        expect(page.locator("#profile .values")).to_contain_text("above ground")
        time.sleep(1.0)
        page.screenshot(path=folder / "terrain.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--terrain", type=Path, help="recording of four vehicles over terrain: its picture only"
    )
    arguments = parser.parse_args()
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as temporary:
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        if arguments.terrain:
            terrain(chromium, arguments.folder, arguments.terrain)
        else:
            fly(chromium, arguments.folder, Path(temporary))
            replay(chromium, arguments.folder, Path(temporary))
        chromium.close()
