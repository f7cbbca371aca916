"""An operator could not close an area at some heights only, or would close it at others than he means."""

from __future__ import annotations

import time

import pytest
from playwright.sync_api import Page, expect

from gcs.model import Order, VerticalLimits

MISTAKES = [
    ({"Ceiling, m": "60"}, "Choose what the heights are above: ground, home or mean sea level."),
    ({"Floor, m": "300", "Ceiling, m": "100"}, "The ceiling, 100 m, is not above the floor, 300 m."),
    ({"Floor, m": "NaN"}, 'Floor: expected metres from -100000 to 100000, not "NaN".'),
    ({"Ceiling, m": "1e300"}, 'Ceiling: expected metres from -100000 to 100000, not "1e300".'),
    ({"Floor, m": "<b>low</b>"}, 'Floor: expected metres from -100000 to 100000, not "<b>low</b>".'),
    ({"Ceiling, m": "-20", "Heights above": "ground"}, "The ceiling, -20 m, is not above the ground."),
    ({"Centre east, m": ""}, "Centre east: expected metres from -10000000 to 10000000."),
]


def fill(page: Page, fields: dict[str, str]) -> None:
    for label, text in fields.items():
        field = page.get_by_label(label, exact=True)
        if label == "Heights above":
            field.select_option(text)
        else:
            field.fill(text)


def closed(flight) -> dict[str, VerticalLimits]:
    """Return the heights of the closed zones, when the last order has been carried out."""
    flight.events.await_ticks(4)
    return {name: zone.limits for name, zone in flight.service.engine.state.airspace.zones.items()}


def test_an_area_is_closed_at_the_heights_that_were_typed(fly, launch, page) -> None:
    with fly() as flight:
        launch(flight)
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        page.keyboard.press("n")
        dialog = page.get_by_role("dialog")
        for fields, said in MISTAKES:
            fill(page, {"Floor, m": "", "Ceiling, m": "", "Heights above": ""} | fields)
            page.get_by_role("button", name="Close this area").click()
            expect(dialog.get_by_role("alert")).to_have_text(said)
        assert closed(flight) == {}
        assert not [event for event in flight.events.events if isinstance(event, Order)]

        fill(page, {"Name": "fire", "Floor, m": "40", "Ceiling, m": "300.5", "Heights above": "home"})
        fill(page, {"Centre east, m": "500", "Centre north, m": "300", "Radius, m": "400"})
        page.get_by_role("button", name="Close this area").click()
        result = page.locator("#commands .result")
        expect(result).to_contain_text("fire closed (40 to 300.5 m above home)")
        assert closed(flight) == {"fire": VerticalLimits(40.0, 300.5, "home")}
        page.locator("#tab-targets").click()
        expect(page.locator("#targets")).to_contain_text("40 to 300.5 m above home")

        page.get_by_role("button", name="Edit fire").click()
        page.get_by_role("button", name="Heights").click()
        expect(page.get_by_label("Floor, m", exact=True)).to_have_value("40")
        fill(page, {"Floor, m": "", "Heights above": "msl"})
        page.get_by_role("button", name="Change this area").click()
        expect(result).to_contain_text("fire closed (up to 300.5 m MSL)")
        expect(page.locator("#targets")).to_contain_text("up to 300.5 m MSL")
        page.get_by_role("button", name="Edit fire").click()
        page.get_by_role("button", name="Send").click()
        time.sleep(0.3)
        assert closed(flight) == {"fire": VerticalLimits(None, 300.5, "msl")}

        page.keyboard.press("1")
        page.keyboard.press("h")
        expect(page.locator("#profile .legend")).to_contain_text("no-fly zones")
        flight.request("/api/orders", {"action": "no-fly-zone", "no_fly_zone": {"name": "fire"}})
        expect(page.locator("#profile .legend")).not_to_contain_text("no-fly zones")


def test_what_was_typed_stays_while_the_area_is_drawn(fly, page) -> None:
    with fly() as flight:
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        page.keyboard.press("n")
        fill(page, {"Name": "fire", "Ceiling, m": "60", "Heights above": "ground"})
        page.get_by_role("button", name="Draw a circle").click()
        box = page.locator("#map canvas").bounding_box()
        x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 30.0, y, steps=3)
        page.mouse.up()
        page.get_by_role("button", name="Close this area").click()
        expect(page.locator("#commands .result")).to_contain_text("fire closed (up to 60 m above ground)")


@pytest.mark.parametrize(
    ("heights", "said"),
    [
        ({"floor_m": 300, "ceiling_m": 100, "reference": "msl"}, "100 m is not above floor_m, 300 m"),
        ({"ceiling_m": 1e300, "reference": "msl"}, "ceiling_m: expected metres, not 1e+300"),
        ({"ceiling_m": "high", "reference": "msl"}, "ceiling_m"),
        ({"ceiling_m": 60}, "reference: is missing"),
        ({"ceiling_m": 20, "reference": "msl"}, ""),
    ],
)
def test_heights_of_a_program_are_checked_as_those_of_the_page(fly, heights, said) -> None:
    """The ground is 70 m above sea level: the last one is refused by the engine."""
    zone = {"name": "fire", "circle": [700, 500, 60]} | heights
    with fly() as flight:
        code, body, _ = flight.request("/api/orders?wait_s=5", {"action": "no-fly-zone", "no_fly_zone": zone})
        if said:
            assert code == 422
            assert said in body.decode()
        else:
            assert b"it ends below the ground" in body
        assert closed(flight) == {}
