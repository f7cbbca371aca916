"""A mission over terrain ends with a landing: the vehicle comes home over the ground, or stays up there."""

import numpy as np
import pytest
from helpers.hills import elevation_of, terrain_table
from pymavlink.dialects.v20.ardupilotmega import MAV_CMD_NAV_LOITER_TIME, MAV_CMD_NAV_LOITER_UNLIM

from gcs.config import parse
from gcs.core.preflight.check_codes import CheckCode
from gcs.core.preflight.mission_checks import mission_checks, rehearse
from gcs.model import NoticeCode
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import parse_scenario

VALLEY = """
name = "valley"
[frame]
lat_deg = 46.8
lon_deg = 9.8
alt_msl_m = 900.0
[map]
width_m = 3000.0
height_m = 3000.0
nodes_east = 61
nodes_north = 61
[planning]
shape = "flyable"
clearance_m = 0.0
[mission]
end = "land"
altitude_rel_m = 70.0
max_duration_s = 600.0
[takeoff]
heading_deg = 0.0
[airframe]
speed_m_s = 15.0
bank_deg = 35.0
climb_m_s = 4.0
sink_m_s = 3.0
[simulation]
forward_speed_m_s = 15.0
airframe = "banked"
px4 = {px4}
[[agents]]
system_id = 1
east_m = 1500.0
north_m = 600.0
course_deg = 0.0
[[births]]
east_m = 1500.0
north_m = 2300.0
[[simulation.targets]]
east_m = 1500.0
north_m = 2300.0
"""


def ridge(east, north):
    """Return a ridge of 300 m across the return route, a saddle in the east, and level ground at home."""
    saddle = np.exp(-(((east - 2400.0) / 400.0) ** 2))
    return 900.0 + 300.0 * np.exp(-0.5 * ((north - 1700.0) / 250.0) ** 2) * (1.0 - saddle)


def bowl(east, north):
    """Return a hollow whose rim is steeper than a landing on all sides."""
    away = np.hypot(east - 1500.0, north - 600.0)
    return 900.0 + 0.25 * np.maximum(away - 60.0, 0.0)


class Flight:
    def __init__(self, ground, px4=(), until_s=420.0, more=""):
        self.elevation = elevation_of(ground, 3000.0)
        text = VALLEY.format(px4=list(px4)) + more + terrain_table(self.elevation)
        self.notices = []
        self.at = []
        self.landed_s = {}
        run = VirtualRun(
            parse_scenario(text, "valley.toml"),
            1,
            on_event=lambda _: self.at.append((self.plane.east_m, self.plane.north_m, self.plane.alt_msl_m)),
            on_effect=lambda _, effect: self.notices.append(getattr(effect, "code", None)),
        )
        self.planes = run.vehicles
        self.plane = run.vehicles["vehicle:1"]
        for t_s in np.arange(10.0, until_s, 10.0):
            run.run(float(t_s))
            run.ended = False
            for name, plane in self.planes.items():
                if not plane.autopilot.flying:
                    self.landed_s.setdefault(name, float(t_s))
            if len(self.landed_s) == len(self.planes):
                break

    @property
    def agl_m(self):
        at = np.array(self.at)
        return at[:, 2] - self.elevation.heights_at(at[:, :2])


@pytest.mark.parametrize("px4", [(), (1,)])
def test_a_mission_over_a_ridge_comes_home_and_lands(px4):
    flight = Flight(ridge, px4)
    at = np.array(flight.at)
    away_m = np.hypot(at[:, 0] - 1500.0, at[:, 1] - 600.0)
    assert at[:, 1].max() > 2200.0
    assert away_m[-1] < 120.0
    assert flight.agl_m[-1] < 2.0
    is_home = away_m < 1100.0
    assert flight.agl_m[~is_home].min() > 40.0
    assert flight.agl_m[~is_home].max() < 130.0
    assert NoticeCode.MISSION_HELD_BACK not in flight.notices
    assert NoticeCode.NEAR_GROUND not in flight.notices


def test_where_no_approach_keeps_above_the_ground_the_mission_ends_on_a_circle_and_says_so():
    flight = Flight(bowl, until_s=200.0)
    assert NoticeCode.RETURN_ROUTE_PROBLEM in flight.notices
    assert flight.plane.autopilot.mission[-1].command == MAV_CMD_NAV_LOITER_UNLIM
    assert flight.agl_m[-1] > 40.0


SECOND = """
[[agents]]
system_id = 2
east_m = 1620.0
north_m = 560.0
course_deg = 0.0
[[births]]
east_m = 1900.0
north_m = 2400.0
[[simulation.targets]]
east_m = 1900.0
north_m = 2400.0
"""


def test_of_two_that_come_home_at_one_time_one_waits_on_the_circle_at_its_target():
    flight = Flight(ridge, (2,), until_s=560.0, more=SECOND)
    first_s, second_s = sorted(flight.landed_s.values())
    assert second_s - first_s >= 50.0
    waits = [
        (item, plane.autopilot.mission[k - 1])
        for plane in flight.planes.values()
        for k, item in enumerate(plane.autopilot.mission)
        if item.command == MAV_CMD_NAV_LOITER_TIME
    ]
    assert len(waits) == 1
    ((circle, before),) = waits
    assert circle.z == before.z
    metres = np.hypot(circle.x - before.x, (circle.y - before.y) * 0.684) * 1e-7 * 111_195.0
    assert metres == pytest.approx(40.0, abs=3.0)  # where it enters its circle
    assert circle.param3 == 1.0 or circle.param3 == pytest.approx(metres, abs=6.0)  # ArduPlane: its side
    assert NoticeCode.SEPARATION_LOST not in flight.notices
    assert NoticeCode.NEAR_GROUND not in flight.notices


@pytest.mark.parametrize(("ground", "is_refused"), [(ridge, False), (bowl, True)])
def test_preflight_refuses_a_landing_where_no_approach_keeps_above_the_ground(ground, is_refused):
    config = parse(VALLEY.format(px4=[]) + terrain_table(elevation_of(ground, 3000.0)), "valley.toml")
    codes = {row.code for row in mission_checks(config, rehearse(config, 1, {}))}
    assert (CheckCode.LANDING_INTO_GROUND in codes) == is_refused
