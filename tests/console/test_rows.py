"""An operator would not see what was ordered about targets, or that the service is in trouble."""

from __future__ import annotations

from dataclasses import replace

from cli.test_status_tables import CALM, TARGET

from gcs.config import load
from gcs.console.view.capture import ServiceState, capture
from gcs.console.view.rows import sensors, service, targets, vehicles
from gcs.core.engine import Engine
from gcs.io.recording.writer import DiskSpace
from gcs.model import NS_PER_S, SwarmStatus


def test_a_target_tells_that_it_is_ignored_ranked_and_who_is_pinned_to_it() -> None:
    agents = (replace(CALM, pinned=TARGET.label), replace(CALM, vehicle=2))
    found = (replace(TARGET, priority=5), replace(TARGET, label=(3, 2), is_ignored=True))
    ranked, ignored = targets(SwarmStatus(0, "", agents, found, (), None, False))
    assert (ranked["priority"], ranked["pinned"], ranked["ignored"]) == (5, ["1"], False)
    assert (ignored["priority"], ignored["pinned"], ignored["ignored"]) == (None, [], True)


def test_a_charge_below_the_limit_of_its_alarm_is_low() -> None:
    now = capture(Engine(load("prescribed"), 1), 0)
    agents = tuple(replace(CALM, battery_percent=charge) for charge in (29, 30, None))
    rows = vehicles(replace(now, status=replace(now.status, agents=agents)))
    assert [row["battery_low"] for row in rows] == [True, False, False]


def test_a_sensor_that_falls_silent_is_late_at_first() -> None:
    engine = Engine(load("prescribed"), 1)
    watchdog = engine.state.perception.sensor_watchdog
    for t_s in range(1, 4):
        watchdog.processed("radar", t_s * NS_PER_S)

    def state(t_s: int) -> str:
        watchdog.poll(t_s * NS_PER_S)
        (row,) = sensors(capture(engine, t_s * NS_PER_S))
        return str(row["state"])

    assert [state(t_s) for t_s in (4, 6, 9)] == ["", "late", "silent"]


def test_the_space_of_the_recording_is_shown() -> None:
    state = ServiceState(
        0.01, 0, True, DiskSpace(12_000_000, 34_000_000_000, False), ("10.0.0.2:14550 (255/190)",)
    )
    shown = service(state)
    assert shown is not None
    assert (shown["used_mb"], shown["free_mb"], shown["low"]) == (12.0, 34000.0, False)
    assert shown["stations"] == ("10.0.0.2:14550 (255/190)",)
