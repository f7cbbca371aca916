"""Pruned moves of a search: every distance stays exact, whatever moves cost."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from gcs.planning.map.grid import Grid
from gcs.planning.search.canonical_ordering import (
    COL_STEP,
    DIAGONAL,
    LIST_MASK,
    MAX_TABLE_ROWS,
    ROW_STEP,
    TIGHT_MOVE_COST,
    UNIFORM_TABLE,
    list_moves,
    pack_nodes,
    prune_moves,
)
from gcs.planning.search.dijkstra import dijkstra_buffers, one_to_all
from gcs.planning.search.neighbours import search_map

NONE = np.empty(0, dtype=np.int64)
BACK = [
    list(zip(ROW_STEP, COL_STEP, strict=True)).index((-r, -c))
    for r, c in zip(ROW_STEP, COL_STEP, strict=True)
]


def case(seed, shape, blocked, dear):
    """A map whose moves are near by chance, there and back alike: more varied than obstacles make it."""
    rng = np.random.default_rng(seed)
    smap = search_map(Grid((0.0, 0.0), 1.0, rng.random(shape) < blocked))
    near = np.zeros_like(smap.moves)
    for move, step in enumerate(smap.offsets.tolist()):
        for node in np.flatnonzero(smap.moves >> np.uint8(move) & 1).tolist():
            if node < node + step and rng.random() < dear:
                near[node] |= 1 << move
                near[node + step] |= 1 << BACK[move]
    return smap, near


def field_from(smap, near, order, remaining, source):
    field = np.empty(near.size)
    came = np.empty(near.size, np.uint8)
    known = pack_nodes(order, near)
    buffers = dijkstra_buffers(smap._replace(has_tight_moves=True))
    start = np.array([source]), np.zeros(1), NONE
    one_to_all(list_moves(remaining), True, smap.offsets, *start, field, came, known, *buffers)
    return field


def dijkstra_from(smap, near, source):
    edges = [
        (
            node,
            node + step,
            (1.0 if move < 4 else DIAGONAL) * (TIGHT_MOVE_COST if near[node] >> move & 1 else 1.0),
        )
        for move, step in enumerate(smap.offsets.tolist())
        for node in np.flatnonzero(smap.moves >> np.uint8(move) & 1).tolist()
    ]
    i, j, w = zip(*edges, strict=True) if edges else ((), (), ())
    return dijkstra(coo_matrix((w, (i, j)), shape=(near.size, near.size)).tocsr(), indices=source)


@settings(max_examples=120)
@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(1, 14), st.integers(2, 14)),
    st.sampled_from([0.0, 0.1, 0.3]),
    st.sampled_from([0.02, 0.3, 0.7, 1.0]),
)
def test_no_distance_suffers_from_moves_left_out(seed, shape, blocked, dear):
    smap, near = case(seed, shape, blocked, dear)
    everywhere = np.ones(near.size, np.bool_)
    source = int(np.random.default_rng(seed).integers(near.size))
    exact = dijkstra_from(smap, near, source)
    for most in (1 << 16, 520):
        order, remaining = prune_moves(smap.moves, near, everywhere, smap.offsets, UNIFORM_TABLE, most)
        assert (remaining[order, 8] == smap.moves).all()
        found = field_from(smap, near, order, remaining, source)
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-9)


@pytest.mark.parametrize("dear", [0.0, 1.0])
def test_where_moves_cost_alike_a_node_that_is_worked_out_has_the_answer_of_the_table(dear):
    smap, near = case(1, (40, 40), 0.25, dear)
    given = smap.offsets, UNIFORM_TABLE, MAX_TABLE_ROWS
    quick = prune_moves(smap.moves, near, np.zeros(near.size, np.bool_), *given)
    slow = prune_moves(smap.moves, near, np.ones(near.size, np.bool_), *given)
    for move, step in enumerate(smap.offsets.tolist()):
        reached = np.flatnonzero(smap.moves >> np.uint8(move) & 1) + step
        np.testing.assert_array_equal(quick[1][quick[0][reached], move], slow[1][slow[0][reached], move])


def test_lists_of_moves_hold_what_their_sets_hold():
    lists = list_moves(UNIFORM_TABLE).reshape(len(UNIFORM_TABLE), 16)
    for sets, row in zip(UNIFORM_TABLE.tolist(), lists.tolist(), strict=True):
        for moves, one in zip(sets, row, strict=False):
            assert [one >> (4 + 3 * k) & 7 for k in range(one & 15)] == [
                m for m in range(8) if moves >> m & 1
            ]


def test_few_moves_remain_among_obstacles_with_a_clearance():
    grid = Grid((0.0, 0.0), 1.0, np.random.default_rng(2).random((80, 80)) < 0.2)
    smap = search_map(grid, 0.625, shifts_nodes=True)
    reached = [
        np.flatnonzero(smap.moves >> np.uint8(move) & 1) + step for move, step in enumerate(smap.offsets)
    ]
    remain = [
        (smap.move_lists[smap.packed[nodes] & LIST_MASK | move] & 15).mean()
        for move, nodes in enumerate(reached)
    ]
    assert np.mean(remain) < 2.5 < np.bitwise_count(smap.moves[smap.moves > 0]).mean()
