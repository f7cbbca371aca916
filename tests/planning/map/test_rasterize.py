"""Polygons on the grid: nothing of an obstacle in a free cell, nothing outside the boundary in one either."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.planning.map.grid import free_grid

SIZE = 12


@st.composite
def polygons(draw):
    """A polygon around a place, often larger or smaller than the grid or off it, maybe with a hole."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    centre = rng.uniform(-20.0, 140.0, 2)
    count = rng.integers(3, 9)
    angles = np.sort(rng.uniform(0.0, 2 * np.pi, count))
    radii = rng.uniform(0.2, 1.0, count) * draw(st.sampled_from([3.0, 30.0, 150.0]))
    ring = centre + radii[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    rings = [np.round(ring, draw(st.sampled_from([-1, 3])))]
    if draw(st.booleans()):
        rings.append(centre + 0.4 * (rings[0] - centre))
    return rings


def cells():
    at = 10.0 * np.arange(SIZE)
    east, north = np.meshgrid(at, at)
    return shapely.box(east - 5, north - 5, east + 5, north + 5)


@settings(max_examples=150)
@given(polygons())
def test_a_cell_is_blocked_just_when_a_keep_out_polygon_overlaps_it_and_free_just_when_a_boundary_holds_it(
    rings,
):
    polygon = shapely.Polygon(rings[0], rings[1:])
    grid = free_grid((SIZE, SIZE), 10.0)
    if not polygon.is_valid or polygon.area < 1e-6:
        return
    overlap = shapely.area(shapely.intersection(cells(), polygon))
    kept_out = grid.with_obstacles(polygons_m=[rings]).blocked
    within = ~grid.within([rings]).blocked
    assert kept_out[overlap > 1e-6].all()
    assert not kept_out[shapely.distance(cells(), polygon) > 0.0].any()
    assert not within[overlap < 100.0 - 1e-6].any()
    assert within[overlap > 100.0 - 1e-9].all()


def test_an_edge_along_the_border_of_cells_blocks_those_inside_alone():
    blocked = (
        free_grid((5, 5), 10.0).with_obstacles(polygons_m=[[[(5, 5), (25, 5), (25, 25), (5, 25)]]]).blocked
    )
    assert np.argwhere(blocked).tolist() == [[1, 1], [1, 2], [2, 1], [2, 2]]


def test_a_polygon_inside_one_cell_blocks_it_and_a_hole_stays_open():
    grid = free_grid((9, 9), 10.0)
    assert grid.with_obstacles(polygons_m=[[[(41, 41), (42, 41), (41, 42)]]]).blocked.sum() == 1
    square = [(5, 5), (75, 5), (75, 75), (5, 75)]
    hole = [(25, 25), (55, 25), (55, 55), (25, 55)]
    blocked = grid.with_obstacles(polygons_m=[[square, hole]]).blocked
    assert blocked.sum() == 7 * 7 - 3 * 3
    assert not blocked[4, 4]
    assert np.array_equal(grid.within([[square, hole]]).blocked, ~blocked)
