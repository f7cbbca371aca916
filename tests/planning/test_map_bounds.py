"""A vehicle would not be re-tasked: a mission with a waypoint off the map or in a blocked cell is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.grid_paths import distances_m
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import NoticeCode
from gcs.planning.manoeuvres.landing import LandingSpec, plan_return_route
from gcs.planning.map.grid import free_grid, random_obstacles
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.plan_notes import PlanNote
from gcs.planning.planner_inputs import AgentState, LoiterSpec, PlanOptions, TargetDemand
from gcs.planning.team_routes import plan_routes

CORNERS = TurnAnticipation(58.0, 42.0, 10.0)
FLYABLE = PlanOptions(
    shape="flyable",
    clearance_m=50.0,
    turn_radius_m=58.0,
    horizon_s=40.0,
    loiter=LoiterSpec(60.0, 40.0, 2.8, CORNERS),
    turns=CORNERS,
    turn_lag_s=2.8,
)
OPTIONS = st.builds(
    replace,
    st.just(FLYABLE),
    shape=st.sampled_from(["grid", "pulled", "flyable", "flyable", "flyable"]),
    clearance_m=st.sampled_from([0.0, 25.0, 50.0, 60.0]),
)
ROUNDING = 1e-9


@st.composite
def maps(draw):
    """Random obstacles on a small map, so that routes are near its edges."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    grid = free_grid(draw(st.tuples(st.integers(3, 16), st.integers(3, 16))), 40.0, (-300.0, 70.0))
    grid = random_obstacles(grid, draw(st.sampled_from([0.0, 0.1, 0.25])), rng)
    return grid, rng


def anywhere(grid, rng, beyond_m=0.0):
    """A place on the map, or up to a distance beyond its edges."""
    low_m = np.array(grid.origin_m) - 0.5 * grid.spacing_m - beyond_m
    size_m = grid.spacing_m * np.array(grid.shape[::-1]) + 2.0 * beyond_m
    return tuple((low_m + rng.random(2) * size_m).tolist())


def is_on_map(grid, place_m):
    x, y = (np.array(place_m) - grid.origin_m) / grid.spacing_m
    rows, cols = grid.shape
    return -0.5 - ROUNDING <= x <= cols - 0.5 + ROUNDING and -0.5 - ROUNDING <= y <= rows - 0.5 + ROUNDING


def is_free(grid, place_m):
    return is_on_map(grid, place_m) and not grid.blocked[grid.node_of(place_m)]


def waypoints(result):
    """Every place of routes, those without an explicit first turn and the centres of circles too."""
    routes = [*result.routes, *result.captured.values()]
    circles = [route.wait_m for route in routes if route.wait_m is not None]
    return [*circles, *(tuple(place) for route in routes for place in route.points_m.tolist())]


@settings(max_examples=400, deadline=None, derandomize=True)
@given(
    maps(), OPTIONS, st.floats(-math.pi, math.pi), st.sampled_from([0.0, 90.0]), st.sampled_from([0.0, 90.0])
)
def test_no_waypoint_lies_off_the_map_or_in_a_blocked_cell(
    drawn, options, course_rad, start_beyond_m, target_beyond_m
):
    grid, rng = drawn
    start_m, target_m = anywhere(grid, rng, start_beyond_m), anywhere(grid, rng, target_beyond_m)
    velocity_m_s = tuple(rng.normal(0.0, 5.0, 2).tolist())
    result = plan_routes(
        *(grid, {1: AgentState(*start_m, course_rad)}, {(0, 0): target_m}, {}, options),
        demands={(0, 0): TargetDemand(velocity_m_s)},
    )
    places = waypoints(result)
    assert [place for place in places if not is_free(grid, place)] == []
    ends = grid.node_of(start_m), grid.node_of(target_m)
    if not grid.blocked[ends[0]] and math.isfinite(distances_m(grid, ends[0])[ends[1]]):
        no_circle = NoticeCode.NO_CLEAR_LOITER in {note.code for note in result.notes}
        assert [route.vehicle for route in result.routes] == ([] if no_circle else [1])


@pytest.mark.parametrize("shape", ["grid", "pulled", "flyable"])
def test_a_vehicle_outside_the_map_is_led_back_in(shape):
    grid = free_grid((21, 21), 40.0)
    for place_m, course_rad in (((400.0, 860.0), 0.0), ((-90.0, 400.0), -1.5), ((900.0, -70.0), 2.0)):
        agents = {1: AgentState(*place_m, course_rad)}
        result = plan_routes(grid, agents, {(0, 0): (410.0, 790.0)}, {}, replace(FLYABLE, shape=shape))
        assert result.routes[0].points_m[-1].tolist() == [410.0, 790.0]
        assert all(is_on_map(grid, place) for place in waypoints(result))


@pytest.mark.parametrize("shape", ["grid", "pulled", "flyable"])
def test_a_target_outside_the_map_is_approached_to_the_nearest_point_inside_with_a_note(shape):
    grid = free_grid((21, 21), 40.0)
    for target_m, end_m in (((871.0, 400.0), (820.0, 400.0)), ((-80.0, -300.0), (-20.0, -20.0))):
        agents, options = {1: AgentState(400.0, 400.0, 0.0)}, replace(FLYABLE, shape=shape)
        result = plan_routes(grid, agents, {(0, 0): target_m}, {}, options)
        assert result.routes[0].points_m[-1].tolist() == list(end_m)
        assert result.notes == (PlanNote(NoticeCode.TARGET_OUTSIDE_MAP, None, {"target": "T0.0"}),)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(maps(), st.sampled_from([0.0, 25.0]))
def test_no_landing_is_begun_outside_the_map(drawn, clearance_m):
    _, rng = drawn
    grid = random_obstacles(free_grid((31, 21), 40.0), float(rng.choice([0.0, 0.05])), rng)
    free = np.argwhere(~grid.blocked)
    home_m, target_m = (grid.point_of(tuple(rng.choice(free))) for _ in range(2))
    options = replace(FLYABLE, loiter=None, clearance_m=clearance_m)
    start = AgentState(*home_m, 0.0)
    for route in plan_routes(grid, {1: start}, {(0, 0): target_m}, {}, options).routes:
        landing = plan_return_route(
            grid, start, route.points_m, home_m, options, LandingSpec(CORNERS, options.turn_lag_s)
        )
        assert all(is_on_map(grid, place) for place in landing.points_m.tolist())
