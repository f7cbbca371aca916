"""The obstacle map: nodes to metres and back, obstacles to cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.planning.map.grid import Grid, free_grid, random_obstacles

SPACINGS = st.sampled_from([0.5, 1.0, 39.7, 40.0, 76.9])


@given(SPACINGS, st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.integers(0, 19), st.integers(0, 29))
def test_a_node_maps_to_metres_and_back(spacing_m, east_m, north_m, row, col):
    grid = free_grid((20, 30), spacing_m, (east_m, north_m))
    assert grid.node_of(grid.point_of((row, col))) == (row, col)


@given(st.floats(-500.0, 2500.0), st.floats(-500.0, 2500.0))
def test_a_place_belongs_to_the_nearest_node_even_outside_the_map(east_m, north_m):
    grid = free_grid((51, 51), 40.0)
    here = math.dist(grid.point_of(grid.node_of((east_m, north_m))), (east_m, north_m))
    axis = 40.0 * np.arange(51)
    assert here <= np.hypot(axis[:, None] - north_m, axis[None, :] - east_m).min() + 1e-9


def test_rows_go_north_and_columns_east():
    grid = free_grid((51, 51), 40.0, (100.0, -200.0))
    assert grid.point_of((2, 5)) == (300.0, -120.0)
    assert grid.node_of((300.0, -120.0)) == (2, 5)


def test_a_map_cannot_be_changed_behind_a_planners_back():
    cells = np.zeros((3, 3), dtype=bool)
    grid = Grid((0.0, 0.0), 1.0, cells)
    cells[1, 1] = True
    assert not grid.blocked.any()
    with pytest.raises(ValueError, match="read-only"):
        grid.blocked[0, 0] = True


@pytest.mark.parametrize(
    ("shape", "spacing_m"), [((0, 5), 1.0), ((5,), 1.0), ((3, 3), 0.0), ((3, 3), math.nan)]
)
def test_a_map_without_nodes_or_size_is_refused(shape, spacing_m):
    with pytest.raises(ValueError, match="must be"):
        Grid((0.0, 0.0), spacing_m, np.zeros(shape, dtype=bool))


@given(st.floats(0.0, 800.0), st.floats(0.0, 800.0), st.floats(0.0, 200.0), st.floats(0.0, math.tau))
def test_no_point_of_a_disc_lies_in_a_free_cell(east_m, north_m, radius_m, angle):
    grid = free_grid((21, 21), 40.0).with_obstacles(discs_m=[(east_m, north_m, radius_m)])
    for part in (0.0, 0.5, 0.999):
        point = east_m + part * radius_m * math.cos(angle), north_m + part * radius_m * math.sin(angle)
        if grid.contains(point):
            assert grid.blocked[grid.node_of(point)]


def test_a_box_blocks_the_cells_that_it_overlaps_and_no_more():
    one = free_grid((5, 5), 40.0).with_obstacles(boxes_m=[(20.0, 20.0, 60.0, 60.0)])
    assert np.argwhere(one.blocked).tolist() == [[1, 1]]
    more = free_grid((5, 5), 40.0).with_obstacles(boxes_m=[(19.0, 30.0, 61.0, 50.0)])
    assert np.argwhere(more.blocked).tolist() == [[1, 0], [1, 1], [1, 2]]


def test_obstacles_add_up():
    grid = free_grid((5, 5), 40.0).with_obstacles(cells=[(4, 4)]).with_obstacles(discs_m=[(0.0, 0.0, 1.0)])
    assert np.argwhere(grid.blocked).tolist() == [[0, 0], [4, 4]]


@given(st.integers(0, 2**32), st.sampled_from([0.001, 0.1, 0.2, 0.45]))
def test_random_obstacles_follow_the_papers_rule_and_the_seed(seed, threshold):
    expected = np.random.default_rng(seed).random((51, 51)) < threshold
    plain = random_obstacles(free_grid((51, 51), 40.0), threshold, np.random.default_rng(seed))
    assert (plain.blocked == expected).all()
    start = (80.0, 400.0)
    kept = random_obstacles(free_grid((51, 51), 40.0), threshold, np.random.default_rng(seed), [start], 120.0)
    axis = 40.0 * np.arange(51)
    near = np.hypot(axis[None, :] - start[0], axis[:, None] - start[1]) <= 120.0
    assert (kept.blocked == (expected & ~near)).all()


@given(st.integers(0, 2**32), st.floats(0.0, 130.0))
def test_inflation_blocks_exactly_the_nodes_nearer_than_the_clearance(seed, clearance_m):
    grid = random_obstacles(free_grid((9, 11), 40.0), 0.08, np.random.default_rng(seed))
    rows, cols = np.nonzero(grid.blocked)
    inflated = grid.inflate(clearance_m)
    for row in range(9):
        for col in range(11):
            gaps = np.hypot(np.maximum(abs(rows - row) - 0.5, 0.0), np.maximum(abs(cols - col) - 0.5, 0.0))
            gap_m = 40.0 * min(gaps, default=math.inf)
            if abs(gap_m - clearance_m) > 1e-6:
                assert inflated.blocked[row, col] == (grid.blocked[row, col] or gap_m < clearance_m)


def test_a_node_next_to_an_obstacle_has_half_a_cell_of_clearance():
    grid = free_grid((5, 5), 40.0).with_obstacles(cells=[(2, 2)])
    assert (grid.inflate(20.0).blocked == grid.blocked).all()
    assert grid.inflate(20.1).blocked.sum() == 5
