"""Kernels find the heights that the plain recursion and an exhaustive search find."""

from __future__ import annotations

import math

import numpy as np
from helpers.random_terrain import MAX_AGL_M, MIN_AGL_M, RADIUS_M, SPACING_M, VERTICAL, hills
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit

from gcs.planning.terrain.band import make_band
from gcs.planning.terrain.goal import goal_at
from gcs.planning.terrain.height_profile import plan_heights, sample_path
from gcs.planning.terrain.intervals import advance, begin
from gcs.planning.terrain.loiter_circles import circle_at, make_circle_map
from gcs.planning.terrain.route import plan_route
from gcs.planning.terrain.terrain_map import make_terrain_map

RATES = np.array([VERTICAL.climb_gradient, VERTICAL.sink_gradient, 20.0])


def plain_intervals(band, places, low, high):
    """Return the interval at each place by the plain recursion; None if one is empty."""
    limits = band.limits_at(places[:, :2])
    low, high, entry = begin.py_func(low, high, *limits[0].tolist(), RATES[2])
    if low > high:
        return None
    found = [(low, high, entry)]
    for before, place, (floor, ceiling) in zip(places, places[1:], limits[1:].tolist(), strict=False):
        step_m = place[2] - before[2]
        low, high, entry = advance.py_func(
            low, high, entry, floor, ceiling, RATES[0] * step_m, RATES[1] * step_m, RATES[2]
        )
        if low > high:
            return None
        found.append((low, high, entry))
    return np.array(found)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.integers(0, 100_000), st.floats(-30.0, 120.0), st.floats(0.0, 1.0))
def test_a_profile_is_found_where_the_plain_recursion_finds_heights(seed, above_m, share):
    band = make_band(hills(seed, relief_m=30.0), MIN_AGL_M, MAX_AGL_M)
    assume(abs(above_m) > 0.01)  # at the floor, rounding says whether the vehicle is inside
    rng = np.random.default_rng(seed)
    points = np.sort(rng.uniform(20.0, 570.0, (4, 2)), axis=0)
    places, _, _ = sample_path(points, 5.0, 2.0)
    floor = band.limits_at(places[:1, :2])[0, 0]
    height = float(floor + above_m)
    ends = np.array([[*points[0], 0.0, 1.0, height, height, 0.0], [*points[-1], 0.0, 1.0, -1e9, 1e9, 0.0]])
    heights, _ = plan_heights(band.surfaces_msl_m, SPACING_M, RATES, places, ends, share, 0.0)
    expected = plain_intervals(band, places, height, height)
    if expected is None or expected[-1, 2] != 0.0:
        assert not heights.size
        return
    assert heights.size == len(places)
    assert (heights >= expected[:, 0] - 1e-6).all()
    assert (heights <= expected[:, 1] + 1e-6).all()
    gradients = np.diff(heights) / np.diff(places[:, 2])
    assert gradients.max() <= RATES[0] + 1e-6
    assert gradients.min() >= -RATES[1] - 1e-6


@njit
def exhaustive(surfaces, start, goal, radius, climb, sink):  # type: ignore[no-untyped-def]
    """Return True if a breadth-first search over place, course and height reaches the circle of the goal.

    `start` (n, 4): x, y, course, height. `goal`: x, y, radius, lowest, highest.
    """
    courses, cell, layer = 16, 8.0, 4.0
    rows, cols, _ = surfaces.shape
    base = surfaces[:, :, 0].min()
    tall = int((surfaces[:, :, 1].max() - base) / layer) + 2
    wide, high = int((cols - 1) * 10.0 / cell) + 1, int((rows - 1) * 10.0 / cell) + 1
    seen = np.zeros((high, wide, courses, tall), np.bool_)
    queue = np.empty((2_000_000, 4))
    size = 0
    for i in range(start.shape[0]):
        queue[size] = start[i]
        size += 1
    at = 0
    turn = 2.0 * math.pi / courses
    while at < size and size < queue.shape[0] - 16:
        x, y, course, z = queue[at]
        at += 1
        apart = math.hypot(x - goal[0], y - goal[1])
        if abs(apart - goal[2]) < 3.0 and goal[3] <= z <= goal[4]:
            radial = math.atan2(y - goal[1], x - goal[0])
            off = abs(math.cos(course - radial))
            if off < 0.1:
                return True
        for bend in range(-1, 2):
            for slope in range(3):
                gradient = climb if slope == 0 else (-sink if slope == 1 else 0.0)
                nx, ny, nc, nz = x, y, course, z
                arc = turn * radius
                ok = True
                for _ in range(4):
                    step = arc / 4.0
                    middle = nc + 0.5 * bend * step / radius
                    nx += step * math.cos(middle)
                    ny += step * math.sin(middle)
                    nc += bend * step / radius
                    nz += gradient * step
                    if not (0.0 <= nx < (cols - 1) * 10.0 and 0.0 <= ny < (rows - 1) * 10.0):
                        ok = False
                        break
                    c, r = int(nx / 10.0), int(ny / 10.0)
                    u, v = nx / 10.0 - c, ny / 10.0 - r
                    f = (1 - v) * ((1 - u) * surfaces[r, c, 0] + u * surfaces[r, c + 1, 0]) + v * (
                        (1 - u) * surfaces[r + 1, c, 0] + u * surfaces[r + 1, c + 1, 0]
                    )
                    t = (1 - v) * ((1 - u) * surfaces[r, c, 1] + u * surfaces[r, c + 1, 1]) + v * (
                        (1 - u) * surfaces[r + 1, c, 1] + u * surfaces[r + 1, c + 1, 1]
                    )
                    if not f <= nz <= t:
                        ok = False
                        break
                if not ok:
                    continue
                k = round((nc % (2.0 * math.pi)) / turn) % courses
                i, j, m = int(ny / cell), int(nx / cell), int((nz - base) / layer)
                if not seen[i, j, k, m]:
                    seen[i, j, k, m] = True
                    queue[size] = (nx, ny, nc, nz)
                    size += 1
    return False


def test_there_is_a_route_wherever_an_exhaustive_search_in_a_narrower_band_finds_one():
    found = 0
    missed = []
    for seed in range(25):
        band = make_band(hills(seed, size=30, relief_m=35.0), MIN_AGL_M, MAX_AGL_M)
        circles = make_circle_map(band, RADIUS_M)
        rng = np.random.default_rng(seed)
        drawn = [circle_at(circles, tuple((rng.random(2) * 290.0).tolist())) for _ in range(30)]
        ends = [circle for circle in drawn if circle is not None][:2]
        if len(ends) < 2:
            continue
        goal = ends[1]
        angles = np.arange(32) * math.pi / 16.0
        begin_z = 0.5 * (ends[0].low_msl_m + ends[0].high_msl_m)
        starts = np.column_stack(
            (
                ends[0].east_m - RADIUS_M * np.sin(angles),
                ends[0].north_m + RADIUS_M * np.cos(angles),
                angles,
                np.full(32, begin_z),
            )
        )
        is_reached = exhaustive(
            band.narrowed(3.0).surfaces_msl_m,
            starts,
            np.array([goal.east_m, goal.north_m, RADIUS_M, goal.low_msl_m, goal.high_msl_m]),
            RADIUS_M,
            0.9 * VERTICAL.climb_gradient,
            0.9 * VERTICAL.sink_gradient,
        )
        terrain = make_terrain_map(band, VERTICAL, RADIUS_M)
        route = plan_route(terrain, ends[0], goal_at(terrain, [goal]))
        found += bool(is_reached)
        if is_reached and route is None:
            missed.append(seed)
    assert found >= 10
    assert not missed
