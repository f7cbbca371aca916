"""Two vehicles would meet in the air without a word: in a climb, on the way home, after an order."""

from dataclasses import replace

import numpy as np
import pytest
from core.test_authority import ARDUPLANE, Stage
from pymavlink.dialects.v20 import ardupilotmega as dialect
from staging import S

from gcs.core.tasking.records import OnboardMission
from gcs.mavlink.mission.items import Item
from gcs.model import Notice, NoticeCode, Order, OrderAnswer, Route, Tick, read_only
from sim_vehicles.autopilots.base import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.vehicle.guidance import Straight
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import parse_scenario
from sim_vehicles.world.specs import vehicle_specs

FIELD = """
name = "field"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[map]
width_m = 3000.0
height_m = 3000.0
nodes_east = 31
nodes_north = 31
[airframe]
speed_m_s = 18.0
[planning]
shape = "flyable"
[mission]
altitude_rel_m = 60.0
layers = 8
loiter_radius_m = 60.0
[simulation]
forward_speed_m_s = 18.0
airframe = "banked"
parameters = { ARMING_DELAY_S = 1.0 }
[simulation.sensor]
clutter_per_scan = 0.0
[[births]]
east_m = 2900.0
north_m = 2900.0
[[births]]
east_m = 100.0
north_m = 2900.0
[[simulation.targets]]
east_m = 2900.0
north_m = 2900.0
[[simulation.targets]]
east_m = 100.0
north_m = 2900.0
"""
NEAR_M, NEAR_HEIGHT_M = 30.0, 15.0


class Sky:
    """A virtual flight of vehicles at the places and heights given; height 0 is on the ground."""

    def __init__(self, *places, orders=(), px4=(), courses_deg=None, field=FIELD):
        text = field.replace("[simulation]\n", f"[simulation]\npx4 = {list(px4)}\n", 1)
        courses_deg = courses_deg or [0.0] * len(places)
        for number, ((east_m, north_m, _), course_deg) in enumerate(zip(places, courses_deg, strict=True), 1):
            text += f"[[agents]]\nsystem_id = {number}\neast_m = {east_m}\nnorth_m = {north_m}\n"
            text += f"course_deg = {course_deg}\n"
        scenario = parse_scenario(text, "sky.toml")
        self.notices, self.answers = [], []
        given = [
            Order(START_T_NS + round(t_s * S), f"{what}-{t_s}", what, tuple(who) or None)
            for t_s, what, *who in orders
        ]
        self.run_ = VirtualRun(scenario, 1, on_effect=self._on_effect, orders=given)
        self.planes = {}
        for spec, (_, _, height_m) in zip(vehicle_specs(scenario, 1), places, strict=True):
            start = replace(spec, airborne=height_m > 0.0, alt_rel_m=height_m)
            self.planes[spec.system_id] = SimVehicle(start, scenario.frame, START_T_NS)
        self.run_.vehicles = {f"vehicle:{number}": plane for number, plane in self.planes.items()}
        self.near_s = {}
        """First time at which each pair was within 30 m and 15 m."""

    def _on_effect(self, t_ns, effect):
        if isinstance(effect, Notice):
            self.notices.append(((t_ns - START_T_NS) / S, effect))
        elif isinstance(effect, OrderAnswer):
            self.answers.append(effect)

    def fly(self, until_s):
        for t_s in np.arange((self.run_.t_ns - START_T_NS) / S + 0.2, until_s, 0.2).tolist():
            self.run_.run(t_s)
            self.run_.ended = False
            flying = [plane for plane in self.planes.values() if plane.alt_rel_m > 2.0]
            for k, one in enumerate(flying):
                for other in flying[k + 1 :]:
                    away_m = np.hypot(one.east_m - other.east_m, one.north_m - other.north_m)
                    if away_m < NEAR_M and abs(one.alt_rel_m - other.alt_rel_m) < NEAR_HEIGHT_M:
                        self.near_s.setdefault((one.system_id, other.system_id), t_s)
        return self

    def told(self, code):
        return [(t_s, notice) for t_s, notice in self.notices if notice.code is code]


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
    assert answers[0][1].endswith("resume it when they are apart")


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
