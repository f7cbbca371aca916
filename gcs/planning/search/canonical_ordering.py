"""Moves to the eight neighbours, what they cost, and which of them a search need not look at.

A straight move costs 1, a diagonal one sqrt(2) (in cells); a near move, one that comes nearer to an obstacle
than wanted, counts `TIGHT` times.

*Canonical order* (after the pruning rules of D. Harabor and A. Grastien, AAAI 2011 and 2014, N. R.
Sturtevant and S. Rabin, IJCAI 2016, and M. Carlson et al., AAAI 2023, for weights). Of the many equally short
ways across open ground one is enough. Let a search have come from p to x. A neighbour n of x is left out if
another way of one or two moves leads from p to n

- in less: then no shortest way comes from p by x to n;
- or in as much, with a cheaper last move.

Every node is still given its exact cost, whichever of several equally short ways came first. For let x be the
farthest of all nodes that precede n on some shortest way: its move to n is the cheapest. It is never left out
for being longer, since it lies on a shortest way; nor for being as long, since then a node farther yet would
precede n as well. And x has its exact cost by the same argument.

Where no move around is near, or all are, that means: after a diagonal move only the same diagonal and its two
straight parts remain; after a straight move only the same move remains, and where the cell beside p is
blocked also the turn to that side and the diagonal towards it, since no other way leads there. What blocks
the cells beside p can be read off x: if the cell beside x is free, then the diagonal from x back past it is
legal just when the cell beside p is free. So what remains depends on the move to x and on the byte of legal
moves of x alone. Elsewhere it is worked out node by node; only some hundred different answers occur.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from gcs.jit import Call, inlined, kernel

IntArray: TypeAlias = npt.NDArray[np.int64]
ByteArray: TypeAlias = npt.NDArray[np.uint8]

TIGHT = 8.0
"""How many moves one near move counts."""

DIAGONAL = math.sqrt(2.0)

# Moves in the order east, north, west, south, north-east, north-west, south-west, south-east.
ROW_STEP = (0, 1, 0, -1, 1, 1, -1, -1)
COL_STEP = (1, 0, -1, 0, 1, -1, -1, 1)
_STEPS = list(zip(ROW_STEP, COL_STEP, strict=True))
_MOVE_OF = {step: move for move, step in enumerate(_STEPS)}
NO_MOVE = 8
"""Where a search begins: no move led there."""

LED, ORDER_BIT, NEAR_BIT = 15, 4, 20
LISTED = (1 << NEAR_BIT) - 1
"""What a search knows of a node is packed into 32 bits, so that it is fetched at once: the move that led
there (`LED`), the row of the table of answers, and which moves are near."""
MOST_MOVES = 8
"""That remain from a node: all, where a search begins."""

_UNIFORM, _ALL = 0, 256
"""Where in the table the answers begin for a byte of legal moves: by the canonical order, and all of them."""
MOST_ANSWERS = 1 << 16
_SLOTS = 1 << 17
_TIE = 1e-9


@inlined
def move_cost(move, near):  # type: ignore[no-untyped-def]
    """Cost in cells of a move, near or not."""
    return (1.0 if move < 4 else DIAGONAL) * (TIGHT if near else 1.0)


@inlined
def octile(rows, cols):  # type: ignore[no-untyped-def]
    """Length in cells of the shortest way over open ground."""
    return max(rows, cols) + (DIAGONAL - 1.0) * min(rows, cols)


def _answers() -> ByteArray:
    """What remains where moves cost alike, and all legal moves: bits, (512, 9), by the move to a node."""
    table = np.zeros((512, 9), dtype=np.uint8)
    for legal in range(256):
        for move, (r, c) in enumerate(_STEPS):
            keep = 1 << move
            if r and c:
                keep |= 1 << _MOVE_OF[r, 0] | 1 << _MOVE_OF[0, c]
            else:
                for side_r, side_c in ((c, r), (-c, -r)):
                    if not legal >> _MOVE_OF[side_r - r, side_c - c] & 1:
                        keep |= 1 << _MOVE_OF[side_r, side_c] | 1 << _MOVE_OF[side_r + r, side_c + c]
            table[_UNIFORM + legal, move] = keep & legal
        table[_UNIFORM + legal, NO_MOVE] = legal
        table[_ALL + legal] = legal
    return table


def _others() -> tuple[IntArray, IntArray]:
    """Ways from p to n that are no way by x: pairs of moves, or one and `NO_MOVE`, (k, 2).

    Also where those begin that are an alternative to move d and then e: at index 8 d + e, (65,).
    """
    ways: list[tuple[int, int]] = []
    first = [0]
    for d, (row, col) in enumerate(_STEPS):
        for r, c in _STEPS:
            if (row + r, col + c) in _MOVE_OF:
                ways.append((_MOVE_OF[row + r, col + c], NO_MOVE))
            for f, (other_r, other_c) in enumerate(_STEPS):
                last = _MOVE_OF.get((row + r - other_r, col + c - other_c))
                if f != d and last is not None:
                    ways.append((f, last))
            first.append(len(ways))
    return np.array(ways), np.array(first)


ANSWERS = _answers()
_WAYS, _FIRST_WAY = _others()
_BACK = np.array([_MOVE_OF[-r, -c] for r, c in _STEPS])


@inlined
def _has(moves, node, move):  # type: ignore[no-untyped-def]
    return (moves[node] >> move) & 1


@inlined
def _cost(near, node, move):  # type: ignore[no-untyped-def]
    return move_cost(move, _has(near, node, move))


@inlined
def _is_needed(moves, near, offsets, p, x, d, e):  # type: ignore[no-untyped-def]
    """Whether move e from x is looked at when move d led from p to x."""
    last = _cost(near, x, e)
    cost, needed = _cost(near, p, d) + last, True
    for k in range(_FIRST_WAY[8 * d + e], _FIRST_WAY[8 * d + e + 1]):
        one, two = _WAYS[k, 0], _WAYS[k, 1]
        if _has(moves, p, one) and (two == NO_MOVE or _has(moves, p + offsets[one], two)):
            end = _cost(near, p, one) if two == NO_MOVE else _cost(near, p + offsets[one], two)
            other = end if two == NO_MOVE else _cost(near, p, one) + end
            if other < cost - _TIE or (other < cost + _TIE and end < last - _TIE):
                needed = False
                break
    return needed


@kernel
def canonical(moves, near, mixed, offsets, answers, most):  # type: ignore[no-untyped-def]
    """Which moves remain at each node: an index (flat nodes,), and the table that it leads to, (k, 9).

    `mixed` nodes, from which or from around which some moves are near and some are not, are worked out one by
    one; others read off `answers`, by their legal moves, as on a map where no move is near. Where more than
    `most` answers would be needed, all legal moves remain.
    """
    order, size = np.empty(moves.size, np.uint16), answers.shape[0]
    table = np.empty((most, 9), np.uint8)
    for k in range(size):
        for d in range(9):
            table[k, d] = answers[k, d]
    slots, keys = np.zeros(_SLOTS, np.int32), np.empty(most, np.uint64)
    for x in range(moves.size):
        legal = np.int64(moves[x])
        order[x] = _UNIFORM + legal
        if legal == 0 or not mixed[x]:
            continue
        key = np.uint64(0)
        for d in range(8):
            if not (legal >> _BACK[d]) & 1:
                continue
            keep, p = 0, x - offsets[d]
            for e in range(8):
                if (legal >> e) & 1 and e != _BACK[d] and _is_needed(moves, near, offsets, p, x, d, e):
                    keep |= 1 << e
            key |= np.uint64(keep) << np.uint64(8 * d)
        mashed = key * np.uint64(0x9E3779B97F4A7C15) + np.uint64(legal) * np.uint64(0xC2B2AE3D27D4EB4F)
        slot = np.int64(mashed >> np.uint64(47))
        while slots[slot] > 0 and (keys[slots[slot]] != key or table[slots[slot], NO_MOVE] != legal):
            slot = (slot + 1) & (_SLOTS - 1)
        if slots[slot] == 0:
            if size == most:
                order[x] = _ALL + legal
                continue
            slots[slot], keys[size], table[size, NO_MOVE] = size, key, legal
            for d in range(8):
                table[size, d] = (key >> np.uint64(8 * d)) & np.uint64(255)
            size += 1
        order[x] = slots[slot]
    return order, table[:size].copy()


def packed(order: npt.NDArray[Any], near: ByteArray) -> npt.NDArray[np.uint32]:
    """Pack what is known of nodes: rows of the table of answers, and near moves."""
    return order.astype(np.uint32) << np.uint32(ORDER_BIT) | near.astype(np.uint32) << np.uint32(NEAR_BIT)


def listed(answers: ByteArray) -> npt.NDArray[np.uint32]:
    """Turn sets of moves (bits), (k, 9), into lists, (16 k,): how many there are, and three bits for each.

    They are found at what is packed of a node, `LISTED` bits of it.
    """
    sets = np.zeros((len(answers), LED + 1), dtype=np.uint32)
    sets[:, : answers.shape[1]] = answers
    counts, lists = np.zeros_like(sets), np.zeros_like(sets)
    for move in range(8):
        is_in = (sets >> np.uint32(move)) & np.uint32(1)
        lists |= np.where(is_in > 0, np.uint32(move) << (4 + 3 * counts), np.uint32(0)).astype(np.uint32)
        counts += is_in
    return np.asarray(lists | counts).ravel()


def warm_up_calls() -> list[Call]:
    """One call of the kernel, types as in a plan."""
    moves, offsets = np.zeros(4, np.uint8), np.zeros(8, np.int64)
    return [(canonical, moves, moves, moves > 0, offsets, ANSWERS, MOST_ANSWERS)]
