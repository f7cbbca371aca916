"""A researcher would not see the more accurate estimates, or would see them where no object was."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import pytest
from helpers.staging import at, track
from playwright.sync_api import Page, expect

from gcs.config import load, parse, read_text
from gcs.config.key_overrides import override_keys
from gcs.console.engine.captures import capture
from gcs.console.engine.replay_run import feed_of
from gcs.console.remote.messages import NewsEncoder, decode_news
from gcs.console.view.late_tracks import LateTracks
from gcs.console.view.news import NewsRequest
from gcs.console.view.page_records import RunInfo
from gcs.console.view.page_state import World
from gcs.console.view.run_marks import History
from gcs.model import LaggedPicture
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import parse_scenario

PIXELS = """canvas => {
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    return Array.from(new Uint32Array(data.buffer)).reduce((sum, one) => (sum * 31 + one) % 4294967291, 7);
}"""


def text_with_lag(scans: int) -> str:
    return override_keys(read_text("prescribed")[0], [f"tracking.lag_scans={scans}"], "lag")


def late(second: float, *tracks, kind="targets") -> LaggedPicture:
    return LaggedPicture(at(second + 3.0), at(second), kind, tracks)


def test_a_path_has_a_gap_where_its_track_was_not_estimated() -> None:
    paths = LateTracks()
    one, other = (0, 1), (4, 0)
    assert paths.add([late(0.0, track(one, (1.04, 2.0)))]) == {"T0.1": [(1.0, 2.0)]}
    assert paths.add([late(1.0, track(other, (9.0, 9.0)))]) == {"T4.0": [(9.0, 9.0)]}
    new = paths.add([late(2.0, track(one, (3.0, 2.0))), late(3.0, track(one, (4.0, 2.0)))])
    assert new == {"T0.1": [None, (3.0, 2.0), (4.0, 2.0)]}
    assert paths.add([late(4.0, track(one, (7.0, 7.0)), kind="agents")]) == {"A0.1": [(7.0, 7.0)]}
    assert paths.paths()["T0.1"] == [(1.0, 2.0), None, (3.0, 2.0), (4.0, 2.0)]


def test_paths_are_bounded_and_the_oldest_are_forgotten() -> None:
    paths = LateTracks()
    for second in range(1000):
        paths.add([late(second, track((0, 0), (second, 0.0)), track((second, 1), (0.0, second)))])
    kept = paths.paths()
    assert len(kept) <= 200
    assert len(kept["T0.0"]) <= 400
    assert kept["T0.0"][-1] == (999.0, 0.0)
    assert "T999.1" in kept
    assert "T10.1" not in kept


def test_a_console_over_zenoh_has_the_late_estimates_and_a_later_one_too() -> None:
    run = VirtualRun(
        parse_scenario(text_with_lag(3), "lag"),
        1,
        lambda event: feed.event(event),
        lambda t_ns, effect: feed.effect(t_ns, effect),
    )
    displayed = SimpleNamespace(config=run.engine.config, engine=run.engine, sinks=[])
    feed = feed_of(displayed, RunInfo(), lambda t_ns: capture(run.engine, t_ns), None)

    def shown(worlds: list[World]) -> list[dict]:
        return [json.loads(world.snapshot())["late"] for world in worlds]

    encoder, request, early = NewsEncoder(), NewsRequest(), None
    for second in range(2, 22, 2):
        run.run(float(second))
        news = decode_news(encoder.encode(feed.pull(request), 0), None)
        early = early or World(news.mission, History(is_recorded=False))
        early.update(news)
        request = request.after(news)
    news = feed.pull(NewsRequest())
    assert news.mission.lag_scans == 3
    late_one = World(news.mission, History(is_recorded=False))
    late_one.update(news)
    first, second = shown([early, late_one])
    assert first == second
    (vehicle,) = [state for state in run.engine.stages.fleet.states() if state.system_id == 1]
    ends = [path[-1] for name, path in first.items() if name.startswith("A")]
    away_m = min(math.dist(end, (vehicle.east_m, vehicle.north_m)) for end in ends)
    assert 20.0 < away_m < 80.0, "at 15 m/s, some three scans behind"


def picture_of(page: Page) -> int:
    found: int = page.locator("#map canvas").evaluate(PIXELS)
    return found


@pytest.mark.real_time
def test_late_estimates_are_a_layer_of_the_map_if_there_are_some(fly, page) -> None:
    config = parse(text_with_lag(3), "lag")
    name = "Estimates 3 scans late (dotted)"
    with fly(config=config) as flight:
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        page.keyboard.press("l")
        layer = page.get_by_label(name)
        expect(layer).to_be_checked()
        empty = picture_of(page)
        for second in range(5):
            flight.feed.effect(at(second), late(second, track((0, 1), (300.0 + 200.0 * second, 1000.0))))
        page.wait_for_timeout(1500)
        drawn = picture_of(page)
        assert drawn != empty
        layer.uncheck()
        page.wait_for_timeout(300)
        assert picture_of(page) == empty
        page.reload()
        page.keyboard.press("l")
        expect(page.get_by_label(name)).not_to_be_checked()
        page.get_by_label(name).check()
        page.wait_for_timeout(1500)
        assert picture_of(page) == drawn, "what was before this page is there, too"
    with fly(config=load("prescribed")) as flight:
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        page.keyboard.press("l")
        expect(page.get_by_label("Trails")).to_be_visible()
        expect(page.locator("#map .layers label", has_text="late")).to_be_hidden()
