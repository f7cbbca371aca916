"""Moves to the eight neighbours, their costs, and the canonical ordering that prunes them.

A straight move costs 1, a diagonal sqrt(2) (in cells). A tight move, with less than the required clearance,
costs `TIGHT_MOVE_COST` times as much.

*Canonical ordering* keeps one of many equally short paths. Sources: D. Harabor and A. Grastien, jump point
search, AAAI 2011 and 2014; N. R. Sturtevant and S. Rabin, IJCAI 2016; M. Carlson et al., AAAI 2023, for
weights. Let a search reach x from p. A neighbour n of x is pruned if another path of one or two moves leads
from p to n that is

- shorter: then no shortest path from p to n leads over x;
- or as long, with a cheaper last move.

Every node still gets its exact cost. Proof: let x be the predecessor farthest from the start of all that
precede n on a shortest path. Its move to n is the cheapest. It is never pruned as longer, since it lies on a
shortest path; nor as equally long, since then a node farther still would precede n. By induction x has its
exact cost.

With uniform costs around x this gives the jump-point rules. After a diagonal move the same diagonal and its
two straight parts remain. After a straight move the same move remains; a blocked cell beside p also forces
the turn to that side and the diagonal towards it. The cell beside p can be read off the legal moves of x, so
the result depends on the arrival move and the byte of legal moves alone. Elsewhere it is computed node by
node; only some hundred different rows occur.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from gcs.jit import Call, inlined, int64, kernel
from gcs.model import BoolArray, ByteArray, IntArray, UInt16Array, UInt32Array

TIGHT_MOVE_COST = 8.0
"""Cost factor of a tight move."""

DIAGONAL = math.sqrt(2.0)

# Moves in the order east, north, west, south, north-east, north-west, south-west, south-east.
ROW_STEP = (0, 1, 0, -1, 1, 1, -1, -1)
COL_STEP = (1, 0, -1, 0, 1, -1, -1, 1)
_STEPS = list(zip(ROW_STEP, COL_STEP, strict=True))
_MOVE_OF = {step: move for move, step in enumerate(_STEPS)}
NO_MOVE = 8
"""Arrival move of the start node."""

# The packed 32-bit word of a node: arrival move, row of the table of remaining moves, tight moves. One load
# fetches all.
ARRIVAL_MASK = 15
ORDER_BIT = 4
TIGHT_BIT = 20
LIST_MASK = (1 << TIGHT_BIT) - 1
"""Arrival move and row: the index of the list of remaining moves."""
MAX_MOVES = 8
"""Greatest number of remaining moves: all eight, at the start node."""

_UNIFORM = 0
"""First row of the canonical moves with uniform costs, by the byte of legal moves."""
_ALL = 256
"""First row of all legal moves."""
MAX_TABLE_ROWS = 1 << 16
_SLOTS = 1 << 17
_TIE = 1e-9


@inlined
def move_length(move: int, tight: int) -> float:
    """Return the cost of a move in cells."""
    return (1.0 if move < 4 else DIAGONAL) * (TIGHT_MOVE_COST if tight else 1.0)


@inlined
def octile(rows: float, cols: float) -> float:
    """Return the octile distance in cells."""
    return max(rows, cols) + (DIAGONAL - 1.0) * min(rows, cols)


def _uniform_table() -> ByteArray:
    """Return the remaining moves for uniform costs, and all legal moves: bits, (512, 9), by arrival move."""
    table = np.zeros((512, 9), dtype=np.uint8)
    for legal in range(256):
        for move, (r, c) in enumerate(_STEPS):
            keep = 1 << move
            if r and c:
                keep |= (1 << _MOVE_OF[r, 0]) | (1 << _MOVE_OF[0, c])
            else:
                for side_r, side_c in ((c, r), (-c, -r)):
                    if not (legal >> _MOVE_OF[side_r - r, side_c - c]) & 1:
                        keep |= (1 << _MOVE_OF[side_r, side_c]) | (1 << _MOVE_OF[side_r + r, side_c + c])
            table[_UNIFORM + legal, move] = keep & legal
        table[_UNIFORM + legal, NO_MOVE] = legal
        table[_ALL + legal] = legal
    return table


def _alternatives() -> tuple[IntArray, IntArray]:
    """Return paths from p to n that avoid x: pairs of moves, or one move and `NO_MOVE`, (k, 2).

    Also returns where the alternatives to move d followed by e begin: index 8 d + e, (65,).
    """
    alternatives: list[tuple[int, int]] = []
    first = [0]
    for d, (row, col) in enumerate(_STEPS):
        for r, c in _STEPS:
            if (row + r, col + c) in _MOVE_OF:
                alternatives.append((_MOVE_OF[row + r, col + c], NO_MOVE))
            for f, (other_r, other_c) in enumerate(_STEPS):
                last = _MOVE_OF.get((row + r - other_r, col + c - other_c))
                if f != d and last is not None:
                    alternatives.append((f, last))
            first.append(len(alternatives))
    return np.array(alternatives), np.array(first)


UNIFORM_TABLE = _uniform_table()
_ALTERNATIVES, _FIRST_ALTERNATIVE = _alternatives()
_BACK = np.array([_MOVE_OF[-r, -c] for r, c in _STEPS])


@inlined
def _has_move(moves: ByteArray, node: int, move: int) -> int:
    return (moves[node] >> move) & 1


@inlined
def _cost(tight: ByteArray, node: int, move: int) -> float:
    return move_length(move, _has_move(tight, node, move))


@inlined
def _is_needed(moves: ByteArray, tight: ByteArray, offsets: IntArray, p: int, x: int, d: int, e: int) -> bool:
    """Return True if move e from x remains when move d led from p to x."""
    last = _cost(tight, x, e)
    cost = _cost(tight, p, d) + last
    needed = True
    for k in range(_FIRST_ALTERNATIVE[8 * d + e], _FIRST_ALTERNATIVE[8 * d + e + 1]):
        one = _ALTERNATIVES[k, 0]
        two = _ALTERNATIVES[k, 1]
        if _has_move(moves, p, one) and (two == NO_MOVE or _has_move(moves, p + offsets[one], two)):
            end = _cost(tight, p, one) if two == NO_MOVE else _cost(tight, p + offsets[one], two)
            other = end if two == NO_MOVE else _cost(tight, p, one) + end
            if other < cost - _TIE or (other < cost + _TIE and end < last - _TIE):
                needed = False
                break
    return needed


@kernel
def prune_moves(
    moves: ByteArray, tight: ByteArray, mixed: BoolArray, offsets: IntArray, answers: ByteArray, max_rows: int
) -> tuple[UInt16Array, ByteArray]:
    """Compute the remaining moves of each node: a row index (flat nodes,) and the table of rows, (k, 9).

    `mixed` nodes, with tight and other moves around them, are computed one by one. Others use `answers`,
    indexed by their legal moves. All legal moves remain at nodes for which a table of `max_rows` has no row
    left.
    """
    order = np.empty(moves.size, np.uint16)
    size = answers.shape[0]
    table = np.empty((max_rows, 9), np.uint8)
    for k in range(size):
        for d in range(9):
            table[k, d] = answers[k, d]
    slots = np.zeros(_SLOTS, np.int32)
    keys = np.empty(max_rows, np.uint64)
    for x in range(moves.size):
        legal = int64(moves[x])
        order[x] = _UNIFORM + legal
        if legal == 0 or not mixed[x]:
            continue
        key = np.uint64(0)
        for d in range(8):
            if not (legal >> _BACK[d]) & 1:
                continue
            keep = 0
            p = x - offsets[d]
            for e in range(8):
                if (legal >> e) & 1 and e != _BACK[d] and _is_needed(moves, tight, offsets, p, x, d, e):
                    keep |= 1 << e
            key |= np.uint64(keep) << np.uint64(8 * d)
        hashed = key * np.uint64(0x9E3779B97F4A7C15) + np.uint64(legal) * np.uint64(0xC2B2AE3D27D4EB4F)
        slot = int64(hashed >> np.uint64(47))
        while slots[slot] > 0 and (keys[slots[slot]] != key or table[slots[slot], NO_MOVE] != legal):
            slot = (slot + 1) & (_SLOTS - 1)
        if slots[slot] == 0:
            if size == max_rows:
                order[x] = _ALL + legal
                continue
            slots[slot] = size
            keys[size] = key
            table[size, NO_MOVE] = legal
            for d in range(8):
                table[size, d] = (key >> np.uint64(8 * d)) & np.uint64(255)
            size += 1
        order[x] = slots[slot]
    return order, table[:size].copy()


def pack_nodes(order: npt.NDArray[Any], tight: ByteArray) -> UInt32Array:
    """Pack row indices and tight moves into the 32-bit words of nodes."""
    rows = order.astype(np.uint32) << np.uint32(ORDER_BIT)
    return rows | (tight.astype(np.uint32) << np.uint32(TIGHT_BIT))


def list_moves(answers: ByteArray) -> UInt32Array:
    """Convert sets of moves (bits), (k, 9), to lists, (16 k,): a count and three bits for each move.

    The `LIST_MASK` bits of a packed word index the lists.
    """
    sets = np.zeros((len(answers), ARRIVAL_MASK + 1), dtype=np.uint32)
    sets[:, : answers.shape[1]] = answers
    counts = np.zeros_like(sets)
    lists = np.zeros_like(sets)
    for move in range(8):
        is_in = (sets >> np.uint32(move)) & np.uint32(1)
        lists |= np.where(is_in > 0, np.uint32(move) << (4 + 3 * counts), np.uint32(0)).astype(np.uint32)
        counts += is_in
    return np.asarray(lists | counts).ravel()


def warm_up_calls() -> list[Call]:
    """Return one call of the kernel with the types of a plan."""
    moves = np.zeros(4, np.uint8)
    offsets = np.zeros(8, np.int64)
    return [(prune_moves, moves, moves, moves > 0, offsets, UNIFORM_TABLE, MAX_TABLE_ROWS)]
