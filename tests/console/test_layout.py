"""At some size of the window an operator would not see the vehicles, could not confirm, or would trust an old
picture."""

from __future__ import annotations

import json
from collections import deque
from dataclasses import dataclass
from typing import Any

import pytest
from playwright.sync_api import Page, WebSocketRoute, expect

from gcs.config import load
from gcs.console.engine.captures import mission_info
from gcs.console.view.page_records import RunInfo
from gcs.console.view.page_state import World
from gcs.console.view.run_marks import History
from gcs.model import NS_PER_S

SIZES = [(1600, 900), (1400, 1000), (1024, 768), (400, 850)]
LONG = "radar-" + "x" * 294
PROPOSAL = {
    "plan_id": 7,
    "reason": "agent 2 lost; " + "target T0.4 moved 93 m; " * 8,
    "t_ns": 5_000_000_000,
    "shown_t_ns": 2_000_000_000,
    "routes": [
        {
            "vehicle": number,
            "target": [0, number],
            "points_m": [[100.0, 100.0], [700.0, 300.0]],
            "length_m": 900.0,
            "wait_m": None,
        }
        for number in range(1, 5)
    ],
    "figures": [
        {
            "vehicle": number,
            "length_m": 900.0,
            "shown_length_m": 800.0,
            "arrival_s": 60.0,
            "separation_m": None,
            "clearance_m": 40.0,
            "is_short": False,
        }
        for number in range(1, 5)
    ],
}


def with_more(message: dict[str, Any]) -> dict[str, Any]:
    """Add a plan that waits, a long list of alarms, and a sensor with a long name."""
    if message["type"] == "snapshot":
        message["proposal"] = PROPOSAL
        entries = [
            {
                "n": 10_000 + n,
                "t_s": 1.0,
                "level": "alarm",
                "text": f"no scan of sensor {LONG}{chr(65 + n)}",
                "kind": "Notice",
                "code": "sensor-silent",
                "key": f"sensor-silent {n}",
                "ends": [],
                "vehicle": None,
            }
            for n in range(40)
        ]
        message["log"] = [*message.get("log", []), *entries]
    elif "proposal" in message:
        message["proposal"] = PROPOSAL
    if "head" in message:
        message["head"]["sensors"] = [{"name": LONG, "scan_age_s": 9.0, "state": "silent"}]
    return message


def crowd(socket: WebSocketRoute) -> None:
    server = socket.connect_to_server()
    server.on_message(lambda data: socket.send(json.dumps(with_more(json.loads(data))).encode()))


def is_on_top(page: Page, selector: str) -> bool:
    """Return True if the middle of an element is within the window, and nothing covers it."""
    found: bool = page.locator(selector).first.evaluate(
        """element => {
            element.scrollIntoView({ block: "center" });
            const box = element.getBoundingClientRect();
            const found = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
            return found !== null && (found === element || element.contains(found));
        }"""
    )
    return found


@pytest.mark.real_time
def test_map_vehicles_and_confirmation_are_there_at_every_size(fly, launch, page):
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.route_web_socket("**/feed", crowd)
    with fly() as flight:
        launch(flight)
        page.goto(flight.url)
        expect(page.locator("#plan")).to_contain_text("Plan 7 waits")
        zone = {"name": "z" * 64, "circle": [700, 500, 60]}
        flight.request("/api/orders", {"action": "no-fly-zone", "no_fly_zone": zone})
        page.get_by_role("button", name="Edit zzz").click()
        expect(page.locator("#map .hint")).to_be_visible()
        for opened in ("1", "k", "g"):
            page.keyboard.press(opened)
            if opened == "k":
                page.locator("#tab-alarms").click()
            for width, height in SIZES:
                page.set_viewport_size({"width": width, "height": height})
                where = (opened, width)
                assert page.evaluate("document.documentElement.scrollWidth") <= width, where
                assert page.locator("#head").bounding_box()["height"] < 160, where
                assert page.locator("#alarms").bounding_box()["height"] < 140, where
                area = page.locator("#map canvas").bounding_box()
                assert area["width"] >= 390, where
                assert area["height"] >= 200, where
                assert page.locator("#vehicles").bounding_box()["height"] >= 120, where
                assert is_on_top(page, "#vehicles tbody tr"), where
                assert is_on_top(page, "#plan button.main"), where
                assert is_on_top(page, '[data-action="hold-all"]'), where
                shown = [
                    one
                    for one in ("targets", "detail", "alarm-list", "charts")
                    if page.locator(f"#{one}").is_visible()
                ]
                assert len(shown) == 1, (where, shown)
    assert errors == []


@pytest.mark.real_time
def test_the_newest_event_stays_in_view_when_the_window_gets_narrower(fly, launch, page):
    rest = "one => one.scrollHeight - one.scrollTop - one.clientHeight"
    page.route_web_socket("**/feed", crowd)
    page.set_viewport_size({"width": 1600, "height": 900})
    with fly() as flight:
        launch(flight)
        page.goto(flight.url)
        log = page.locator("#log .panel").first
        expect(log).to_contain_text("no scan of sensor")
        assert log.evaluate(rest) < 30
        page.set_viewport_size({"width": 1024, "height": 768})
        page.wait_for_function("document.querySelector('#log').clientWidth < 600")
        page.wait_for_timeout(500)
        assert log.evaluate(rest) < 30


@pytest.mark.real_time
def test_a_lost_service_is_shown_over_the_map(fly, launch, page):
    with fly() as flight:
        launch(flight)
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        banner = page.locator("#map .old")
        expect(banner).to_be_hidden()
        flight.console.close()
        expect(banner).to_contain_text("NO CONNECTION")
        expect(banner).to_contain_text("The last data is of ")
        assert banner.bounding_box()["height"] > 60
        assert "grayscale" in page.locator("#map canvas").evaluate("one => getComputedStyle(one).filter")
        flight.restart_console()
        expect(banner).to_be_hidden()


@dataclass
class State:
    system_id: int
    t_ns: int
    east_m: float
    north_m: float = 0.0
    alt_msl_m: float = 600.0


def test_a_trail_ends_where_nothing_was_heard() -> None:
    world = World(mission_info(load("prescribed"), RunInfo()), History(is_recorded=False))
    heard_s = [0, 2, 4, 4, 4, 4, 20, 22]
    states: deque[State] = deque(State(1, (1 + t_s) * NS_PER_S, 10.0 * t_s) for t_s in heard_s)
    for state in states:
        world._add_to_trails([state])  # type: ignore[list-item]
    trail = json.loads(world.snapshot())["trails"]["1"]
    assert trail == [[0, 0, 600], [20, 0, 600], [40, 0, 600], None, [200, 0, 600], [220, 0, 600]]


@pytest.mark.real_time
@pytest.mark.parametrize("key", ["v", "g"])
def test_the_panel_that_is_opened_by_a_key_is_closed_by_it(fly, page, key):
    with fly() as flight:
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        page.keyboard.press(key)
        expect(page.locator("#targets")).to_be_hidden()
        page.keyboard.press(key)
        expect(page.locator("#targets")).to_be_visible()
