"""Clearance-shifted nodes: gaps that are wide enough are used, and tight moves are exactly the tight ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import NoticeCode
from gcs.planning.map.grid import Grid, free_grid
from gcs.planning.map.line_of_sight import clear_leg
from gcs.planning.planner_inputs import AgentState, PlanOptions
from gcs.planning.search.neighbours import cells, places, search_map
from gcs.planning.team_routes import plan_routes


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.05, 0.15, 0.3]), st.sampled_from([0.6, 0.75, 1.0, 1.5]))
def test_a_move_that_is_not_near_keeps_the_clearance_and_one_that_is_cannot(seed, share, reach):
    grid = Grid((0.0, 0.0), 1.0, np.random.default_rng(seed).random((9, 11)) < share)
    smap = search_map(grid, reach, shifts_nodes=True)
    for node in np.flatnonzero(smap.moves):
        for move, step in enumerate(smap.offsets.tolist()):
            if not smap.moves[node] >> move & 1:
                continue
            ends = np.array([node, node + step])
            (x0, y0), (x1, y1) = places(smap, ends).tolist()
            keeps = clear_leg(grid.blocked, x0, y0, x1, y1, reach, -1)
            is_near = bool(smap.tight_moves[node] >> move & 1)
            assert is_near == bool(smap.tight_moves[node + step] >> ((move & 4) | ((move + 2) & 3)) & 1)
            assert keeps == (not is_near)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.6, 1.0]))
def test_nodes_shift_within_their_cell_and_only_where_they_must(seed, reach):
    grid = Grid((0.0, 0.0), 1.0, np.random.default_rng(seed).random((9, 11)) < 0.2)
    smap = search_map(grid, reach, shifts_nodes=True)
    free = np.flatnonzero(smap.component)
    by = np.abs(places(smap, free) - cells(smap, free)).max(axis=1)
    plain = search_map(grid, reach)
    assert set(by.tolist()) <= {0.0, 0.5}
    assert not by[~plain.tight_nodes[free]].any()
    assert not (smap.tight_nodes & ~plain.tight_nodes).any()


@pytest.mark.parametrize("clearance_m", [25.0, 40.0])
def test_a_gap_of_two_cells_is_flown_through_its_middle(clearance_m):
    """Two cells of 40 m leave 40 m on either side, between the rows of nodes; the way round is far longer."""
    wall = [(row, 10) for row in range(30) if row not in (14, 15)]
    grid = free_grid((30, 21), 40.0).with_obstacles(cells=wall)
    agents = {1: AgentState(40.0, 580.0)}
    targets = {(0, 1): (760.0, 580.0)}
    for shape in ("pulled", "flyable"):
        result = plan_routes(grid, agents, targets, {}, PlanOptions(shape=shape, clearance_m=clearance_m))
        assert not [note for note in result.notes if note.code is NoticeCode.ROUTE_NEAR_OBSTACLES]
        assert result.routes[0].length_m == pytest.approx(720.0, abs=6.0)
    along = plan_routes(grid, agents, targets, {}, PlanOptions(shape="grid", clearance_m=clearance_m))
    assert [note for note in along.notes if note.code is NoticeCode.ROUTE_NEAR_OBSTACLES]


def test_a_gap_that_is_too_narrow_is_no_gap():
    """The detour by the wide gap is taken, as along the grid."""
    wall = [(row, 10) for row in range(30) if row not in (14, 15, 18, 19, 20, 21)]
    grid = free_grid((30, 21), 40.0).with_obstacles(cells=wall)
    agents = {1: AgentState(40.0, 580.0)}
    targets = {(0, 1): (760.0, 580.0)}
    [route] = plan_routes(grid, agents, targets, {}, PlanOptions(shape="pulled", clearance_m=50.0)).routes
    assert max(north for _, north in route.points_m.tolist()) >= 17.5 * 40.0 + 50.0 - 1e-6
    assert math.isclose(route.points_m[-1][1], 580.0)
