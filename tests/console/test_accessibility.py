"""An operator with weak sight, colour blindness or without a mouse could not use the console."""

from __future__ import annotations

from playwright.sync_api import expect

from gcs.console.web.console_access import Access

OPERATE = "operate-0123456789"


def test_the_console_has_no_violation_that_axe_finds(fly, launch, page, problems):
    with fly() as flight:
        vehicles = launch(flight)
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        vehicles.say(2, "an alarm")
        expect(page.locator("#alarms .bar.alarm")).to_contain_text("an alarm")
        page.keyboard.press("1")
        page.keyboard.press("l")
        expect(page.locator("#detail")).to_contain_text("authority")
        assert problems(page) == []
        page.locator('#alarms [data-name="more"]').click()
        assert problems(page) == []
        dark = page.locator("html").get_attribute("data-theme") == "dark"
        page.get_by_role("button", name="Theme").click()
        expect(page.locator("html")).to_have_attribute("data-theme", "light" if dark else "dark")
        assert problems(page, "color-contrast") == []
        page.goto(flight.url + "/preflight.html")
        assert problems(page) == []
    with fly(Access(operate_token=OPERATE)) as flight:
        page.goto(flight.url + "/login")
        assert problems(page) == []
