"""A vehicle would return, or circle for ever, without having reached its target, unnoticed."""

import msgspec
import pytest
from helpers.noticed import alarms, noticed
from helpers.one_vehicle_fleet import CONFIG, Fleet
from helpers.ordered_flight import flown, load
from helpers.staging import at, mission

from gcs.core.state import State
from gcs.core.tasking.missed_targets import check_missed_targets
from gcs.core.tasking.mission_builder import MissionBuilder
from gcs.core.tasking.onboard_missions import OnboardMissions
from gcs.core.tasking.tasking_state import OnboardMission
from gcs.mavlink.autopilots import ARDUPLANE
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import NS_PER_S, AgentStatus, Notice, NoticeCode, Route, UploadReport, read_only
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS


class UploadManager:
    """Two points, then what the mission's end is; items from 1 on."""

    def __init__(self, end, loiter_radius_m=30.0, wait_m=None):
        route = Route(1, (0, 0), read_only([[0.0, 500.0], [900.0, 0.0]]), 1.0, wait_m=wait_m)
        table = mission(tables=f'[mission]\nend = "{end}"\nloiter_radius_m = {loiter_radius_m}').mission
        planned = MissionBuilder(msgspec.structs.replace(CONFIG, mission=table)).of(route, 1, None)
        self.fleet = Fleet(1)
        self.fleet.one.armed = True
        self.agents = State.initial([1]).agents
        self.onboard_missions = OnboardMissions(self.fleet, self.agents)
        self.onboard_missions.note(
            OnboardMission(route, build_items(ARDUPLANE, planned, Home(33.2, -87.6, 70.0)), first_point=1)
        )


def check_ends(tasking, seq, seconds, active=(1,)):
    agents, missions = tasking.agents, tasking.onboard_missions
    if not active:
        agents[1].perception.status = AgentStatus(0, 1, "arrived")
    tasking.fleet.one.mission_seq = seq
    link = agents[1].link
    link.mode = "AUTO"
    link.armed = True
    link.mission_seq = seq
    found = [check_missed_targets(agents, missions, 40.0, at(float(second))) for second in range(seconds)]
    return [ended_short(notice) for notices in found for notice in notices], missions.has_missed(1)


def ended_short(notice):
    """Return what the vehicle does at the end of its route, which it ended short of its target."""
    assert notice.code is NoticeCode.ROUTE_ENDED_SHORT
    return notice.parameters["state"]


def test_flight_g4_a_vehicle_that_returns_without_its_target_is_reported_and_tasked_again():
    states, missed = check_ends(UploadManager("land"), seq=3, seconds=20)
    assert states == ["it returns to land"]
    assert missed


def test_a_vehicle_on_final_is_reported_and_lands():
    states, missed = check_ends(UploadManager("land"), seq=4, seconds=20)
    assert states == ["it lands, and gets no other mission before that"]
    assert not missed


@pytest.mark.parametrize(("radius_m", "is_missed"), [(80.0, True), (30.0, False)])
def test_a_circle_that_never_comes_within_reach_is_no_arrival(radius_m, is_missed):
    states, missed = check_ends(UploadManager("loiter", radius_m), seq=3, seconds=20)
    assert states == ["it circles at its route's end"]
    assert missed == is_missed


@pytest.mark.parametrize(("seq", "seconds", "active"), [(2, 60, (1,)), (3, 4, (1,)), (3, 60, ())])
def test_a_vehicle_on_its_route_about_to_arrive_or_arrived_is_not_reported(seq, seconds, active):
    assert check_ends(UploadManager("land"), seq, seconds, active) == ([], False)


class Returned:
    """A virtual flight in which vehicle 1 goes to RTL after a while, and the operator's notices of it."""

    def __init__(self, goes, at_s, until_s):
        flight = flown(load("prescribed"), at_s)
        self.run, self.effects = flight.run, flight.effects
        self.plane = self.run.vehicles["vehicle:1"].autopilot
        self.began_t_ns = START_T_NS + round(at_s * NS_PER_S)
        goes(self.plane)
        self.run.run(until_s)

    def later(self, kind):
        found = [e for t_ns, e in self.effects if t_ns > self.began_t_ns and isinstance(e, kind)]
        return [effect for effect in found if effect.vehicle == 1]

    def overrides(self):
        """Return the modes that were not commanded; nothing else was worth a warning."""
        told = [notice for notice in self.later(Notice) if notice.level != "info"]
        assert {notice.code for notice in told} <= {NoticeCode.OVERRIDDEN}
        return [notice.parameters["mode"] for notice in told]


def test_an_rtl_at_the_mission_s_end_is_no_take_over_and_its_target_is_flown_to_again():
    flight = Returned(lambda plane: plane._end_mission(), 45.0, 65.0)
    (alarm,) = alarms(flight.later(Notice))
    assert ended_short(alarm) == "it ended its mission and flies RTL"
    assert not noticed(flight.later(Notice), NoticeCode.OVERRIDDEN)
    assert flight.later(UploadReport)[0].ok
    assert flight.plane.mode is Mode.AUTO


def test_an_rtl_of_an_operator_or_a_failsafe_stays_a_take_over():
    flight = Returned(lambda plane: plane.set_mode(Mode.RTL), 45.0, 65.0)
    assert flight.overrides() == ["RTL"]
    assert not flight.later(UploadReport)
    assert flight.plane.mode is Mode.RTL


def test_an_rtl_long_after_a_stop_is_a_take_over_although_the_mission_is_complete():
    def goes(plane):
        plane._end_mission()
        plane.set_mode(Mode.CRUISE)

    flight = Returned(goes, 45.0, 50.0)
    flight.plane.set_mode(Mode.RTL)
    flight.run.run(65.0)
    assert flight.overrides() == ["CRUISE", "RTL"]
    assert flight.plane.mode is Mode.RTL


def test_one_that_has_reached_its_target_returns_without_a_word():
    flight = Returned(lambda plane: plane._end_mission(), 140.0, 155.0)
    assert flight.run.engine.state.agents[1].perception.status.status == "arrived"
    assert not [notice for notice in flight.later(Notice) if notice.level != "info"]
    assert flight.plane.mode is Mode.RTL
