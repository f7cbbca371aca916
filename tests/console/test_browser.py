"""An operator with a real browser would not see the swarm, or could not act at once."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip

pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is not installed: apt-get install chromium"
)


@pytest.fixture
def page() -> Iterator[Page]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        opened = browser.new_page(viewport={"width": 1400, "height": 900})
        opened.set_default_timeout(5000.0)
        yield opened
        browser.close()


def test_an_operator_watches_holds_and_gets_the_connection_back(fly, launch, page):
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("dialog", lambda dialog: errors.append(dialog.message))
    with fly() as flight:
        vehicles = launch(flight)
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        row = page.locator('tr[data-id="1"]')
        expect(row.locator(".c-armed")).to_have_text("armed")

        hostile = "<img src=x onerror=alert(1)>"
        vehicles.say(2, hostile)
        expect(page.locator("#log .panel").first).to_contain_text(hostile)
        expect(page.locator("#alarms .bar.alarm")).to_contain_text(hostile)
        assert page.locator("img").count() == 0
        page.keyboard.press("k")
        expect(page.locator("#alarms .bar")).not_to_contain_text(hostile)

        page.keyboard.press("1")
        expect(row).to_have_attribute("aria-selected", "true")
        began_s = time.monotonic()
        page.keyboard.press("Space")
        expect(row.locator(".c-authority")).to_have_text("held")
        assert time.monotonic() - began_s < 1.0
        expect(page.locator("#commands .result")).to_have_text("hold: 1 done: LOITER, armed")

        page.keyboard.press("a")
        expect(page.locator("dialog")).to_contain_text("Propellers may turn")
        page.keyboard.press("Escape")

        flight.restart_console()
        expect(page.locator("#head")).to_contain_text("what you see is old")
        expect(page.locator("#head")).not_to_contain_text("what you see is old")
        expect(row.locator(".c-authority")).to_have_text("held")
    assert errors == []
