"""Vehicles that stand side by side would take off one over the other, or into one that lands."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from helpers.noticed import alarms
from helpers.runway import Field
from helpers.staging import at, mission, state

from gcs.core.preflight.check_codes import CheckCode
from gcs.core.preflight.mission_checks import mission_checks, rehearse
from gcs.core.state import State
from gcs.core.takeoff.sequence import TakeoffSequence
from gcs.mavlink.mission.items import Home
from gcs.model import NoticeCode


def test_one_order_to_arm_two_vehicles_side_by_side_arms_the_first_and_explains_the_wait():
    field = Field((15.0, "arm"), (20.0, "arm", 2), (40.0, "arm", 2)).run(70.0)
    assert field.answers("arm-15.0")[1][0] == "done"
    verdict, detail = field.answers("arm-15.0")[2]
    assert verdict == "refused"
    assert detail.startswith("would take off at once, and agent 1 is about to take off, ")
    assert detail.endswith(
        " m away: wait until it is 80 m above home or 337 m away, or is disarmed, then order it again"
    )
    verdict, detail = field.answers("arm-20.0")[2]
    assert verdict == "refused"
    assert "agent 1 climbs out, " in detail
    assert field.answers("arm-40.0")[2][0] == "done"
    assert min(field.heights_m()) > 80.0
    assert not field.low_together


def test_vehicles_that_are_armed_before_they_have_missions_take_off_one_after_the_other():
    """Armed in LOITER both wait for their missions, which would start them at the same time."""
    field = Field((8.0, "hold"), (11.0, "arm"), (14.0, "resume"), ready=()).run(20.0)
    assert {verdict for verdict, _ in field.answers("arm-11.0").values()} == {"done"}
    assert {verdict for verdict, _ in field.answers("resume-14.0").values()} == {"done"}
    field.run(90.0)
    (waits,) = field.noticed(NoticeCode.TAKEOFF_WAITS)
    assert waits.parameters["reason"].startswith(f"agent {3 - waits.vehicle} is about to take off, ")
    assert min(field.heights_m()) > 80.0
    assert not field.low_together
    assert not alarms(field.effects)


def test_two_that_another_station_arms_at_once_are_reported():
    field = Field().run(15.0)
    for plane in field.planes:
        plane.autopilot.armed = True
    field.run(50.0)
    assert field.low_together
    (alarm,) = field.noticed(NoticeCode.CLIMBS_NEAR)
    assert (alarm.vehicle, alarm.parameters["other"]) == (1, 2)
    assert alarm.key in [key for over in field.noticed(NoticeCode.CLIMBS_APART) for key in over.ended]


class Swarm:
    """Vehicle 1 stands on the ground; 2 is somewhere."""

    config = mission()

    def __init__(self, place, height_m, ending="", mode="AUTO", *, armed=True, liveness="alive", speed=15.0):
        standing = replace(state(1, (0.0, 0.0)), alt_msl_m=70.0, mode="LOITER", armed=False)
        other = state(2, place, speed_m_s=speed)
        other = replace(other, alt_msl_m=70.0 + height_m, mode=mode, armed=armed)
        self._states, self._ending = {1: standing, 2: other}, ending
        lat_deg, lon_deg = self.config.local_frame.to_geodetic(0.0, 0.0)
        self._home = Home(lat_deg, lon_deg, 70.0)
        self._liveness = liveness

    def state(self, vehicle):
        return self._states[vehicle]

    def states(self):
        return tuple(self._states.values())

    def home(self, _vehicle):
        return self._home

    def health(self):
        return [SimpleNamespace(system_id=v, liveness=self._liveness, home=self._home) for v in (1, 2)]

    def terminal_phase(self, vehicle):
        return self._ending if vehicle == 2 else ""

    def is_in_takeoff(self, _vehicle):
        return False

    def height_m(self, state):
        return state.alt_msl_m - self._home.alt_msl_m


def sequence(swarm):
    free = SimpleNamespace(crossing=lambda _vehicle, _t_ns: None)
    return TakeoffSequence(swarm.config, swarm, swarm, State.initial([1, 2]), free)


@pytest.mark.parametrize(
    ("swarm", "expected"),
    [
        (
            Swarm((200.0, 0.0), 100.0, "return route"),
            "flies its landing, 200 m away: wait until it has landed",
        ),
        (Swarm((900.0, 0.0), 25.0, "landing"), "flies its landing, 0 m away: wait until it has landed"),
        (Swarm((200.0, 0.0), 30.0, mode="RTL"), "is low, 30 m above home in RTL, 200 m away"),
        (Swarm((20.0, 0.0), 0.0, speed=0.0), "is about to take off, 20 m away"),
        (Swarm((20.0, 0.0), 0.0, speed=0.0, mode="LOITER"), ""),
        (Swarm((20.0, 0.0), 0.0, speed=0.0, armed=False), ""),
        (Swarm((900.0, 0.0), 100.0, "return route"), ""),
        (Swarm((200.0, 0.0), 100.0), ""),
        (Swarm((900.0, 0.0), 30.0), ""),
        (Swarm((200.0, 0.0), 30.0, liveness="down"), ""),
    ],
)
def test_only_a_low_or_landing_vehicle_delays_a_takeoff(swarm, expected):
    reason = sequence(swarm).blocked_by(1, (), at(0.0))
    assert (expected in reason) if expected else reason == ""


def test_two_that_climb_apart_are_not_reported():
    swarm = Swarm((900.0, 0.0), 30.0, mode="TAKEOFF")
    takeoff_sequence = sequence(swarm)
    assert takeoff_sequence.check(at(0.0)) == []


def test_a_takeoff_that_does_not_lift_off_is_told_once_until_it_does():
    """Others near by waited for it for minutes, and no operator was told."""
    swarm = Swarm((900.0, 0.0), 0.0, speed=6.0)
    swarm.is_in_takeoff = lambda vehicle: vehicle == 2
    takeoff_sequence = sequence(swarm)
    (stuck,) = [notice for t_s in range(60) for notice in takeoff_sequence.check(at(float(t_s)))]
    assert (stuck.code, stuck.vehicle) == (NoticeCode.TAKEOFF_STUCK, 2)
    assert stuck.parameters["since_s"] == 30.0
    swarm._states[2] = replace(swarm._states[2], alt_msl_m=82.0)
    codes = {notice.code: notice for notice in takeoff_sequence.check(at(60.0))}
    assert codes[NoticeCode.TAKEOFF_STUCK_NO_LONGER].ended == (stuck.key,)


@pytest.mark.parametrize(("apart_m", "is_reported"), [(30.0, True), (300.0, False)])
def test_preflight_names_vehicles_that_stand_near_each_other(apart_m, is_reported):
    swarm = Swarm((apart_m, 0.0), 0.0, speed=0.0, armed=False)
    places = {1: (0.0, 0.0), 2: (apart_m, 0.0)}
    rows = mission_checks(swarm.config, rehearse(swarm.config, 1, places, swarm))
    reported = [row.parameters for row in rows if row.code is CheckCode.STANDING_NEAR]
    assert len(reported) == is_reported
    for parameters in reported:
        assert parameters["vehicles"] == (1, 2)
        assert (parameters["first"], parameters["second"], parameters["distance_m"]) == (1, 2, 30.0)
