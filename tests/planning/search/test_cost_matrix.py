"""Cost matrices: the way they are filled is a matter of speed, never of the result."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from helpers.grid_paths import distances_m
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from gcs.planning.map.grid import Grid
from gcs.planning.path.path_shaping import connect_to_grid
from gcs.planning.search import cost_matrix
from gcs.planning.search.canonical_ordering import TIGHT_MOVE_COST
from gcs.planning.search.dijkstra import dijkstra_buffers, one_to_all
from gcs.planning.search.neighbours import search_map

DIAGONAL = np.sqrt(2.0)


def places(grid, smap, points):
    xy = np.array(points, dtype=float).reshape(-1, 2)
    return cost_matrix.Endpoints(
        xy, *connect_to_grid(grid.blocked, smap.largest_component, smap.tight_nodes, smap.stride, xy)
    )


@st.composite
def cases(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = (draw(st.integers(2, 16)), draw(st.integers(2, 16)))
    grid = Grid((0.0, 0.0), 10.0, rng.random(shape) < draw(st.sampled_from([0.0, 0.1, 0.25, 0.4])))
    size = np.array(shape[::-1])
    starts, goals = (rng.uniform(-0.5, size - 0.5, (draw(st.integers(1, 4)), 2)) for _ in range(2))
    return grid, draw(st.sampled_from([0.0, 12.0])), starts, goals


def costs_of(smap, way):
    """Cost in cells of a way, node by node, with tight moves counted dearly; also whether it is legal."""
    cost = 0.0
    legal = True
    for a, b in itertools.pairwise(way):
        move = list(smap.offsets).index(b - a)
        legal &= bool(smap.moves[a] >> move & 1)
        cost += (1.0 if move < 4 else DIAGONAL) * (
            TIGHT_MOVE_COST if smap.tight_moves[a] >> move & 1 else 1.0
        )
    return cost, legal


@settings(max_examples=120)
@given(cases())
def test_one_search_to_all_and_a_search_for_each_pair_find_ways_of_the_same_cost(case):
    grid, clearance_m, starts, goals = case
    smap = search_map(grid, clearance_m)
    a = places(grid, smap, starts)
    b = places(grid, smap, goals)
    filled = [
        cost_matrix._one_to_all(grid, smap, a, b, clearance_m),
        cost_matrix._pairwise(grid, smap, a, b, clearance_m),
    ]
    back, way_back = cost_matrix._one_to_all(grid, smap, b, a, clearance_m)
    filled.append((back.T, lambda i, j: way_back(j, i)[::-1]))
    for i in range(len(starts)):
        for j in range(len(goals)):
            found = [lengths[i, j] for lengths, _ in filled]
            assert len({np.isfinite(length) for length in found}) == 1
            if not np.isfinite(found[0]):
                continue
            if not smap.has_tight_moves:
                assert found == pytest.approx([found[0]] * 3, abs=1e-9)
            costs = []
            for _, way in filled:
                nodes = way(i, j)
                cost, legal = costs_of(smap, nodes)
                assert legal
                if nodes.size:
                    cost += a.gaps[i][list(a.nodes[i]).index(nodes[0])]
                    cost += b.gaps[j][list(b.nodes[j]).index(nodes[-1])]
                costs.append(cost)
            assert costs == pytest.approx([costs[0]] * 3, abs=1e-9)


@settings(max_examples=40)
@given(cases())
def test_the_way_there_is_as_long_as_the_way_back(case):
    grid, _, starts, goals = case
    smap = search_map(grid)
    a = places(grid, smap, starts)
    b = places(grid, smap, goals)
    there, _ = cost_matrix.shortest_paths(grid, smap, a, b, 0.0)
    back, _ = cost_matrix.shortest_paths(grid, smap, b, a, 0.0)
    np.testing.assert_allclose(there, back.T, rtol=0, atol=1e-8)


@settings(max_examples=80)
@given(cases(), st.booleans(), st.integers(0, 2**32 - 1))
def test_costs_with_clearance_are_those_of_dijkstra_over_all_legal_moves(case, shifts_nodes, seed):
    smap = search_map(case[0], case[1], shifts_nodes)
    size = smap.moves.size
    edges = [
        (
            node,
            node + step,
            (1.0 if move < 4 else DIAGONAL) * (TIGHT_MOVE_COST if smap.tight_moves[node] >> move & 1 else 1),
        )
        for move, step in enumerate(smap.offsets.tolist())
        for node in np.flatnonzero(smap.moves >> np.uint8(move) & 1).tolist()
    ]
    if not edges:
        return
    i, j, w = zip(*edges, strict=True)
    source = int(np.random.default_rng(seed).choice(np.flatnonzero(smap.moves)))
    graph = coo_matrix((w, (i, j)), shape=(size, size)).tocsr()
    field = np.empty(size)
    none = np.empty(0, dtype=np.int64)
    lists = smap.move_lists, smap.has_tight_moves, smap.offsets
    work = np.empty(size, np.uint8), smap.packed.copy(), *dijkstra_buffers(smap)
    one_to_all(*lists, np.array([source]), np.zeros(1), none, field, *work)
    np.testing.assert_allclose(field, dijkstra(graph, indices=source), rtol=0, atol=1e-8)


def test_a_search_that_ends_when_its_goals_are_reached_has_their_exact_distances():
    """Near and far goals on a map with a wall; the farthest behind it."""
    blocked = np.zeros((60, 60), dtype=bool)
    blocked[5:60, 30] = True
    grid = Grid((0.0, 0.0), 1.0, blocked)
    smap = search_map(grid)
    a = places(grid, smap, [(10, 50), (12, 3)])
    b = places(grid, smap, [(14, 52), (40, 50), (25, 20)])
    lengths, _ = cost_matrix._one_to_all(grid, smap, a, b, 0.0)
    for i, (col, row) in enumerate(a.xy.astype(int)):
        field = distances_m(grid, (row, col))
        assert lengths[i] == pytest.approx([field[r, c] for c, r in b.xy.astype(int)])


def test_few_pairs_on_open_ground_are_searched_one_by_one_and_many_in_clutter_are_not():
    open_ground = search_map(Grid((0.0, 0.0), 1.0, np.zeros((200, 200), dtype=bool)))
    clutter = search_map(Grid((0.0, 0.0), 1.0, np.random.default_rng(1).random((200, 200)) < 0.3))
    places_xy = np.random.default_rng(2).uniform(0.0, 199.0, (2, 20, 2))
    assert cost_matrix.is_pairwise_faster(open_ground, places_xy[0, :2], places_xy[1, :2])
    assert not cost_matrix.is_pairwise_faster(clutter, *places_xy)
