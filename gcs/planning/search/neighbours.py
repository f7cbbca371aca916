"""Legal moves and clearance of a map, prepared for the search kernels.

Moves go to the eight neighbours. A straight move costs 1, a diagonal sqrt(2) (in cells). A diagonal needs
both straight neighbours free: corners are not cut. The legal moves of a node are one byte. The map has a
blocked border, so the kernels need no bounds checks.

*Clearance*: nodes nearer to an obstacle than the clearance are tight. A move from or to a tight node is tight
and costs `TIGHT_MOVE_COST` times as much. So clearance is given up where no path keeps it, or only a long
detour, and a path that starts in a tight zone leaves it soon. A factor of 8 lengthens routes on crowded maps
by a third; forbidding tight moves nearly doubled them. For routes of any angle nodes may be shifted
(`gcs.planning.map.clearance_nodes`).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from gcs.model import BoolArray, ByteArray, FloatArray, Int32Array, IntArray, UInt16Array, UInt32Array
from gcs.planning.map.clearance_nodes import find_tight_moves, shifted_nodes
from gcs.planning.map.grid import Grid, Node
from gcs.planning.search.canonical_ordering import (
    COL_STEP,
    MAX_TABLE_ROWS,
    ROW_STEP,
    UNIFORM_TABLE,
    list_moves,
    pack_nodes,
    prune_moves,
)

_SHIFT_ROWS, _SHIFT_COLS = (0.5 * np.array([0, *steps]) for steps in (ROW_STEP, COL_STEP))
"""Shifts of a node: none, or half a move."""


class SearchMap(NamedTuple):
    """A grid as flat arrays for the kernels, with a border of one blocked node all around."""

    moves: ByteArray
    """Bit d is set if move d is legal."""
    tight_moves: ByteArray
    """Bit d is set if move d has less than the required clearance."""
    packed: UInt32Array
    """Packed words of the nodes; see `gcs.planning.search.canonical_ordering`."""
    move_lists: UInt32Array
    """Lists of the remaining moves, indexed by the packed words."""
    tight_nodes: BoolArray
    """Nodes (with all their shifts) nearer to an obstacle than the clearance."""
    node_shift: ByteArray
    """Shift index of each node; see `places`."""
    component: Int32Array
    """Connected component of each node; 0: blocked."""
    largest_component: BoolArray
    """Nodes of the largest connected component. A place inside an obstacle connects to these."""
    offsets: IntArray
    """(8,) flat index steps of the moves."""
    stride: int
    has_tight_moves: bool
    shifts_nodes: bool


@lru_cache(maxsize=16)
def search_map(grid: Grid, clearance_m: float = 0.0, shifts_nodes: bool = False) -> SearchMap:
    """Prepare a grid for searching. Cached, since a grid is planned on many times.

    With `shifts_nodes` a path passes by the shifted `places` of nodes.
    """
    rows, cols = grid.shape
    stride = cols + 2
    blocked = np.ones((rows + 2, stride), dtype=np.bool_)
    blocked[1:-1, 1:-1] = grid.blocked
    moves = _legal_moves(blocked)
    tight_nodes = np.zeros_like(blocked)
    tight_moves = np.zeros_like(moves)
    node_shift = np.zeros_like(moves)
    clearance = clearance_m / grid.spacing_m
    inner = (slice(1, -1), slice(1, -1))
    if shifts_nodes and clearance > 0.5:
        node_shift[inner], tight_nodes[inner] = shifted_nodes(
            grid.blocked, clearance, _SHIFT_ROWS, _SHIFT_COLS
        )
        tight_moves[inner] = find_tight_moves(
            grid.blocked,
            clearance,
            moves[inner].copy(),
            tight_nodes[inner].copy(),
            node_shift[inner].copy(),
            _SHIFT_ROWS,
            _SHIFT_COLS,
        )
    else:
        tight_nodes[inner] = grid.inflate(clearance_m).blocked & ~grid.blocked
        tight_moves[inner] = _moves_of(tight_nodes, moves)
    has_tight_moves = bool(tight_moves.any())
    # Diagonals need two free straight neighbours, so straight moves decide what is connected.
    component, count = ndimage.label(~blocked)
    largest_component = (
        component == (1 + int(np.argmax(np.bincount(component.ravel())[1:])))
        if count
        else np.zeros_like(blocked)
    )
    offsets = np.array([r * stride + c for r, c in zip(ROW_STEP, COL_STEP, strict=True)], dtype=np.int64)
    order: ByteArray | UInt16Array = moves.ravel()
    remaining = UNIFORM_TABLE
    if has_tight_moves:
        mixed = _around(tight_moves > 0) & _around(~blocked & (tight_moves != moves))
        order, remaining = prune_moves(
            moves.ravel(), tight_moves.ravel(), mixed.ravel(), offsets, UNIFORM_TABLE, MAX_TABLE_ROWS
        )
    return SearchMap(
        moves.ravel(),
        tight_moves.ravel(),
        pack_nodes(order, tight_moves.ravel()),
        list_moves(remaining),
        tight_nodes.ravel(),
        node_shift.ravel(),
        component.ravel(),
        largest_component.ravel(),
        offsets,
        stride,
        has_tight_moves,
        shifts_nodes,
    )


def cells(smap: SearchMap, flat: IntArray) -> FloatArray:
    """Return flat nodes as (k, 2) positions in cells."""
    rows, cols = np.divmod(flat, smap.stride)
    return np.column_stack((cols - 1, rows - 1)).astype(np.float64)


def places(smap: SearchMap, flat: IntArray) -> FloatArray:
    """Return the shifted positions of flat nodes, (k, 2) in cells."""
    node_shift = smap.node_shift[flat]
    return cells(smap, flat) + np.column_stack((_SHIFT_COLS[node_shift], _SHIFT_ROWS[node_shift]))


def flat_index(smap: SearchMap, node: Node) -> int:
    """Return the index of a node in the flat arrays."""
    return (node[0] + 1) * smap.stride + node[1] + 1


def _around(nodes: BoolArray) -> BoolArray:
    return ndimage.binary_dilation(nodes, structure=np.ones((3, 3), dtype=np.bool_))


def _moves_of(nodes: BoolArray, moves: ByteArray) -> ByteArray:
    """Return the legal moves from or to some nodes, without the border."""
    rows, stride = nodes.shape
    found = np.where(nodes[1:-1, 1:-1], np.uint8(255), np.uint8(0))
    for move, (r, c) in enumerate(zip(ROW_STEP, COL_STEP, strict=True)):
        there = nodes[1 + r : rows - 1 + r, 1 + c : stride - 1 + c]
        found |= there.view(np.uint8) << np.uint8(move)
    return found & moves[1:-1, 1:-1]


def _legal_moves(blocked: BoolArray) -> ByteArray:
    """Return a byte of legal moves for each node of a map with a blocked border."""
    rows, stride = blocked.shape
    free = ~blocked
    moves = np.zeros((rows, stride), dtype=np.uint8)
    for move, (r, c) in enumerate(zip(ROW_STEP, COL_STEP, strict=True)):
        legal = free[1:-1, 1:-1] & free[1 + r : rows - 1 + r, 1 + c : stride - 1 + c]
        if r and c:
            legal &= free[1 + r : rows - 1 + r, 1:-1]
            legal &= free[1:-1, 1 + c : stride - 1 + c]
        moves[1:-1, 1:-1] |= legal.view(np.uint8) << np.uint8(move)
    return moves
