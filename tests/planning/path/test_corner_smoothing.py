"""Flown corners keep clear of obstacles, wherever the map has space for the turn."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from gcs.jit import kernel
from gcs.model import NoticeCode
from gcs.planning.map.grid import free_grid, random_obstacles
from gcs.planning.map.line_of_sight import clear_leg, leg_clearance
from gcs.planning.path.corner_smoothing import (
    clearance_shortfall,
    cost,
    half_angle_tan,
    smooth_corners,
    turn_fits,
)
from gcs.planning.planner_inputs import AgentState, PlanOptions
from gcs.planning.team_routes import plan_routes


@kernel
def short_by(blocked, points, i, radius, reach):
    return clearance_shortfall(blocked, points, i, half_angle_tan(points, i), radius, reach, -1)


@kernel
def leg_clearance_of(blocked, x0, y0, x1, y1, reach):
    return leg_clearance(blocked, x0, y0, x1, y1, reach, -1)


@kernel
def eased(blocked, points, clearances, radius):
    """The corners, what they cost before and after, and how many are flown before and after."""
    moved = points.copy()
    flown = np.zeros(2, np.int64)
    size = points.shape[0]
    before = cost(blocked, points, clearances, 0, size, radius, -1, np.inf)
    smooth_corners(blocked, moved, clearances, radius, -1, np.ones(size, np.bool_))
    after = cost(blocked, moved, clearances, 0, size, radius, -1, np.inf)
    for i in range(1, size - 1):
        flown[0] += turn_fits(blocked, points, clearances, i, radius, -1)
        flown[1] += turn_fits(blocked, moved, clearances, i, radius, -1)
    return moved, before, after, flown


def arc(points: np.ndarray, radius: float, count: int = 400) -> np.ndarray:
    """Places along the arc at the middle one of three points, by its definition."""
    (ux, uy), (vx, vy) = np.diff(points, axis=0)
    turn = math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)
    begins = points[1] - radius * math.tan(abs(turn) / 2.0) * np.array([ux, uy]) / math.hypot(ux, uy)
    heading = math.atan2(uy, ux)
    side = math.copysign(1.0, turn)
    angles = heading + side * np.linspace(0.0, abs(turn), count)
    centre = begins + side * radius * np.array([-math.sin(heading), math.cos(heading)])
    return centre + side * radius * np.column_stack((np.sin(angles), -np.cos(angles)))


def make_way(blocked: np.ndarray, points: np.ndarray, reach: float) -> None:
    """Free the cells that the legs come nearer to than `reach`."""
    for row, col in np.argwhere(blocked):
        alone = np.zeros_like(blocked)
        alone[row, col] = True
        legs = itertools.pairwise(points)
        blocked[row, col] = all(clear_leg(alone, *a, *b, reach, -1) for a, b in legs)


def least_clearance(blocked: np.ndarray, places: np.ndarray, reach: float) -> float:
    return min(leg_clearance_of(blocked, *place, *place, reach) for place in places.tolist())


@settings(max_examples=300)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(-2.2, 2.2),
    st.floats(-math.pi, math.pi),
    st.floats(0.3, 2.5),
    st.floats(0.05, 0.9),
)
@example(4294967294, -2.1875, 2.5, 2.5, 0.125)  # an obstacle between the arc and the corner
def test_an_arc_comes_as_near_to_obstacles_as_reported(seed, turn, heading, radius, reach):
    assume(abs(turn) > 0.01)
    long = radius * math.tan(abs(turn) / 2.0) + 0.2
    rng = np.random.default_rng(seed)
    blocked = rng.random((13, 13)) < 0.15
    corner = 6.0 + rng.uniform(-1.0, 1.0, 2)
    ways = np.array([[math.cos(a), math.sin(a)] for a in (heading, heading + turn)])
    points = np.array([corner - long * ways[0], corner, corner + long * ways[1]])
    make_way(blocked, points, reach)
    nearest = least_clearance(blocked, arc(points, radius), reach)
    shortfall = short_by(blocked, points, 1, radius, reach)
    if shortfall < reach:  # beyond, the arc crosses the obstacle: its clearance does not show by how much
        assert shortfall == pytest.approx(reach - nearest, abs=0.003)
    else:
        assert nearest < 0.01


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.3, 0.5]), st.sampled_from([0.5, 1.0, 2.0]))
def test_easing_takes_nothing_from_the_legs_and_makes_the_way_no_dearer(seed, reach, radius):
    rng = np.random.default_rng(seed)
    blocked = rng.random((30, 30)) < 0.1
    points = np.cumsum(rng.uniform(-1.0, 3.0, (9, 2)), axis=0) + 3.0
    make_way(blocked, points, 0.5 * reach)
    clearances = np.array([leg_clearance_of(blocked, *points[k], *points[k + 1], reach) for k in range(8)])
    moved, before, after, _ = eased(blocked, points, clearances, radius)
    assert after <= before + 1e-9
    assert np.array_equal(moved[[0, -1]], points[[0, -1]])
    for k in range(8):
        assert clear_leg(blocked, *moved[k], *moved[k + 1], clearances[k], -1), k


def test_corners_around_a_block_are_moved_until_a_vehicle_can_fly_them():
    blocked = np.zeros((20, 20), np.bool_)
    blocked[8:12, 8:12] = True
    reach = 0.5
    radius = 1.0
    points = np.array([[7.0, 2.0], [7.0, 12.0], [12.0, 12.0], [12.0, 2.0]])
    moved, _, _, flown = eased(blocked, points, np.full(3, reach), radius)
    assert flown.tolist() == [0, 2]
    for i in (1, 2):
        places = arc(moved[i - 1 : i + 2], radius)
        assert least_clearance(blocked, places, reach) > reach - 1.1e-3 * radius
        assert np.hypot(*(moved[i] - points[i])) < 0.5 * radius


@pytest.mark.parametrize(("threshold", "share"), [(0.05, 1.0), (0.1, 0.8)])
def test_on_open_maps_no_corner_comes_nearer_than_the_clearance(threshold, share):
    kept = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        start = (40.0, 2000.0 * rng.random())
        goal = (1900.0, 2000.0 * rng.random())
        grid = random_obstacles(free_grid((51, 51), 40.0), threshold, rng, [start, goal], 120.0)
        options = PlanOptions(shape="flyable", clearance_m=20.0, turn_radius_m=40.0)
        found = plan_routes(grid, {1: AgentState(*start, math.pi / 2)}, {(0, 0): goal}, {}, options)
        kept.append(not any(note.code is NoticeCode.SHARP_CORNERS for note in found.notes))
        points_m = np.vstack((start, found.routes[0].points_m))
        if kept[-1]:
            for i in range(1, len(points_m) - 1):
                places = arc(points_m[i - 1 : i + 2], 40.0, 60)
                assert least_clearance(grid.blocked, places / 40.0, 0.5) > 0.498, (seed, i)
    assert np.mean(kept) >= share
