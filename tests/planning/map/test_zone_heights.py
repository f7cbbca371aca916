"""A vehicle over terrain would fly through an area that it may pass over or under, or find no way past it."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import VerticalLimits
from gcs.planning.map.grid import free_grid, free_grid_like
from gcs.planning.map.zone_heights import LimitedArea, blocked_by, limit_band
from gcs.terrain.elevation import Elevation

GRID = free_grid((11, 11), 100.0)
LEVEL = Elevation((-500.0, -500.0), 100.0, np.full((21, 21), 400.0))
SLOPE = Elevation((-500.0, -500.0), 100.0, np.tile(400.0 + 20.0 * np.arange(21), (21, 1)))
"""A fifth of rise towards east; 500 m high at 0 m."""
ZONE = free_grid_like(GRID).with_obstacles(boxes_m=[(260.0, 260.0, 540.0, 540.0)])
CELLS = np.flatnonzero(ZONE.blocked)


def band(limits, elevation=LEVEL, clearances_m=(0.0, 20.0), low_m=450.0, high_m=520.0):
    surfaces = np.full(GRID.shape, low_m), np.full(GRID.shape, high_m)
    return limit_band(GRID, elevation, surfaces, [LimitedArea(CELLS, limits)], 400.0, clearances_m)


def test_an_area_with_a_ceiling_raises_the_floor_and_one_with_a_floor_lowers_the_ceiling():
    floor_m, ceiling_m = band(VerticalLimits(None, 60.0, "ground"))
    assert (floor_m[ZONE.blocked] == 480.0).all()
    assert (floor_m[~ZONE.blocked] == 450.0).all()
    assert (ceiling_m == 520.0).all()
    floor_m, ceiling_m = band(VerticalLimits(510.0, None, "msl"))
    assert (ceiling_m[ZONE.blocked] == 490.0).all()
    assert (floor_m == 450.0).all()


def test_an_area_far_above_or_below_the_band_changes_nothing():
    for limits in (
        VerticalLimits(None, 20.0),
        VerticalLimits(600.0, 700.0, "msl"),
        VerticalLimits(150.0, None, "home"),
    ):
        floor_m, ceiling_m = band(limits)
        assert (floor_m == 450.0).all()
        assert (ceiling_m == 520.0).all()


def test_an_area_that_fills_the_band_leaves_no_room():
    floor_m, ceiling_m = band(VerticalLimits(None, 105.0, "home"))
    assert (floor_m >= ceiling_m)[ZONE.blocked].all()
    assert (floor_m < ceiling_m)[~ZONE.blocked].all()


def test_heights_above_the_ground_follow_it_and_count_from_the_highest_or_lowest_ground_of_a_cell():
    floor_m, _ = band(VerticalLimits(None, 60.0, "ground"), SLOPE, low_m=0.0, high_m=2000.0)
    assert floor_m[4, 3] == 500.0 + 20.0 * 3.5 + 60.0 + 20.0
    _, ceiling_m = band(VerticalLimits(60.0, None, "ground"), SLOPE, low_m=0.0, high_m=2000.0)
    assert ceiling_m[4, 3] == 500.0 + 20.0 * 2.5 + 60.0 - 20.0


def test_the_horizontal_clearance_widens_an_area():
    floor_m, _ = band(VerticalLimits(None, 60.0, "ground"), clearances_m=(100.0, 20.0))
    wide = ZONE.inflate(100.0).blocked
    assert (floor_m[wide] == 480.0).all()
    assert (floor_m[~wide] == 450.0).all()


def test_where_the_ground_is_not_known_there_is_no_room():
    part = Elevation((0.0, 0.0), 100.0, np.full((21, 6), 400.0))
    floor_m, ceiling_m = band(VerticalLimits(None, 60.0, "ground"), part)
    assert not (floor_m < ceiling_m)[:, 5:].any()
    assert (floor_m < ceiling_m)[1:, 1:5].all()


@settings(max_examples=200, deadline=None, derandomize=True)
@given(
    st.integers(300, 900).map(float),
    st.integers(1, 200).map(float),
    st.sampled_from([(0.0, 0.0), (0.0, 20.0), (150.0, 20.0)]),
    st.sampled_from([LEVEL, SLOPE]),
)
def test_every_height_of_the_band_keeps_the_clearance_from_an_area_on_one_side_of_it(
    low_m, thick_m, clearances_m, ground
):
    limits = VerticalLimits(low_m, low_m + thick_m, "msl")
    floor_m, ceiling_m = band(limits, ground, clearances_m, 420.0, 620.0)
    near = blocked_by(free_grid_like(GRID), [LimitedArea(CELLS, limits)]).inflate(clearances_m[0]).blocked
    is_open = floor_m < ceiling_m
    over = floor_m >= low_m + thick_m + clearances_m[1]
    under = ceiling_m <= low_m - clearances_m[1]
    assert (over | under)[near & is_open].all()
    assert over[near & is_open].all() or under[near & is_open].all()
    assert is_open[~near].all()
