"""A user would lose aircraft: a route that begins where its vehicle never comes leads it into obstacles."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gcs.geo import wrap_pi
from gcs.planning.forward_simulation import LoiterCircle, Motion, RemainingMission, predict_motion, simulate
from gcs.planning.map.grid import free_grid
from sim_vehicles.vehicle.guidance import Circle as Flown
from sim_vehicles.vehicle.guidance import ToPoint
from sim_vehicles.vehicle.paper_airframe import TURN_TIME_S, Airframe

OPEN = free_grid((51, 51), 40.0)
EAST = math.pi / 2.0


def test_a_route_starts_where_its_vehicle_will_take_it_up_but_never_beyond_an_obstacle():
    grid = free_grid((11, 11), 40.0).with_obstacles(cells=[(5, 5)])
    assert predict_motion(grid, Motion(20.0, 40.0, 15.0, EAST), 2.0).place_m == pytest.approx((50.0, 40.0))
    east_m, north_m = predict_motion(grid, Motion(150.0, 200.0, 15.0, EAST), 3.0).place_m
    assert 160.0 < east_m < 170.0
    assert north_m == pytest.approx(200.0)
    assert predict_motion(grid, Motion(178.0, 200.0, 15.0, EAST), 3.0).place_m == (178.0, 200.0)


def test_who_circles_turns_on():
    there = predict_motion(OPEN, Motion(1000.0, 1000.0, 15.0, 0.0, 0.25), 4.0)
    assert there.course_rad == pytest.approx(1.0)
    on_circle = (1060.0 - 60.0 * math.cos(1.0), 1000.0 + 60.0 * math.sin(1.0))
    assert there.place_m == pytest.approx(on_circle, abs=0.1)


def test_who_circles_in_wind_turns_on_and_drifts():
    """Its circle is not known. It was predicted to stand still: its first mission led into an obstacle."""
    wind_m_s = 3.0, -2.0
    there = predict_motion(OPEN, Motion(1000.0, 1000.0, 13.0, 0.0, 0.25), 4.0, 1.0, wind_m_s, 20.0)
    course_rad, airspeed = math.atan2(-3.0, 15.0), math.hypot(3.0, 15.0)  # through the air
    radius_m, turned_rad = airspeed / 0.25, course_rad + 1.0
    east_m = 1012.0 + radius_m * (math.cos(course_rad) - math.cos(turned_rad))
    north_m = 992.0 + radius_m * (math.sin(turned_rad) - math.sin(course_rad))
    assert there.place_m == pytest.approx((east_m, north_m), abs=0.1)


def test_a_report_that_is_old_is_brought_up_to_now():
    old = Motion(1000.0, 1000.0, 15.0, EAST, age_s=2.0)
    assert predict_motion(OPEN, old, 1.0).place_m == pytest.approx((1045.0, 1000.0))


@given(st.floats(-2.5, 2.5), st.floats(80.0, 400.0), st.floats(-2.0, 2.0), st.floats(1.0, 5.0))
def test_the_simulated_airframe_is_where_it_was_expected(bearing_rad, distance_m, next_rad, ahead_s):
    """Through a turn to a waypoint, and on from there to the next, as its guidance flies it."""
    airframe = Airframe(1000.0, 1000.0, 100.0, 0.0, 15.0)
    first = (1000.0 + distance_m * math.sin(bearing_rad), 1000.0 + distance_m * math.cos(bearing_rad))
    second = (
        first[0] + 300.0 * math.sin(bearing_rad + next_rad),
        first[1] + 300.0 * math.cos(bearing_rad + next_rad),
    )
    ahead = RemainingMission((first, second), (45.0, 10.0))
    there = predict_motion(OPEN, Motion(1000.0, 1000.0, 15.0, 0.0, ahead=ahead), ahead_s, TURN_TIME_S)
    goal = ToPoint(*first, first[0] - 1000.0, first[1] - 1000.0, 45.0)
    for _ in range(round(ahead_s * 100)):
        if goal.is_reached(airframe):
            goal = ToPoint(*second, second[0] - first[0], second[1] - first[1], 10.0)
        airframe.step(goal.heading_error_rad(airframe), 100.0, 15.0)
    assert math.dist(there.place_m, (airframe.east_m, airframe.north_m)) < 8.0
    assert abs(wrap_pi(there.course_rad - airframe.heading_rad)) < math.radians(15.0)


def test_a_circling_airframe_is_where_it_was_expected():
    airframe = Airframe(1060.0, 1000.0, 100.0, math.pi, 15.0)
    goal = Flown(1000.0, 1000.0, 60.0)
    for _ in range(1000):
        airframe.step(goal.heading_error_rad(airframe), 100.0, 15.0)
    motion = Motion(airframe.east_m, airframe.north_m, 15.0, airframe.heading_rad, 15.0 / 60.0)
    there = predict_motion(OPEN, motion, 3.0)
    for _ in range(300):
        airframe.step(goal.heading_error_rad(airframe), 100.0, 15.0)
    assert math.dist(there.place_m, (airframe.east_m, airframe.north_m)) < 3.0
    assert abs(wrap_pi(there.course_rad - airframe.heading_rad)) < math.radians(5.0)


@given(
    st.tuples(st.floats(-1.5, 1.5), st.floats(80.0, 400.0)),
    st.tuples(st.floats(-1.5, 1.5), st.floats(80.0, 300.0)),
    st.tuples(st.floats(0.0, 145.0), st.floats(-math.pi, math.pi)),
)
def test_the_simulated_airframe_flies_the_end_of_a_mission_as_it_was_expected(first, second, aside):
    """Through two waypoints and round a circle near the last: never far from the forward simulation."""
    first_m = (first[1] * math.sin(first[0]), first[1] * math.cos(first[0]))
    course = first[0] + second[0]
    last_m = (first_m[0] + second[1] * math.sin(course), first_m[1] + second[1] * math.cos(course))
    circle = LoiterCircle(
        (last_m[0] + aside[0] * math.sin(aside[1]), last_m[1] + aside[0] * math.cos(aside[1])), 30.0
    )
    begin = Motion(
        0.0, 0.0, 15.0, 0.0, ahead=RemainingMission((first_m, last_m), (45.0, 10.0), circle=circle)
    )
    for_s = (first[1] + second[1]) / 15.0 + 30.0
    flight = simulate(OPEN, begin, for_s, TURN_TIME_S)
    assume(flight.max_bearing_error_rad < math.radians(150.0))  # it may turn to either way
    airframe, goals = Airframe(0.0, 0.0, 100.0, 0.0, 15.0), [
        ToPoint(*first_m, *first_m, 45.0),
        ToPoint(*last_m, last_m[0] - first_m[0], last_m[1] - first_m[1], 10.0),
        Flown(*circle.centre_m, circle.radius_m),
    ]  # fmt: skip
    for _ in range(round(for_s)):
        for _ in range(100):
            if len(goals) > 1 and goals[0].is_reached(airframe):
                goals.pop(0)
            airframe.step(goals[0].heading_error_rad(airframe), 100.0, 15.0)
        offset_m = np.hypot(*(flight.states[:, :2] - (airframe.east_m, airframe.north_m)).T).min()
        assert offset_m < 20.0
