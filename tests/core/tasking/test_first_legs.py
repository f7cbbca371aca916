"""A vehicle would fly hundreds of metres off its planned line, unnoticed."""

from dataclasses import replace

import pytest
from helpers.noticed import noticed
from helpers.staging import at, state
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.tasking.first_legs import FirstLegs
from gcs.core.tasking.tasking_state import OnboardMission
from gcs.mavlink.autopilots import ARDUPLANE, PX4
from gcs.model import Notice, NoticeCode, Route, Send, read_only

RECORDED = [
    # Selected by DO_SET_MISSION_CURRENT; time, cross-track error, distance to the waypoint, speed.
    ("G3 at 11.8 s", [(0.29, 1346.9, 1391, 23.0), (0.53, 1340.0, 1384, 23.0)], True),
    ("G3 at 15.8 s", [(0.26, -759.8, 766, 23.0), (0.50, -753.0, 759, 23.0)], True),
    ("G4 at its first swap", [(0.24, -465.4, 486, 23.5), (0.49, -460.0, 480, 23.5)], True),
    ("C, agent 2, first re-task", [(0.11, -443.3, 471, 23.5), (0.35, -438.7, 466, 23.5)], True),
    ("C, agent 2, second", [(0.23, -58.6, 78, 23.4), (0.48, -53.7, 78, 23.2)], True),
    ("C, agent 2, third", [(0.21, 96.0, 103, 23.5), (0.47, 96.6, 101, 23.5)], True),
    ("C, agent 4", [(0.10, 9.7, 551, 23.7), (0.35, 9.0, 545, 23.7), (0.85, 5.6, 533, 23.9)], False),
    ("A, agent 1", [(0.08, -7.2, 129, 23.4), (1.08, -9.3, 153, 23.5), (2.08, -25.2, 160, 23.5)], False),
    ("G3 at 20.9 s", [(0.22, 0.0, 107, 23.5), (0.46, 0.0, 105, 23.4)], False),
    ("F, agent 1, turning", [(0.02, 0.0, 217, 22.0), (0.27, 2.5, 222, 21.9), (2.4, 56.8, 230, 22.9)], False),
]


class Fleet:
    """One ArduPlane at the origin, and what is sent to it."""

    def __init__(self, profile=ARDUPLANE):
        self._profile, self.watched, self.sent = profile, False, []
        self.now = state(1, (0.0, 0.0), speed_m_s=23.5)

    def profile(self, _vehicle):
        return self._profile

    def state(self, _vehicle):
        return self.now

    def encoder(self, _vehicle):
        return lambda message: message

    def address_frames(self, _vehicle, frames):
        self.sent += (frames := list(frames))
        return [Send("link", "peer", b"") for _ in frames]

    def watch_leg(self, _vehicle, *, watched):
        self.watched = watched

    @property
    def selections(self):
        return [message.seq for message in self.sent if message.get_type() == "MISSION_SET_CURRENT"]


def watching(fleet, distance_m):
    route = Route(1, (0, 0), read_only([[0.0, distance_m], [900.0, 900.0]]), 1.0)
    legs = FirstLegs(fleet, {})
    legs.begin(OnboardMission(route, (), first_point=1), 1, at(0.0), at(0.0))
    return legs


def report(legs, t_s, xtrack_m, distance_m, seq=1):
    output = dialect.MAVLink_nav_controller_output_message(0.0, 0.0, 0, 0, distance_m, 0.0, 0.0, xtrack_m)
    current = dialect.MAVLink_mission_current_message(seq, 2)
    return [*legs.receive(1, output, at(t_s)), *legs.receive(1, current, at(t_s))]


@pytest.mark.parametrize(("name", "samples", "is_wrong"), RECORDED)
def test_the_wrong_first_legs_of_recorded_flights_are_started_again_with_a_notice(name, samples, is_wrong):
    fleet = Fleet()
    legs = watching(fleet, float(samples[0][2]))
    effects = [
        effect for t_s, xtrack_m, to_go_m, _ in samples for effect in report(legs, t_s, xtrack_m, to_go_m)
    ]
    notices = noticed(effects, NoticeCode.FIRST_LEG_WRONG)
    assert (fleet.selections, len(notices)) == (([0], 1) if is_wrong else ([], 0))  # 0 selects the first item
    for notice in notices:
        assert "off its line" in notice.parameters["problem"]
        assert notice.parameters["item"] == 1


def test_a_vehicle_that_still_flies_to_its_old_waypoint_is_sent_to_the_new_one():
    fleet = Fleet()
    legs = watching(fleet, 800.0)
    effects = [effect for t_s in (0.3, 0.7) for effect in report(legs, t_s, 0.0, 300)]
    assert fleet.selections == [0]
    (notice,) = noticed(effects, NoticeCode.FIRST_LEG_WRONG)
    assert "flies to a waypoint 300 m away" in notice.parameters["problem"]


def test_a_vehicle_whose_position_is_merely_old_is_not_said_to_fly_wrong():
    """Its position stays 3 s behind (a slow stream, a frozen receiver): it has flown 70 m since."""
    fleet = Fleet()
    legs = watching(fleet, 500.0)
    effects = []
    for t_s in (3.0, 3.3, 3.6, 3.9):
        effects += report(legs, t_s, 0.0, 500 - round(23.5 * t_s))
    assert effects == []
    assert fleet.selections == []
    effects = [*report(legs, 3.95, 900.0, 500), *report(legs, 3.97, 900.0, 500)]
    assert [one.level for one in effects if isinstance(one, Notice)] == ["warning"]


def test_a_leg_that_cannot_be_mended_is_an_alarm():
    fleet = Fleet()
    legs = watching(fleet, 800.0)
    notices = [one for n in range(20) for one in report(legs, 0.3 * n, 500.0, 800) if isinstance(one, Notice)]
    assert [one.level for one in notices] == ["warning", "alarm"]
    assert len(fleet.selections) == 3
    assert not fleet.watched


@pytest.mark.parametrize("end", ["next item", "other mode", "time"])
def test_a_leg_is_watched_until_its_end_and_no_longer(end):
    fleet = Fleet()
    legs = watching(fleet, 800.0)
    assert legs.poll(at(0.1))
    assert fleet.watched
    if end == "next item":
        report(legs, 1.0, 0.0, 800, seq=2)
    elif end == "other mode":
        fleet.now = replace(fleet.now, mode="RTL")
        report(legs, 1.0, 0.0, 800)
    else:
        legs.poll(at(10.0))
    assert not fleet.watched
    report(legs, 1.2, 900.0, 800)
    report(legs, 1.4, 900.0, 800)
    assert fleet.selections == []


def test_only_firmware_that_tracks_old_legs_is_asked():
    fleet = Fleet(PX4)
    assert watching(fleet, 800.0).poll(at(0.1)) == []
    assert not fleet.watched
