"""The legal moves of a map, and which of them a search need not look at.

Moves go to the eight neighbours; a straight move costs 1, a diagonal one sqrt(2) (in cells), and a diagonal
needs both of the straight neighbours beside it to be free: corners are not cut. The legal moves of every node
are packed into one byte, on a map with a blocked border, so that the inner loops of the searches need no
bounds and no obstacle tests.

Which of them a search need not look at is in `gcs.planning.search.canonical_ordering`.

*Clearance*: nodes nearer to an obstacle than wanted are tight, and a move from or to a tight node is near and
counts `TIGHT` times. So clearance is given up where there is no other way, or none but a long detour; and a
place that lies in the tight zone leaves it at once. Counting near moves a thousandfold, as good as forbidding
them, was tried on random maps with 25 m of clearance: where a fifth of the nodes is blocked, no route can
keep it, and routes nearly doubled in length to save single near moves; eightfold they grow by a third. For
routes of any angle, nodes may lean away from obstacles (`gcs.planning.map.clearance_nodes`).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from gcs.model import FloatArray
from gcs.planning.map.clearance_nodes import lean, near_moves
from gcs.planning.map.grid import BoolArray, Grid, Node
from gcs.planning.search.canonical_ordering import (
    ANSWERS,
    COL_STEP,
    MOST_ANSWERS,
    ROW_STEP,
    ByteArray,
    IntArray,
    canonical,
    listed,
    packed,
)

_LEAN_ROWS, _LEAN_COLS = (0.5 * np.array([0, *steps]) for steps in (ROW_STEP, COL_STEP))
"""Where a node may lean: nowhere, or half a move."""


class SearchMap(NamedTuple):
    """A grid as the kernels read it; flat arrays over a map with a border of one blocked node all around."""

    moves: ByteArray
    """Bit d is set if move d is legal from this node."""
    near: ByteArray
    """Bit d is set if move d comes nearer to an obstacle than the clearance."""
    packed: npt.NDArray[np.uint32]
    """What searches know of a node, where the moves to look at are listed and which are near, and
    `lists`: those lists; see `gcs.planning.search.canonical_ordering`."""
    lists: npt.NDArray[np.uint32]
    tight: BoolArray
    """Nodes (or all places to lean to) that are nearer to an obstacle than the clearance."""
    leaning: ByteArray
    """Where a node leans: see `places`."""
    part: npt.NDArray[np.int32]
    """Number of the connected part of the map that a node is of; 0: blocked."""
    mainland: BoolArray
    """Free nodes of the largest connected part of the map: where a place inside an obstacle is left to."""
    offsets: IntArray
    """(8,) flat index steps of the moves."""
    stride: int
    any_near: bool
    shifts_nodes: bool


@lru_cache(maxsize=16)
def search_map(grid: Grid, clearance_m: float = 0.0, shifts_nodes: bool = False) -> SearchMap:
    """Prepare a grid for searching; kept for the grids last used, since a grid is planned on many times.

    With `shifts_nodes` nodes need not be passed themselves, but only near by, at their `places`.
    """
    rows, cols = grid.shape
    stride = cols + 2
    blocked = np.ones((rows + 2, stride), dtype=np.bool_)
    blocked[1:-1, 1:-1] = grid.blocked
    moves = _legal_moves(blocked)
    tight, near, leaning = np.zeros_like(blocked), np.zeros_like(moves), np.zeros_like(moves)
    reach, inner = clearance_m / grid.spacing_m, (slice(1, -1), slice(1, -1))
    if shifts_nodes and reach > 0.5:
        leaning[inner], tight[inner] = lean(grid.blocked, reach, _LEAN_ROWS, _LEAN_COLS)
        near[inner] = near_moves(
            *(grid.blocked, reach, moves[inner].copy(), tight[inner].copy(), leaning[inner].copy()),
            *(_LEAN_ROWS, _LEAN_COLS),
        )
    else:
        tight[inner] = grid.inflate(clearance_m).blocked & ~grid.blocked
        near[inner] = _moves_of(tight, moves)
    any_near = bool(near.any())
    # Diagonals need two free straight neighbours, so what is connected at all is connected by straight moves.
    part, count = ndimage.label(~blocked)
    mainland = (
        part == (1 + int(np.argmax(np.bincount(part.ravel())[1:]))) if count else np.zeros_like(blocked)
    )
    offsets = np.array([r * stride + c for r, c in zip(ROW_STEP, COL_STEP, strict=True)], dtype=np.int64)
    order, remaining = moves.ravel(), ANSWERS
    if any_near:
        mixed = _around(near > 0) & _around(~blocked & (near != moves))
        order, remaining = canonical(
            *(moves.ravel(), near.ravel(), mixed.ravel(), offsets, ANSWERS, MOST_ANSWERS)
        )
    return SearchMap(
        moves.ravel(),
        near.ravel(),
        packed(order, near.ravel()),
        listed(remaining),
        tight.ravel(),
        leaning.ravel(),
        part.ravel(),
        mainland.ravel(),
        offsets,
        stride,
        any_near,
        shifts_nodes,
    )


def kernel_arrays(smap: SearchMap) -> tuple[npt.NDArray[np.uint32], bool, IntArray]:
    """Return what the search kernels begin their arguments with."""
    return smap.lists, smap.any_near, smap.offsets


def cells(smap: SearchMap, flat: IntArray) -> FloatArray:
    """Return flat nodes as (k, 2) places in cells."""
    rows, cols = np.divmod(flat, smap.stride)
    return np.column_stack((cols - 1, rows - 1)).astype(np.float64)


def places(smap: SearchMap, flat: IntArray) -> FloatArray:
    """Return where to pass by flat nodes, (k, 2) in cells: there, or where they lean to."""
    leaning = smap.leaning[flat]
    return cells(smap, flat) + np.column_stack((_LEAN_COLS[leaning], _LEAN_ROWS[leaning]))


def flat_index(smap: SearchMap, node: Node) -> int:
    """Return a node's index in the flat arrays of a search map."""
    return (node[0] + 1) * smap.stride + node[1] + 1


def _around(nodes: BoolArray) -> BoolArray:
    found: BoolArray = ndimage.binary_dilation(nodes, structure=np.ones((3, 3), dtype=np.bool_))
    return found


def _moves_of(nodes: BoolArray, moves: ByteArray) -> ByteArray:
    """Return which legal moves lead from or to some nodes, without the border."""
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
