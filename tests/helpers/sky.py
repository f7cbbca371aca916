"""Virtual flights of vehicles at chosen places and heights, and which of them came near."""

import copy
from dataclasses import replace

import numpy as np

from gcs.model import Notice, Order, OrderAnswer
from helpers.flight_copies import copy_of
from helpers.staging import S
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import parse_scenario
from sim_vehicles.world.vehicle_specs import vehicle_specs

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

    def copy(self):
        """Return a copy that flies on by itself."""
        new = copy.copy(self)
        new.run_ = copy_of(self.run_)
        new.run_.on_effect = new._on_effect
        new.planes = {plane.system_id: plane for plane in new.run_.vehicles.values()}
        new.notices, new.answers, new.near_s = self.notices.copy(), self.answers.copy(), self.near_s.copy()
        return new

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


LANDING = (
    FIELD.replace("[mission]", '[mission]\nend = "land"')
    + """
[[births]]
east_m = 1500.0
north_m = 2900.0
[[simulation.targets]]
east_m = 1500.0
north_m = 2900.0
"""
)


def fly_on(sky, for_s):
    return sky.fly((sky.run_.t_ns - START_T_NS) / S + for_s)


def place(plane, east_m, north_m, height_m, course_deg=0.0):
    """Put a vehicle somewhere in level flight; it keeps its mode."""
    airframe = plane.airframe
    airframe.east_m, airframe.north_m = east_m, north_m
    airframe.alt_rel_m, airframe.heading_rad = height_m, np.deg2rad(course_deg)
    airframe._alt_demand_m, airframe.climb_m_s = height_m, 0.0


def give(sky, action, *vehicles):
    number = len([one for one in sky.answers if one.action == action])
    sky.run_.order(Order(sky.run_.t_ns, f"{action}-{number}", action, vehicles or None))


def with_one_home(sky, place_m=(1500.0, 1500.0)):
    """Let all vehicles return to one place, at the height of their parameters: 100 m."""
    east_m, north_m = place_m
    for plane in sky.planes.values():
        plane.autopilot.home = replace(plane.autopilot.home, east_m=east_m, north_m=north_m)
    return fly_on(sky, 12.0)
