"""A user would lose half a minute to needless circles, or a vehicle to a turn into an obstacle."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.planning.forward_simulation import Motion
from gcs.planning.map.grid import free_grid
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.planner_inputs import AgentState, PlanOptions
from gcs.planning.route_joining import capture_length_m, has_explicit_turn, turn_around_s
from gcs.planning.team_routes import plan_routes
from sim_vehicles.vehicle.guidance import ToPoint
from sim_vehicles.vehicle.paper_airframe import Airframe

OPEN = free_grid((51, 51), 40.0)
RADIUS_M, LAG_S = 58.0, 2.8
CORNERS = TurnAnticipation(40.0, 42.0, 5.0)


def by_itself(grid, motion, *points, clearance_m=0.0):
    horizon_s = turn_around_s(motion, RADIUS_M, LAG_S)
    return capture_length_m(grid, motion, np.array(points), CORNERS, horizon_s, LAG_S, clearance_m)


def test_straight_ahead_is_as_long_as_it_is():
    assert by_itself(OPEN, Motion(200.0, 400.0, 15.0, math.pi / 2.0), (900.0, 400.0)) == pytest.approx(700.0)


@given(st.floats(-2.7, 2.7), st.floats(200.0, 800.0))
def test_the_simulated_airframe_needs_what_was_expected(bearing_rad, distance_m):
    airframe = Airframe(1000.0, 1000.0, 100.0, 0.0, 15.0)
    goal = (1000.0 + distance_m * math.sin(bearing_rad), 1000.0 + distance_m * math.cos(bearing_rad))
    expected_m = by_itself(OPEN, Motion(1000.0, 1000.0, 15.0, 0.0), goal)
    leg = ToPoint(*goal, goal[0] - 1000.0, goal[1] - 1000.0, 5.0)
    flown_m = 0.0
    while not leg.is_reached(airframe) and flown_m < 3000.0:
        airframe.step(leg.heading_error_rad(airframe), 100.0, 15.0)
        flown_m += 0.15
    assert flown_m == pytest.approx(expected_m, abs=40.0)


def test_a_turn_into_an_obstacle_is_none():
    north, south = (1000.0, 1400.0), (1000.0, 600.0)
    east = Motion(1000.0, 1000.0, 15.0, math.pi / 2.0)
    grid = OPEN.with_obstacles(cells=[(row, col) for col in (26, 27, 28) for row in (26, 27)])
    assert by_itself(grid, east, north) == math.inf
    assert by_itself(grid, east, south) < 500.0
    assert by_itself(OPEN, east, north) == pytest.approx(by_itself(OPEN, east, south))


def test_a_turn_that_comes_too_near_is_none():
    grid = OPEN.with_obstacles(cells=[(24, col) for col in range(51)])
    east, target = Motion(200.0, 1060.0, 15.0, math.pi / 2.0), (400.0, 985.0)
    assert by_itself(grid, east, target, clearance_m=10.0) < math.inf
    assert by_itself(grid, east, target, clearance_m=80.0) == math.inf
    near = Motion(200.0, 990.0, 15.0, math.pi / 2.0)
    assert by_itself(grid, near, (400.0, 1060.0), clearance_m=80.0) < math.inf


def test_an_explicit_turn_begins_on_the_course():
    grid = OPEN.with_obstacles(cells=[(row, col) for col in range(24, 30) for row in (27, 28)])
    options = PlanOptions(clearance_m=40.0, shape="flyable", turn_radius_m=RADIUS_M)
    ahead, behind = (
        AgentState(1000.0, 1000.0, math.pi / 2.0, 15.0),
        AgentState(1000.0, 1000.0, -math.pi / 2.0, 15.0),
    )
    for start, explicit in ((ahead, False), (behind, True)):
        (route,) = plan_routes(grid, {1: start}, {(0, 0): (1900.0, 1010.0)}, {}, options).routes
        assert has_explicit_turn(start, route.points_m) is explicit
