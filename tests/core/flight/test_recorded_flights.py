"""An operator would lose the mission to wrecks: recorded flights of ArduPlane and PX4, seen as they happened.

The logs have what the vehicles sent; nothing is answered. When each vehicle hit the ground is known from
their true positions.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.config import load
from gcs.core.engine import Engine
from gcs.model import AgentStatus, Notice, NoticeCode
from gcs.service.foreign_logs import telemetry_records

DATA = Path(__file__).parents[4] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the shared data are not here")


def replay(folder: str, until_s: float) -> tuple[dict[int, float], list[tuple[float, Notice]]]:
    """Return when each vehicle was called down, and the notices, in seconds of the log."""
    config = load(str(DATA / folder / "mission.toml"))
    engine = Engine(config, 0)
    down: dict[int, float] = {}
    notices = []
    start_t_ns = None
    for record in telemetry_records(DATA / folder / "link.tlog", {agent.vehicle for agent in config.agents}):
        start_t_ns = record.t_ns if start_t_ns is None else start_t_ns
        t_s = (record.t_ns - start_t_ns) / 1e9
        if t_s > until_s:
            break
        for effect in engine.step(record.value):  # type: ignore[arg-type]
            if isinstance(effect, AgentStatus) and effect.status == "down":
                down[effect.vehicle] = t_s
            if isinstance(effect, Notice):
                notices.append((t_s, effect))
    return down, notices


def first(
    notices: list[tuple[float, Notice]], vehicle: int, code: NoticeCode, cause: str = "", mode: str = ""
) -> float:
    return next(
        t_s
        for t_s, one in notices
        if (one.vehicle, one.code) == (vehicle, code)
        and cause in str(one.parameters.get("cause", ""))
        and mode in str(one.parameters.get("mode", ""))
    )


def test_an_arduplane_that_crashed_with_its_radio_alive_is_down_and_nobody_else() -> None:
    down, notices = replay("arduplane/flights/C4", 120.0)
    assert list(down) == [3]
    assert 90.4 < down[3] < 94.0  # it hits the ground at 90.4 s and slides
    assert first(notices, 3, NoticeCode.PROPULSION_PROBLEM, "sinks at full throttle") < 90.4


def test_the_faults_of_six_arduplanes_are_told_with_their_causes() -> None:
    down, notices = replay("arduplane/flights/A6", 90.0)
    assert list(down) == [1]
    assert 72.3 < down[1] < 76.0  # engine stopped; it lands hard at 72.3 s
    assert first(notices, 1, NoticeCode.PROPULSION_PROBLEM, "sinks at full throttle") < 45.0
    assert first(notices, 3, NoticeCode.GPS_PROBLEM, "no 3D fix") < 46.5  # off from 43.5 s on
    assert first(notices, 3, NoticeCode.GPS_GOOD) < 70.0
    assert first(notices, 5, NoticeCode.FAILSAFE, "Throttle failsafe on; RC Short Failsafe On") < 67.0


def test_px4s_failsafe_landing_in_a_field_and_its_dead_engine_are_down_and_its_landings_are_not() -> None:
    down, notices = replay("px4/flights/r2", 150.0)
    assert list(down) == [3, 2]
    assert first(notices, 2, NoticeCode.FAILSAFE, "Low battery; Failsafe activated", "LOITER") < 33.0
    assert first(notices, 2, NoticeCode.FAILSAFE, mode="LAND") < 38.0
    assert first(notices, 1, NoticeCode.LANDED) < 102.0
    assert not [one for _, one in notices if (one.vehicle, one.code) == (2, NoticeCode.OURS_AGAIN)]
