"""Two vehicles would meet in the air without a word: in a climb, on the way home, after an order."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.played_vehicle import ARDUPLANE, Stage
from helpers.sky import NEAR_HEIGHT_M, Sky
from helpers.staging import S
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.tasking.tasking_state import OnboardMission
from gcs.mavlink.mission.items import Item
from gcs.model import NoticeCode, Order, Route, Tick, read_only
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.vehicle.guidance import Straight


def test_eight_that_a_failsafe_brings_to_one_height_are_told_five_seconds_before():
    places = [(400.0 + 300.0 * k, 300.0 + 900.0 * (k % 2), 60.0 + 20.0 * k) for k in range(8)]
    sky = Sky(*places)
    for plane in sky.planes.values():
        plane.autopilot.home = replace(plane.autopilot.home, east_m=1500.0, north_m=1500.0)
    sky.fly(12.0)
    for plane in sky.planes.values():
        plane.autopilot.set_mode(Mode.RTL)
    sky.fly(110.0)
    assert len(sky.near_s) >= 3
    for (one, other), near_s in sky.near_s.items():
        told = [
            t_s
            for t_s, notice in sky.told(NoticeCode.COMES_NEAR)
            if (notice.vehicle, notice.parameters["other"]) == (one, other)
        ]
        assert told, (one, other)
        assert near_s - told[0] >= 5.0, (one, other)


def test_the_alarm_names_both_the_place_and_the_time_and_ends():
    """A pilot flies through the circle of a held vehicle, at its height, and out again."""
    sky = Sky((500.0, 500.0, 100.0), (1400.0, 500.0, 100.0), orders=[(1.0, "hold")]).fly(20.0)
    held, flown = sky.planes[1].airframe, sky.planes[2]
    flown.autopilot.set_mode(Mode.FBWA)
    flown.autopilot.goal = Straight(np.arctan2(held.east_m - flown.east_m, held.north_m - flown.north_m))
    sky.fly(100.0)
    (t_s, alarm), *later = sky.told(NoticeCode.COMES_NEAR)
    assert (alarm.vehicle, alarm.parameters["other"]) == (1, 2)
    assert alarm.parameters["after_s"] > 5.0
    assert alarm.parameters["place_height_m"] == pytest.approx(100.0, abs=NEAR_HEIGHT_M)
    assert len(later) <= 1
    ((end_s, over),) = sky.told(NoticeCode.APART_AGAIN)
    assert alarm.key in over.ended
    assert end_s > t_s


@pytest.mark.parametrize("px4", [(), (1,)])
def test_a_take_off_waits_for_a_vehicle_that_flies_through_its_climb(px4):
    """The vehicle in the air circles in a layer that the climb crosses, above its end."""
    orders = [(1.0, "hold"), (4.0, "resume", 1), (20.0, "arm", 1)]
    sky = Sky((1000.0, 500.0, 0.0), (1000.0, 640.0, 60.0), orders=orders, px4=px4).fly(24.0)
    refused = [one.detail for one in sky.answers if one.state == "refused" and one.action == "arm"]
    assert len(refused) == 1
    assert refused[0].startswith("would take off at once, and its climb meets agent 2, ")
    assert not sky.planes[1].autopilot.armed


def test_a_take_off_does_not_wait_for_a_vehicle_far_away_or_above():
    orders = [(1.0, "hold"), (4.0, "resume", 1), (20.0, "arm", 1)]
    sky = Sky((1000.0, 500.0, 0.0), (2200.0, 1200.0, 60.0), orders=orders).fly(24.0)
    assert sky.planes[1].autopilot.armed
    assert not sky.told(NoticeCode.TAKEOFF_WAITS)


def test_one_order_does_not_resume_a_vehicle_into_another():
    """Both were held; the mission of the first leads through the circle of the second, which has none."""
    sky = Sky((600.0, 600.0, 60.0), (1700.0, 1700.0, 80.0)).fly(20.0)
    first = sky.planes[1]
    assert first.autopilot.mode is Mode.AUTO
    sky.run_.order(Order(sky.run_.t_ns, "hold", "hold", None))
    sky.fly(26.0)
    second = sky.planes[2].airframe
    end_m = sky.run_.engine.state.agents[1].routes.suspended.points_m[-1]
    ahead = np.arctan2(end_m[0] - first.east_m, end_m[1] - first.north_m)
    second.east_m = first.east_m + 290.0 * np.sin(ahead)
    second.north_m = first.north_m + 290.0 * np.cos(ahead)
    second.alt_rel_m = first.alt_rel_m
    sky.planes[2].autopilot.set_mode(Mode.FBWA)
    sky.planes[2].autopilot.set_mode(Mode.LOITER)
    sky.fly(32.0)
    sky.run_.order(Order(sky.run_.t_ns, "resume", "resume", (1,)))
    sky.fly(34.0)
    answers = [(one.state, one.detail) for one in sky.answers if one.action == "resume"]
    assert answers[0][0] == "refused"
    assert answers[0][1].startswith("would come within ")
    assert answers[0][1].endswith("resume it when it is clear")


def test_a_vehicle_that_fell_silent_before_its_take_off_is_not_about_to_take_off_for_ever():
    """It was predicted from a place that moved away at its cruise speed, and others waited for it."""
    stage = Stage(ARDUPLANE, "AUTO", armed=True, height_m=0.5, speed_m_s=0.0)
    route = Route(1, (0, 0), read_only([[0.0, 500.0]]), 1.0)
    items = tuple(Item(command, 3, 330000000, -870000000, 90.0) for command in (16, 22, 16))
    stage.engine.stages.tasking.onboard_missions.note(OnboardMission(route, items, 2))
    stage.hear(dialect.MAVLink_mission_current_message(1, 2))
    intents = stage.engine.stages.intents
    assert [state.system_id for state in intents.flying(stage.t_ns)] == [1]
    for _ in range(12):
        stage.t_ns += S
        stage.step(Tick(stage.t_ns))
    assert intents.flying(stage.t_ns) == []
