"""A vehicle would fly into what stands ahead of its runway, or turn close to the ground."""

import math
import re
from itertools import pairwise

import pytest
from helpers.noticed import noticed
from helpers.runway import ORDERS, Flight
from helpers.staging import S

from gcs.model import NoFlyZone, NoticeCode, UploadReport
from gcs.planning.map.line_of_sight import line_of_sight
from sim_vehicles.campaign.virtual_run import START_T_NS

TAKEOFF = 22
CLEAR_M = (1800.0, 1000.0)


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


@pytest.mark.parametrize(
    ("limits", "is_clear"),
    [
        ("height_m = 40.0", False),
        ('floor_m = 80.0\nreference = "home"', False),
        ('floor_m = 115.0\nreference = "home"', True),
    ],
)
def test_a_climb_is_kept_out_of_obstacles_that_routes_pass_above_and_may_pass_under_others(limits, is_clear):
    tables = f"[[map.obstacles]]\nbox_m = [1410.0, 1240.0, 1510.0, 1340.0]\n{limits}\n"
    flight = Flight(tables, boxes="").run(40.0)
    assert [alarm.code for alarm in flight.alarms()] == ([] if is_clear else [NoticeCode.TAKEOFF_BLOCKED])
    assert (flight.way[-1][2] > 50.0) is is_clear


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
