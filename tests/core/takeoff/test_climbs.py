"""A vehicle would fly into what stands ahead of its runway, or turn close to the ground."""

import math
import re
from dataclasses import replace
from itertools import pairwise

import pytest
from noticed import alarms, noticed
from staging import S

from gcs.mavlink.frames.codec import decode
from gcs.model import NoFlyZone, NoticeCode, Order, Send, UploadReport
from gcs.planning.map.line_of_sight import line_of_sight
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import parse_scenario
from sim_vehicles.world.specs import vehicle_specs

TAKEOFF = 22
# The field of a flight with ArduPlane: it flew 45 m deep through the box ahead of the runway.
FIELD = """
name = "runway"
[frame]
lat_deg = -35.372275
lon_deg = 149.148714
alt_msl_m = 584.0
[map]
width_m = 3000.0
height_m = 3000.0
nodes_east = 76
nodes_north = 76
boxes_m = [[1410.0, 1240.0, 1510.0, 1340.0]]
[[agents]]
system_id = 1
east_m = 1500.0
north_m = 1000.0
course_deg = 353.0
[[births]]
east_m = 2600.0
north_m = 2500.0
[airframe]
speed_m_s = 22.0
bank_deg = 35.0
[planning]
clearance_m = 60.0
shape = "flyable"
[mission]
altitude_rel_m = 90.0
layers = 1
accept_radius_m = 30.0
loiter_radius_m = 80.0
[simulation]
forward_speed_m_s = 22.0
parameters = { ARMING_DELAY_S = 1.0 }
[[simulation.targets]]
east_m = 2600.0
north_m = 2500.0
"""
BOX = "boxes_m = [[1410.0, 1240.0, 1510.0, 1340.0]]"
CLEAR_M = (1800.0, 1000.0)
ORDERS = ((3.0, "hold"), (6.0, "resume"), (15.0, "arm"))


class Flight:
    """A virtual flight of one vehicle from the ground."""

    def __init__(self, tables="", orders=ORDERS, *, px4=False, place_m=None, boxes=BOX, field=FIELD):
        scenario = parse_scenario(field.replace(BOX, boxes) + tables, "runway.toml")
        self.effects, self.way = [], []
        orders = [
            Order(START_T_NS + round(at * S), f"{what}-{at}", what, None, None, *area)
            for at, what, *area in orders
        ]
        self.run_ = VirtualRun(
            scenario, 1, None, lambda _, effect: self.effects.append(effect), orders=orders
        )
        (spec,) = vehicle_specs(scenario, 1)
        spec = replace(spec, airborne=False, autopilot="px4" if px4 else "ardupilot")
        if place_m is not None:
            spec = replace(spec, east_m=place_m[0], north_m=place_m[1])
        self.plane = SimVehicle(spec, scenario.frame, START_T_NS)
        self.run_.vehicles = {"vehicle:1": self.plane}

    def run(self, until_s):
        while self.run_.t_ns < START_T_NS + until_s * S:
            self.run_.run((self.run_.t_ns - START_T_NS) / S + 0.2)
            self.way.append((self.plane.east_m, self.plane.north_m, self.plane.alt_rel_m))
        return self

    def all(self, kind):
        return [effect for effect in self.effects if isinstance(effect, kind)]

    def items(self):
        """Mission items that were sent, by upload."""
        sent = [m for effect in self.all(Send) for m in decode(effect.data)[0]]
        return [m for m in sent if m.get_type() == "MISSION_ITEM_INT"]

    def alarms(self):
        return alarms(self.effects)


@pytest.mark.parametrize("px4", [False, True])
def test_no_mission_goes_to_a_vehicle_whose_climb_leads_into_an_obstacle(px4):
    flight = Flight(px4=px4).run(40.0)
    (alarm,) = flight.alarms()
    assert alarm.code is NoticeCode.TAKEOFF_BLOCKED
    reason = alarm.parameters["reason"]
    assert reason.startswith("the climb comes within 60 m")
    assert re.search(r"16[0-9] m from where it stands", reason)
    assert "lower takeoff.altitude_rel_m" in reason
    assert not flight.items()
    assert flight.way[-1][2] == 0.0


def test_a_low_take_off_altitude_turns_before_the_obstacle_and_climbs_on_along_the_route():
    flight = Flight("[takeoff]\naltitude_rel_m = 20.0\n").run(75.0)
    _, takeoff, *route = flight.items()
    assert (takeoff.command, takeoff.z) == (TAKEOFF, 20.0)
    assert {item.z for item in route} == {90.0}
    grid = flight.run_.engine.grid
    assert all(line_of_sight(grid, place, place, 20.0) for *place, _ in flight.way)
    assert flight.way[-1][2] > 80.0


@pytest.mark.parametrize("px4", [False, True])
def test_a_take_off_ends_where_the_route_begins(px4):
    """PX4 flies towards the place of its take-off: at the first waypoint it would turn on the runway."""
    flight = Flight(px4=px4, place_m=CLEAR_M).run(20.0)
    takeoff, first = flight.items()[0 if px4 else 1 :][:2]
    assert takeoff.command == TAKEOFF
    frame = flight.run_.scenario.frame
    east_m, north_m = frame.to_local(takeoff.x * 1e-7, takeoff.y * 1e-7)
    assert math.degrees(math.atan2(east_m - CLEAR_M[0], north_m - CLEAR_M[1])) == pytest.approx(-7.0, abs=1.5)
    assert 270.0 < math.dist((east_m, north_m), CLEAR_M) < 320.0
    assert frame.to_local(first.x * 1e-7, first.y * 1e-7)[1] > north_m
    assert not flight.alarms()


def test_a_new_mission_waits_for_the_end_of_the_climb():
    """In its place the vehicle would turn where it is: a few metres above the ground."""
    area = NoFlyZone("tower", disc_m=(2250.0, 2000.0, 100.0))
    flight = Flight(place_m=CLEAR_M, orders=[*ORDERS, (20.0, "no-fly-zone", area)]).run(60.0)
    reports = flight.all(UploadReport)
    assert [report.ok for report in reports] == [True, True]
    said = noticed(flight.effects, NoticeCode.AUTOPILOT_INFO)
    climbed = next(n.t_ns for n in said if n.parameters["said"].startswith("Takeoff complete"))
    assert reports[1].t_ns - round(reports[1].duration_s * S) >= climbed > START_T_NS + 20 * S
    # It turns no lower than the altitude of its take-off.
    low = [(east_m, north_m) for east_m, north_m, height_m in flight.way if 0.0 < height_m < 60.0]
    courses = [math.atan2(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(low)]
    assert max(courses) - min(courses) < math.radians(10.0)


def test_an_area_closed_ahead_of_the_runway_takes_the_mission_away():
    area = NoFlyZone("crane", disc_m=(1775.0, 1200.0, 40.0))
    flight = Flight(place_m=CLEAR_M, orders=[*ORDERS[:2], (12.0, "no-fly-zone", area), (20.0, "arm")]).run(
        40.0
    )
    assert [report.ok for report in flight.all(UploadReport)] == [True]
    assert noticed(flight.effects, NoticeCode.TAKEOFF_BLOCKED)
    assert flight.way[-1][2] == 0.0


def test_a_first_turn_into_an_obstacle_is_refused_once():
    """The climb ends 60 m before a wall: too near to turn."""
    wall = "boxes_m = [[1560.0, 1400.0, 1960.0, 1440.0]]"
    flight = Flight(place_m=CLEAR_M, boxes=wall).run(40.0)
    (alarm,) = flight.alarms()
    assert alarm.code is NoticeCode.MISSION_HELD_BACK
    assert alarm.parameters["reason"].startswith("the take-off is not clear: the first turn")
    assert len(flight.all(UploadReport)) > 1
    assert not flight.items()
