"""The legal moves of a map, and which of them a search need not look at.

Moves go to the eight neighbours; a straight move costs 1, a diagonal one sqrt(2) (in cells), and a diagonal
needs both of the straight neighbours beside it to be free: corners are not cut. The legal moves of every node
are packed into one byte, on a map with a blocked border, so that the inner loops of the searches need no
bounds and no obstacle tests.

*Canonical order* (after the pruning rules of D. Harabor and A. Grastien, AAAI 2011 and 2014, and N. R.
Sturtevant and S. Rabin, IJCAI 2016). Of the many equally short ways across open ground one is enough: the one
that takes its diagonals first. Let a search have come from p to x by a move d. A neighbour n of x is left out
if p reaches it without x in less, or in as much with the diagonal earlier:

- after a diagonal move only the same diagonal and its two straight parts remain;
- after a straight move only the same move remains; but where the cell beside p is blocked, the turn to that
  side and the diagonal towards it remain as well, since no other way leads there.

What blocks the cells beside p can be read off x: if the cell beside x is free, then the diagonal from x back
past it is legal just when the cell beside p is free. So what remains depends on d and on the byte of legal
moves alone, and is looked up in a table of 9 x 256 bytes (`REMAINING`; the ninth row, all that is legal, is
for where a search begins).

Every node is still given its exact cost, whichever of several equally short ways came first: a straight move
is left out only where it is longer than another way, never where it is as long. So a node that can be reached
optimally by a straight move is; and a last diagonal move is left out for being equal only where a straight
one is equal.

*Clearance*: nodes nearer to an obstacle than wanted are tight, and a move from or to a tight node is near and
counts `TIGHT` times. So clearance is given up where there is no other way, or none but a long detour; and a
place that lies in the tight zone leaves it at once. Counting near moves a thousandfold, as good as forbidding
them, was tried on random maps with 25 m of clearance: where a fifth of the nodes is blocked, no route can
keep it, and routes nearly doubled in length to save single near moves; eightfold they grow by a third. The
argument above holds where all moves from a node and its neighbours are near or none is; where they are mixed,
nothing is left out. For routes of any angle, nodes may lean away from obstacles (`gcs.planning.leaning`).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from gcs.compiling import inlined
from gcs.model import FloatArray
from gcs.planning.grid import BoolArray, Grid, Node
from gcs.planning.leaning import lean, near_moves

IntArray: TypeAlias = npt.NDArray[np.int64]
ByteArray: TypeAlias = npt.NDArray[np.uint8]

TIGHT = 8.0
"""How many moves one tight move counts."""

DIAGONAL = math.sqrt(2.0)

# Moves in the order east, north, west, south, north-east, north-west, south-west, south-east.
ROW_STEP = (0, 1, 0, -1, 1, 1, -1, -1)
COL_STEP = (1, 0, -1, 0, 1, -1, -1, 1)
NO_MOVE = 8
"""Where a search begins: no move led there."""
_LEAN_ROWS, _LEAN_COLS = (0.5 * np.array([0, *steps]) for steps in (ROW_STEP, COL_STEP))
"""Where a node may lean: nowhere, or half a move."""


def _remaining() -> ByteArray:
    """Which moves to look at, by the move that led to a node and the legal moves from it: bits, (9, 256)."""
    steps = list(zip(ROW_STEP, COL_STEP, strict=True))
    bit = {step: 1 << move for move, step in enumerate(steps)}
    table = np.zeros((9, 256), dtype=np.uint8)
    for legal in range(256):
        for move, (r, c) in enumerate(steps):
            keep = bit[r, c]
            if r and c:
                keep |= bit[r, 0] | bit[0, c]
            else:
                for side_r, side_c in ((c, r), (-c, -r)):
                    if not legal & bit[side_r - r, side_c - c]:
                        keep |= bit[side_r, side_c] | bit[side_r + r, side_c + c]
            table[move, legal] = keep & legal
        table[NO_MOVE, legal] = legal
    return table


REMAINING = _remaining()
FIRST = np.array([0] + [(bits & -bits).bit_length() - 1 for bits in range(1, 256)], dtype=np.int64)
"""The lowest move in a set of moves (bits)."""


class SearchMap(NamedTuple):
    """A grid as the kernels read it; flat arrays over a map with a border of one blocked node all around."""

    moves: ByteArray
    """Bit d is set if move d is legal from this node."""
    near: ByteArray
    """Bit d is set if move d comes nearer to an obstacle than the clearance."""
    mixed: BoolArray
    """Some moves from the free nodes around (or from this one) are near, some not."""
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
    may_lean: bool


@lru_cache(maxsize=16)
def search_map(grid: Grid, clearance_m: float = 0.0, may_lean: bool = False) -> SearchMap:
    """Prepare a grid for searching; kept for the grids last used, since a grid is planned on many times.

    With `may_lean` nodes need not be passed themselves, but only near by, at their `places`.
    """
    rows, cols = grid.shape
    stride = cols + 2
    blocked = np.ones((rows + 2, stride), dtype=np.bool_)
    blocked[1:-1, 1:-1] = grid.blocked
    moves = _legal_moves(blocked)
    tight, near, leaning = np.zeros_like(blocked), np.zeros_like(moves), np.zeros_like(moves)
    reach, inner = clearance_m / grid.spacing_m, (slice(1, -1), slice(1, -1))
    if may_lean and reach > 0.5:
        leaning[inner], tight[inner] = lean(grid.blocked, reach, _LEAN_ROWS, _LEAN_COLS)
        near[inner] = near_moves(
            *(grid.blocked, reach, moves[inner].copy(), tight[inner].copy(), leaning[inner].copy()),
            *(_LEAN_ROWS, _LEAN_COLS),
        )
    else:
        tight[inner] = grid.inflate(clearance_m).blocked & ~grid.blocked
        near[inner] = _moves_of(tight, moves)
    any_near = bool(near.any())
    mixed = _around(near > 0) & _around(~blocked & (near != moves)) if any_near else tight
    # Diagonals need two free straight neighbours, so what is connected at all is connected by straight moves.
    part, count = ndimage.label(~blocked)
    mainland = (
        part == (1 + int(np.argmax(np.bincount(part.ravel())[1:]))) if count else np.zeros_like(blocked)
    )
    offsets = np.array([r * stride + c for r, c in zip(ROW_STEP, COL_STEP, strict=True)], dtype=np.int64)
    return SearchMap(
        moves.ravel(),
        near.ravel(),
        mixed.ravel(),
        tight.ravel(),
        leaning.ravel(),
        part.ravel(),
        mainland.ravel(),
        offsets,
        stride,
        any_near,
        may_lean,
    )


def kernel_arrays(smap: SearchMap) -> tuple[ByteArray, ByteArray, BoolArray, bool, IntArray]:
    """Return what the search kernels begin their arguments with."""
    return smap.moves, smap.near, smap.mixed, smap.any_near, smap.offsets


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


@inlined
def move_cost(move, near):  # type: ignore[no-untyped-def]
    """Cost in cells of a move, from or to a tight node or not."""
    return (1.0 if move < 4 else DIAGONAL) * (TIGHT if near else 1.0)


@inlined
def octile(rows, cols):  # type: ignore[no-untyped-def]
    """Length in cells of the shortest way over open ground."""
    return max(rows, cols) + (DIAGONAL - 1.0) * min(rows, cols)
