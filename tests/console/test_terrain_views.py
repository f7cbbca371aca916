"""An operator would not see the terrain, how high a vehicle is above it, or where its route leads."""

from __future__ import annotations

import re
import time

import numpy as np
import pytest
from helpers.hills import elevation_of, hill, terrain_table
from playwright.sync_api import Page, expect

from gcs.config import load, parse, read_text
from gcs.console.engine.captures import elevation_map

HILLS = elevation_of(hill(1200.0, 1200.0, 40.0, 300.0, 50.0), 2000.0)
"""Homes of the vehicles are at 70 m, on level ground of 50 m."""
PIXELS = """canvas => {
    const { data } = canvas.getContext('2d').getImageData(300, 200, 200, 200);
    return new Set(new Uint32Array(data.buffer)).size;
}"""


def over_hills():
    return parse(read_text("prescribed")[0] + terrain_table(HILLS), "hills")


def colours_of_map(page: Page) -> int:
    found: int = page.locator("#map canvas").evaluate(PIXELS)
    return found


def until(condition) -> None:
    until_s = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.1)


@pytest.mark.real_time
def test_heights_above_the_ground_are_in_table_details_and_profile(fly, launch, page) -> None:
    with fly(config=over_hills()) as flight:
        launch(flight)
        page.goto(flight.url)
        cells = page.locator('#vehicles tr[data-id="1"] td')
        heads = page.locator("#vehicles thead th").all_inner_texts()
        expect(cells.nth(heads.index("AGL m"))).to_have_text(re.compile(r"^\d+$"))
        alt, agl = (int(cells.nth(heads.index(name)).inner_text()) for name in ("alt m", "AGL m"))
        assert abs(agl - alt - 20) <= 3
        page.keyboard.press("1")
        expect(page.locator("#detail dl")).to_contain_text("m above ground")
        page.keyboard.press("h")
        expect(page.locator("#profile .values")).to_contain_text(
            re.compile(r"now.*m above ground · ground \d+ m")
        )
        expect(page.locator("#profile .legend")).to_contain_text("flight band, 50 to 120 m above ground")
        drawn = page.locator("#profile canvas")
        box = drawn.bounding_box()
        assert box["height"] > 150.0
        drawn.hover(position={"x": box["width"] / 2.0, "y": 50.0})
        expect(page.locator("#profile .values")).to_contain_text(re.compile(r"behind|ahead|now"))
        page.keyboard.press("Escape")
        expect(page.locator("#profile .empty")).to_be_visible()
        page.keyboard.press("h")
        expect(page.locator("#targets")).to_be_visible()


@pytest.mark.real_time
def test_hill_shading_is_drawn_unless_it_is_switched_off(fly, page) -> None:
    with fly(config=over_hills()) as flight:
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        until(lambda: colours_of_map(page) > 60)
        page.keyboard.press("l")
        page.get_by_label("Terrain: hill shading, contours").uncheck()
        until(lambda: colours_of_map(page) < 30)


@pytest.mark.real_time
def test_over_flat_ground_the_profile_has_the_layer_and_heights_above_home(fly, launch, page) -> None:
    with fly() as flight:
        launch(flight)
        page.goto(flight.url)
        cells = page.locator('#vehicles tr[data-id="1"] td')
        heads = page.locator("#vehicles thead th").all_inner_texts()
        expect(cells.nth(heads.index("alt m"))).to_have_text(re.compile(r"^\d+$"))
        assert cells.nth(heads.index("AGL m")).inner_text() == "–"
        page.keyboard.press("1")
        page.keyboard.press("h")
        expect(page.locator("#profile h2")).to_contain_text("height above home, m; flat")
        expect(page.locator("#profile .values")).to_contain_text("m above home")
        expect(page.locator("#profile .legend")).not_to_contain_text("flight band")


def test_the_ground_that_a_page_gets_is_bounded_and_true() -> None:
    fine = elevation_of(hill(1200.0, 1200.0, 40.0, 300.0, 70.0), 2000.0, spacing_m=5.0)
    config = parse(read_text("prescribed")[0] + terrain_table(fine), "hills")
    drawn = elevation_map(config)
    assert drawn is not None
    assert drawn.shape[0] * drawn.shape[1] <= 100_000
    coarse = fine.coarser(10_000)
    assert coarse.heights_msl_m.size <= 10_000
    places_m = np.random.default_rng(1).uniform(0.0, 2000.0, (200, 2))
    assert np.abs(coarse.heights_at(places_m) - fine.heights_at(places_m)).max() < 1.0
    assert fine.coarser(10**9) is fine
    assert elevation_map(load("prescribed")) is None
