"""Vehicles whose heights come together would meet, although a way round each other is short."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.planning.map.grid import free_grid
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.planner import plan_mission
from gcs.planning.planner_inputs import (
    AgentState,
    LoiterSpec,
    MissionInputs,
    PlanOptions,
    TargetDemand,
)
from gcs.planning.terrain.band import make_band
from gcs.planning.terrain.detour import AvoidedFlight, band_beside
from gcs.planning.terrain.ground import Terrain
from gcs.terrain.elevation_grid import Elevation

GRID = free_grid((61, 61), 50.0)
LEVEL = Elevation((-500.0, -500.0), 20.0, np.full((201, 201), 400.0))
TURNS = TurnAnticipation(40.0, 15.0, 10.0)
OPTIONS = PlanOptions(
    shape="flyable",
    clearance_m=20.0,
    turns=TURNS,
    loiter=LoiterSpec(60.0, 60.0, 1.0, TURNS),
    climb_gradient=0.2,
    sink_gradient=0.17,
)
SEPARATION_M = 60.0
MIN_HEIGHT_M = 10.0
EAST, WEST = math.radians(90.0), math.radians(270.0)


def agent(east_m, north_m, course_rad):
    return AgentState(east_m, north_m, course_rad, 15.0, height_msl_m=458.0)


def plan(agents, targets, *, max_agl_m=66.0, layers=1, demands=None):
    """Return the plan of a mission over level ground, with a band too low for two heights."""
    return plan_mission(
        MissionInputs(
            GRID,
            replace(OPTIONS, horizon_s=120.0),
            layers,
            SEPARATION_M,
            {v: replace(one, pinned=(0, v)) for v, one in agents.items()},
            {(0, v): place_m for v, place_m in targets.items()},
            dict.fromkeys(agents, layers - 1),
            demands=demands or {},
            terrain=Terrain(LEVEL, 50.0, max_agl_m, layers),
            min_height_m=MIN_HEIGHT_M,
        )
    )


def flown(route, start, speed_m_s=15.0):
    """Return the positions of a vehicle each second until the end of its route."""
    points_m = np.vstack(((start.east_m, start.north_m), route.flown_m))
    along_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points_m, axis=0).T))))
    at_m = np.arange(0.0, along_m[-1], speed_m_s)
    return np.column_stack([np.interp(at_m, along_m, axis) for axis in points_m.T])


def least_m(result, agents):
    """Return the least distance of two vehicles while both fly."""
    one, other = (flown(route, agents[route.vehicle]) for route in result.routes)
    both = min(len(one), len(other))
    return float(np.hypot(*(one[:both] - other[:both]).T).min())


HEAD_ON = {1: agent(700.0, 1500.0, EAST), 2: agent(2300.0, 1500.0, WEST)}
PAST_EACH_OTHER = {1: (2500.0, 1500.0), 2: (500.0, 1500.0)}


def test_two_that_meet_head_on_at_one_height_fly_round_each_other():
    result = plan(HEAD_ON, PAST_EACH_OTHER)
    assert result.conflicts == ()
    assert least_m(result, HEAD_ON) > SEPARATION_M
    longer_m = sum(route.length_m for route in result.routes) - 2 * 1800.0
    assert longer_m < 150.0


def test_with_room_for_two_heights_neither_flies_a_detour():
    result = plan(HEAD_ON, PAST_EACH_OTHER, max_agl_m=120.0, layers=3)
    straight = [plan({v: HEAD_ON[v]}, {v: PAST_EACH_OTHER[v]}, max_agl_m=120.0, layers=3) for v in HEAD_ON]
    alone_m = [one.routes[0].length_m for one in straight]
    assert [route.length_m for route in result.routes] == pytest.approx(alone_m, abs=10.0)
    assert result.conflicts == ()


def test_vehicles_on_the_ground_make_no_detours():
    grounded = {v: replace(one, is_grounded=True) for v, one in HEAD_ON.items()}
    result = plan(grounded, PAST_EACH_OTHER)
    assert [one.vehicles for one in result.conflicts] == [(1, 2)]


def test_a_pair_that_no_detour_keeps_apart_is_reported():
    agents = {1: agent(1470.0, 1500.0, EAST), 2: agent(1530.0, 1500.0, WEST)}
    result = plan(agents, PAST_EACH_OTHER)
    assert [one.vehicles for one in result.conflicts] == [(1, 2)]
    assert len(result.routes) == 2


@pytest.mark.parametrize("layers", [1, 3])
def test_a_target_that_moves_is_met_in_each_layer(layers):
    """In other layers than the lowest routes led to where it was."""
    demands = {(0, 1): TargetDemand((0.0, 5.0))}
    result = plan({1: HEAD_ON[1]}, {1: (1700.0, 1500.0)}, layers=layers, max_agl_m=120.0, demands=demands)
    (route,) = result.routes
    assert route.layer == layers - 1
    met_s = 1000.0 / 15.0
    assert math.dist(route.target_point_m, (1700.0, 1500.0 + 5.0 * met_s)) < 60.0


places = st.tuples(st.floats(-600.0, 3600.0), st.floats(-600.0, 3600.0), st.floats(440.0, 530.0))


@given(st.lists(places, min_size=1, max_size=4), st.floats(1.0, 300.0), st.floats(1.0, 30.0))
@settings(max_examples=60, deadline=None)
def test_the_band_beside_a_flight_keeps_its_distances_and_is_else_the_same(at, distance_m, height_m):
    band = make_band(LEVEL, 50.0, 120.0)
    flight = AvoidedFlight(np.array(at), distance_m, height_m)
    floor_m, ceiling_m, room_m = band_beside(band, [flight]).surfaces_msl_m.transpose(2, 0, 1)
    nodes = -500.0 + 20.0 * np.arange(201)
    is_far = np.ones(floor_m.shape, dtype=bool)
    for east_m, north_m, height_msl_m in at:
        away_m = np.hypot(nodes - east_m, (nodes - north_m)[:, None])
        near = away_m < distance_m
        is_far &= away_m > distance_m + 1e-6
        is_open = near & (floor_m < ceiling_m)
        over = floor_m[is_open] >= height_msl_m + height_m - 1e-3
        under = ceiling_m[is_open] <= height_msl_m - height_m + 1e-3
        assert (over | under).all()
    assert np.array_equal(np.stack((floor_m, ceiling_m), axis=2)[is_far], band.surfaces_msl_m[is_far, :2])
    assert np.array_equal(room_m, band.surfaces_msl_m[..., 2])
