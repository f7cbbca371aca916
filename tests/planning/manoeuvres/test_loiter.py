"""A user would lose aircraft at their targets: a fixed wing cannot stop, and targets are where they like."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.model import NoticeCode
from gcs.planning.forward_simulation import LoiterCircle, Motion, RemainingMission, simulate
from gcs.planning.manoeuvres import loiter
from gcs.planning.map.grid import free_grid, random_obstacles
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.planner_inputs import AgentState, LoiterSpec, PlanOptions
from gcs.planning.team_routes import plan_routes
from sim_vehicles.vehicle.guidance import Circle, ToPoint
from sim_vehicles.vehicle.paper_airframe import Airframe

OPEN = free_grid((51, 51), 40.0)
CORNERS = TurnAnticipation(40.0, 42.0, 10.0)
NEAR_M, LOITER_M = 40.0, 30.0
OPTIONS = PlanOptions(
    clearance_m=50.0,
    shape="flyable",
    turn_radius_m=58.0,
    loiter=LoiterSpec(radius_m=40.0, reach_radius_m=NEAR_M, turn_lag_s=2.8, turns=CORNERS),
)
EAST = math.pi / 2.0


def planned(grid, target_m, start_m=(300.0, 1000.0), course_rad=EAST, options=OPTIONS):
    start = AgentState(*start_m, course_rad)
    result = plan_routes(grid, {1: start}, {(0, 0): target_m}, {}, options)
    return result.routes[0], result


def flown(route, start_m=(300.0, 1000.0), course_rad=EAST, waits_s=40.0):
    """Fly a route as the simulated vehicle does, and round its circle; yields places, 0.1 s apart."""
    airframe, at_m = Airframe(*start_m, 100.0, course_rad, 15.0), start_m
    points = [start_m, *map(tuple, route.points_m.tolist())]
    radii_m = CORNERS.accept_radii_m(np.array(points))
    goals = [
        ToPoint(*b, b[0] - a[0], b[1] - a[1], radius_m)
        for (a, b), radius_m in zip(pairwise(points), radii_m.tolist(), strict=True)
    ]
    goals.append(Circle(*route.flown_m[-1].tolist(), LOITER_M))
    left_s = waits_s
    while left_s > 0.0:
        while len(goals) > 1 and goals[0].is_reached(airframe):
            goals.pop(0)
        if len(goals) == 1:
            left_s -= 0.1
        for _ in range(10):
            airframe.step(goals[0].heading_error_rad(airframe), 100.0, 15.0)
        at_m = airframe.east_m, airframe.north_m
        yield at_m


TIGHT = {NoticeCode.TIGHTEST_TURN, NoticeCode.SHARP_CORNERS, NoticeCode.ROUTE_NEAR_OBSTACLES}
GRAZED_M = 1.0
"""Depth in an obstacle that counts as touching it: a simulated vehicle keeps to a leg within so much."""


def is_inside(grid, place_m, grazed_m=0.0):
    node = grid.node_of(place_m)
    middle_m = grid.point_of(node)
    depth_m = 0.5 * grid.spacing_m - max(abs(a - b) for a, b in zip(place_m, middle_m, strict=True))
    return bool(grid.blocked[node]) and grid.contains(place_m) and depth_m > grazed_m


def time_near_s(places, target_m):
    return 0.1 * sum(math.dist(place, target_m) <= NEAR_M for place in places)


def test_in_the_open_a_vehicle_circles_where_its_route_ends():
    for grid in (OPEN, OPEN.with_obstacles(discs_m=[(300.0, 1700.0, 60.0)])):
        route, result = planned(grid, (1200.0, 1000.0))
        assert route.wait_m is None
        assert route.points_m[-1].tolist() == [1200.0, 1000.0]
        assert not result.stops_short


def test_before_a_wall_a_vehicle_passes_its_target_and_loiters_where_it_is_clear():
    grid = OPEN.with_obstacles(boxes_m=[(1270.0, 400.0, 1400.0, 1600.0)])
    target_m = (1220.0, 1000.0)
    route, result = planned(grid, target_m)
    assert route.wait_m is not None
    assert not result.stops_short
    places = list(flown(route))
    assert not any(is_inside(grid, place) for place in places)
    assert time_near_s(places, target_m) > 2.0
    straight, _ = planned(grid, target_m, options=replace(OPTIONS, loiter=None))
    assert any(is_inside(grid, place) for place in flown(straight))


def test_a_target_over_an_obstacle_is_passed_next_to_it():
    grid = OPEN.with_obstacles(cells=[(25, 30)])
    target_m = (1200.0, 1000.0)
    route, result = planned(grid, target_m, options=replace(OPTIONS, clearance_m=25.0))
    assert not result.stops_short
    places = list(flown(route))
    assert not any(is_inside(grid, place) for place in places)
    assert time_near_s(places, target_m) > 2.0
    assert planned(grid, target_m)[1].stops_short == {1}  # 8 m are less than a quarter of 50


def test_no_agent_passes_a_target_without_a_clear_route():
    walls = [(20, col) for col in range(26, 35)] + [(30, col) for col in range(26, 35)]
    walls += [(row, 34) for row in range(20, 31)] + [(row, 26) for row in (*range(20, 25), *range(26, 31))]
    grid = OPEN.with_obstacles(cells=walls, boxes_m=[(1160.0, 820.0, 1340.0, 1180.0)])
    route, result = planned(grid, (1250.0, 1000.0))
    assert result.stops_short == {1}
    assert NoticeCode.LOITERS_SHORT in {note.code for note in result.notes}
    assert not any(is_inside(grid, place) for place in flown(route))


@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.floats(1000.0, 1700.0), st.floats(300.0, 1700.0)),
    st.floats(-math.pi, math.pi),
)
def test_among_random_obstacles_no_end_leads_into_one(seed, target_m, course_rad):
    """As the simulated airframe flies it; routes that are said to be tight are left out."""
    start_m = (300.0, 1000.0)
    rng = np.random.default_rng(seed)
    grid = random_obstacles(OPEN, 0.05, rng, keep_clear=[start_m], keep_clear_m=200.0)
    route, result = planned(grid, target_m, start_m, course_rad)
    if {note.code for note in result.notes} & TIGHT:
        return
    places = list(flown(route, start_m, course_rad))
    assert not any(is_inside(grid, place, GRAZED_M) for place in places)
    if not result.stops_short:
        assert time_near_s(places, target_m) >= 1.5


@given(st.sampled_from([8.0, 15.0, 30.0]), st.floats(0.5, 4.0), st.floats(20.0, 60.0), st.floats(1.0, 4.0))
def test_a_circle_entered_over_its_centre_needs_no_more_than_its_room(speed_m_s, lag_s, bank_deg, wider):
    turn_radius_m = speed_m_s**2 / (9.81 * math.tan(math.radians(bank_deg)))
    circle = LoiterCircle((0.0, 0.0), wider * turn_radius_m)
    ahead = RemainingMission(((0.0, 0.0),), (10.0,), circle=circle)
    motion = Motion(0.0, -500.0, speed_m_s, 0.0, 0.0, 0.0, ahead)
    room_m = loiter.room_to_circle_m(
        circle.radius_m, TurnAnticipation(turn_radius_m, speed_m_s * lag_s, 10.0)
    )
    for lag, min_radius_m in ((lag_s, turn_radius_m), (0.5 * lag_s, 0.0)):
        states = simulate(
            OPEN, motion, (500.0 + 20.0 * circle.radius_m) / speed_m_s, lag, 0.0, min_radius_m
        ).states
        assert np.hypot(*states[states[:, 4] >= 1.0, :2].T).max() <= room_m


def test_without_a_clearance_an_end_with_room_costs_no_search(monkeypatch):
    """A plan for a hundred vehicles took twice as long as the routes alone."""
    options = replace(OPTIONS, clearance_m=0.0)
    grid = OPEN.with_obstacles(discs_m=[(1200.0, 1180.0, 40.0), (700.0, 1020.0, 40.0)])
    searched = planned(
        grid.with_obstacles(discs_m=[(1200.0, 860.0, 40.0)]), (1200.0, 1000.0), options=options
    )
    assert searched[0].points_m[-1].tolist() == [1200.0, 1000.0]
    monkeypatch.setattr(loiter, "_CircleSearch", None)
    route, result = planned(grid, (1200.0, 1000.0), options=options)
    assert route.wait_m is None
    assert not result.stops_short
    with pytest.raises(TypeError):
        planned(grid.with_obstacles(discs_m=[(1200.0, 860.0, 40.0)]), (1200.0, 1000.0), options=options)


def test_what_a_vehicle_waits_on_does_not_hang_on_where_the_map_begins():
    target_m = (1220.0, 1000.0)
    grid = OPEN.with_obstacles(boxes_m=[(1270.0, 400.0, 1400.0, 1600.0)])
    moved = type(grid)((5000.0, -3000.0), 40.0, grid.blocked)
    here, _ = planned(grid, target_m)
    there, _ = planned(moved, (6220.0, -2000.0), (5300.0, -2000.0))
    assert np.array(there.wait_m) - (5000.0, -3000.0) == pytest.approx(here.wait_m, abs=1e-6)


def test_a_target_that_no_approach_passes_costs_a_bounded_search(monkeypatch):
    """A plan that takes seconds holds up heartbeats and uploads of all vehicles."""
    searches = []

    class Search(loiter._CircleSearch):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            self.passing = 0
            searches.append(self)

        def best(self, points_m, so_far, *, must_pass=True):
            found = super().best(points_m, so_far, must_pass=must_pass)
            self.passing = self.flights if must_pass else self.passing
            return found

    monkeypatch.setattr(loiter, "_CircleSearch", Search)
    rng = np.random.default_rng(18)
    grid = random_obstacles(OPEN, 0.05, rng, keep_clear=[(300.0, 1000.0)], keep_clear_m=200.0)
    target_m = tuple(rng.uniform(600.0, 1700.0, 2))
    options = replace(OPTIONS, loiter=replace(OPTIONS.loiter, reach_radius_m=0.01))
    planned(grid, target_m, options=options)
    flights_of_one_approach = 4 * (1 + 1 + 5 * 12)
    assert loiter._MAX_FLIGHTS <= searches[0].passing <= loiter._MAX_FLIGHTS + flights_of_one_approach
