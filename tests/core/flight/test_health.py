"""An operator would task a vehicle that is about to fail, or be told of a failure without cause or end."""

from __future__ import annotations

import msgspec
import pytest
from helpers.aeroplane import Aeroplane, estimate
from helpers.played_vehicle import ARDUPLANE, BOTH, PX4
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.flight.health import HealthMonitor
from gcs.model import FlightPhase, NoticeCode, Route, read_only

GOOD_ESTIMATE = 0x33F
NO_ATTITUDE = GOOD_ESTIMATE & ~dialect.EKF_ATTITUDE
NO_POSITION = GOOD_ESTIMATE & ~dialect.EKF_POS_HORIZ_ABS
BITS = {
    "airspeed": dialect.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE,
    "battery": dialect.MAV_SYS_STATUS_SENSOR_BATTERY,
    "fence": dialect.MAV_SYS_STATUS_GEOFENCE,
    "propulsion": dialect.MAV_SYS_STATUS_SENSOR_PROPULSION,
    "rc": dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER,
}


class Watched(Aeroplane):
    """A vehicle in flight that also reports its estimator and the wind."""

    flags, wind_m_s = GOOD_ESTIMATE, 2.0

    def show(self) -> None:
        super().show()
        self.hear(estimate(self.autopilot, self.flags))
        wind = dialect.MAVLink_wind_message(0.0, self.wind_m_s, 0.0)
        if self.autopilot == PX4:
            wind = dialect.MAVLink_wind_cov_message(0, self.wind_m_s, *[0.0] * 7)
        self.hear(wind)

    def break_down(self, kind: str, *, breaks: bool) -> None:
        if kind in BITS:
            self.failed = BITS[kind] if breaks else 0
        elif kind == "wind":
            self.wind_m_s = 12.0 if breaks else 2.0
        elif kind == "fix":
            self.fix = 1 if breaks else 3
        else:
            self.flags = {"attitude": NO_ATTITUDE, "position": NO_POSITION}[kind] if breaks else GOOD_ESTIMATE


@BOTH
@pytest.mark.parametrize(
    ("kind", "begins", "ends", "cause", "is_unfit"),
    [
        ("fix", NoticeCode.GPS_PROBLEM, NoticeCode.GPS_GOOD, "no 3D fix", True),
        ("attitude", NoticeCode.ESTIMATE_PROBLEM, NoticeCode.ESTIMATE_GOOD, "attitude estimate is bad", True),
        ("position", NoticeCode.ESTIMATE_PROBLEM, NoticeCode.ESTIMATE_GOOD, "by dead reckoning", True),
        ("airspeed", NoticeCode.AIRSPEED_PROBLEM, NoticeCode.AIRSPEED_GOOD, "sensor is unhealthy", False),
        ("propulsion", NoticeCode.PROPULSION_PROBLEM, NoticeCode.PROPULSION_GOOD, "a failed engine", True),
        ("battery", NoticeCode.BATTERY_PROBLEM, NoticeCode.BATTERY_GOOD, "empty or faulty", True),
        ("rc", NoticeCode.RC_PROBLEM, NoticeCode.RC_GOOD, "hears no transmitter", False),
        ("fence", NoticeCode.FENCE_PROBLEM, NoticeCode.FENCE_GOOD, "has breached its fence", False),
        ("wind", NoticeCode.WIND_PROBLEM, NoticeCode.WIND_GOOD, "12 m/s, above the", False),
    ],
)
def test_each_problem_begins_is_named_with_its_cause_and_ends(
    autopilot: int, kind: str, begins: NoticeCode, ends: NoticeCode, cause: str, is_unfit: bool
) -> None:
    plane = Watched(autopilot)
    plane.wait(6.0)
    assert not plane.engine.state.agents[1].flight.problems
    plane.break_down(kind, breaks=True)
    plane.wait(3.0 if kind != "wind" else 12.0)
    (told,) = plane.noticed(begins)
    assert told.vehicle == 1
    assert cause in told.parameters["cause"]
    plane.wait(4.0)
    assert bool(plane.engine.state.agents[1].flight.unfit) is is_unfit
    plane.break_down(kind, breaks=False)
    plane.wait(8.0)
    assert len(plane.noticed(begins)) == 1
    (over,) = plane.noticed(ends)
    assert told.key in over.ended
    assert not plane.engine.state.agents[1].flight.unfit


def test_wind_above_what_routes_are_planned_for_is_told_below_30_percent_of_the_airspeed() -> None:
    plane = Watched(ARDUPLANE)
    stages = plane.engine.stages
    config = stages.health._config
    airframe = msgspec.structs.replace(config.airframe, wind_m_s=3.0)
    config = msgspec.structs.replace(config, airframe=airframe)
    stages.health = HealthMonitor(config, stages.fleet, plane.engine.state.agents, plane.engine.state.flight)
    plane.wait(12.0)
    assert not plane.noticed(NoticeCode.WIND_PROBLEM)
    plane.wind_m_s = 4.0
    plane.wait(12.0)
    (told,) = plane.noticed(NoticeCode.WIND_PROBLEM)
    assert "above the 3 m/s" in told.parameters["cause"]


def test_a_battery_that_does_not_last_for_the_route_and_the_way_home_is_told() -> None:
    plane = Watched(ARDUPLANE)
    plane.wait(4.0)
    assert plane.phase is FlightPhase.EN_ROUTE
    plane.engine.state.agents[1].routes.flown = Route(1, (0, 0), read_only([[0.0, 6000.0]]), 6000.0)
    for percent in range(80, 30, -2):
        plane.percent = percent
        plane.wait(4.0)
        told = plane.problems(NoticeCode.BATTERY_PROBLEM)
        if told:
            break
    (cause,) = told
    assert "but its route and the way back to its home take" in cause
    enough_s = float(cause.split("enough for ")[1].split(" s")[0])
    needed_s = float(cause.split(" take ")[1].split(" s")[0])
    assert enough_s == pytest.approx((plane.percent - 15) * 2.0, rel=0.25)
    assert needed_s > enough_s
    plane.wait(2.0)
    ((_, range_m),) = plane.engine.stages.planning_inputs._ranges([1]).values()
    assert range_m == pytest.approx(enough_s * 15.0, rel=0.1)
