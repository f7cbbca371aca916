"""A vehicle over terrain would fly through an area that it may pass over or under, or find no way past it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import VerticalLimits
from gcs.planning.map.grid import free_grid, free_grid_like
from gcs.planning.map.limited_area import LimitedArea, blocked_by
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.planner_inputs import AgentState, LoiterSpec, PlanOptions
from gcs.planning.terrain.band import make_band
from gcs.planning.terrain.flown_route import FlightModel, fly_route
from gcs.planning.terrain.ground import Terrain
from gcs.planning.terrain.limited_band import block_closed, limit_band
from gcs.planning.terrain.terrain_search import TerrainSearch
from gcs.terrain.elevation_grid import Elevation

GRID = free_grid((26, 26), 40.0)
LEVEL = Elevation((-60.0, -60.0), 30.0, np.full((42, 42), 400.0))
SLOPE = Elevation((-60.0, -60.0), 30.0, np.tile(400.0 + 6.0 * np.arange(42), (42, 1)))
"""A fifth of rise towards east."""
GENTLE = Elevation((-60.0, -60.0), 30.0, np.tile(400.0 + 3.0 * np.arange(42), (42, 1)))
"""A tenth of rise towards east: 456 m to 478 m under the area."""
ZONE = free_grid_like(GRID).with_obstacles(boxes_m=[(390.0, 390.0, 610.0, 610.0)])
CELLS = np.flatnonzero(ZONE.blocked)
HOME_MSL_M = 400.0
rng = np.random.default_rng(1)
IN_ZONE = rng.uniform(380.0, 620.0, (400, 2))
"""380 m to 620 m: the edges of its cells."""
FAR_M = np.array([(100.0, 100.0), (900.0, 500.0), (500.0, 200.0)])


def limits_at(places_m, limits, elevation=LEVEL, clearances_m=(0.0, 20.0), agl_m=(50.0, 120.0)):
    """Return floor and ceiling at places of the band with an area."""
    band = limit_band(
        make_band(elevation, *agl_m, GRID),
        elevation,
        GRID,
        [LimitedArea(CELLS, limits)],
        HOME_MSL_M,
        clearances_m,
    )
    return band.limits_at(places_m).T


def test_an_area_with_a_ceiling_raises_the_floor_and_one_with_a_floor_lowers_the_ceiling():
    floor_m, ceiling_m = limits_at(IN_ZONE, VerticalLimits(None, 60.0, "ground"))
    assert (floor_m == 480.0).all()
    assert (ceiling_m == 520.0).all()
    floor_m, ceiling_m = limits_at(IN_ZONE, VerticalLimits(510.0, None, "msl"))
    assert (floor_m == 450.0).all()
    assert (ceiling_m == 490.0).all()
    for limits in (VerticalLimits(None, 60.0, "ground"), VerticalLimits(510.0, None, "msl")):
        floor_m, ceiling_m = limits_at(FAR_M, limits)
        assert (floor_m == 450.0).all()
        assert (ceiling_m == 520.0).all()


def test_an_area_far_above_or_below_the_band_changes_nothing():
    band = make_band(LEVEL, 50.0, 120.0, GRID)
    for limits in (
        VerticalLimits(None, 20.0),
        VerticalLimits(600.0, 700.0, "msl"),
        VerticalLimits(150.0, None, "home"),
    ):
        areas = [LimitedArea(CELLS, limits)]
        limited = limit_band(band, LEVEL, GRID, areas, HOME_MSL_M, (0.0, 20.0))
        assert (limited.surfaces_msl_m == band.surfaces_msl_m).all()
    assert limit_band(band, LEVEL, GRID, [], HOME_MSL_M, (0.0, 20.0)) is band


def test_an_area_that_fills_the_band_leaves_no_room_anywhere_in_it():
    floor_m, ceiling_m = limits_at(IN_ZONE, VerticalLimits(None, 105.0, "home"))
    assert (floor_m >= ceiling_m).all()
    floor_m, ceiling_m = limits_at(FAR_M, VerticalLimits(None, 105.0, "home"))
    assert (floor_m < ceiling_m).all()


def test_heights_above_the_ground_follow_it():
    floor_m, _ = limits_at(IN_ZONE, VerticalLimits(None, 60.0, "ground"), SLOPE)
    above_m = floor_m - SLOPE.heights_at(IN_ZONE)
    assert above_m.min() >= 80.0
    assert above_m.max() <= 80.0 + 6.0 * 2


def test_the_horizontal_clearance_widens_an_area():
    beside_m = np.array([(300.0, 500.0)])
    assert limits_at(beside_m, VerticalLimits(None, 60.0), clearances_m=(0.0, 20.0))[0] == 450.0
    assert limits_at(beside_m, VerticalLimits(None, 60.0), clearances_m=(90.0, 20.0))[0] == 480.0


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    st.integers(300, 900).map(float),
    st.integers(1, 200).map(float),
    st.sampled_from([(0.0, 0.0), (0.0, 20.0), (100.0, 20.0)]),
    st.sampled_from([LEVEL, SLOPE]),
)
def test_every_height_of_the_band_keeps_the_clearance_on_one_side_of_an_area(
    low_m, thick_m, clearances_m, ground
):
    limits = VerticalLimits(low_m, low_m + thick_m, "msl")
    floor_m, ceiling_m = limits_at(IN_ZONE, limits, ground, clearances_m)
    is_open = floor_m < ceiling_m
    over = floor_m >= low_m + thick_m + clearances_m[1] - 1e-3
    under = ceiling_m <= low_m - clearances_m[1] + 1e-3
    assert over[is_open].all() or under[is_open].all()
    assert not (blocked_by(free_grid_like(GRID), [LimitedArea(CELLS, limits)]).blocked ^ ZONE.blocked).any()


OPTIONS = PlanOptions(
    shape="flyable",
    turns=TurnAnticipation(40.0, 15.0, 10.0),
    loiter=LoiterSpec(40.0, 40.0, 1.0, TurnAnticipation(40.0, 15.0, 10.0)),
)


def starts(elevation):
    """Return vehicles west of the area, on their way east."""
    return [
        AgentState(150.0, north_m, 0.5 * math.pi, height_msl_m=80.0 + elevation.height_msl_m(150.0, north_m))
        for north_m in (300.0, 500.0, 700.0)
    ]


def test_a_way_leads_round_an_area_that_the_band_passes_neither_over_nor_under():
    clearances_m = (0.0, 20.0)
    band = make_band(LEVEL, 50.0, 120.0, GRID)
    high = LimitedArea(CELLS, VerticalLimits(None, 300.0))
    low = LimitedArea(CELLS, VerticalLimits(None, 60.0, "ground"))
    blocked, rest = block_closed(band, LEVEL, GRID, [high, low], HOME_MSL_M, clearances_m)
    assert (np.flatnonzero(blocked.blocked) == CELLS).all()
    assert not any(len(area.cells) for area in rest)
    blocked, rest = block_closed(band, LEVEL, GRID, [low], HOME_MSL_M, clearances_m)
    assert blocked is GRID
    assert rest == [low]
    terrain = Terrain(LEVEL, 50.0, 120.0, 1, (high,), HOME_MSL_M, 20.0)
    search = TerrainSearch(terrain, GRID, starts(LEVEL), [(850.0, 500.0)], OPTIONS)
    assert all(search.route(i, 0, 0) is not None for i in range(3))


def test_an_area_without_cells_changes_nothing():
    band = make_band(LEVEL, 50.0, 120.0, GRID)
    area = LimitedArea(np.zeros(0, dtype=np.int64), VerticalLimits(None, 300.0))
    full = LimitedArea(CELLS, VerticalLimits(None, 300.0))
    blocked, _ = block_closed(band, LEVEL, GRID, [area, full], HOME_MSL_M, (0.0, 20.0))
    assert (np.flatnonzero(blocked.blocked) == CELLS).all()


@pytest.mark.parametrize(
    "limits", [VerticalLimits(None, 560.0 + rise_m, "msl") for rise_m in range(0, 120, 10)]
)
def test_a_way_leads_round_an_area_that_closes_the_band_in_a_part_of_it(limits):
    """Over rising ground a ceiling above sea level closes the band where the ground is low."""
    terrain = Terrain(GENTLE, 50.0, 120.0, 1, (LimitedArea(CELLS, limits),), HOME_MSL_M, 20.0)
    options = replace(OPTIONS, clearance_m=20.0)
    search = TerrainSearch(terrain, GRID, starts(GENTLE), [(850.0, 500.0)], options)
    ends = [search.route(i, 0, 0) for i in range(3)]
    assert all(ends)
    for route, _ in ends:
        flown = fly_route(route, FlightModel(15.0, 0.0, OPTIONS.turns))
        is_inside = (np.abs(flown.places_m - 500.0) < 120.0).all(axis=1)
        assert (flown.heights(route.heights_msl_m)[is_inside] > limits.ceiling_m).all()
