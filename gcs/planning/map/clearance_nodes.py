"""Clearance-shifted nodes: nodes moved by half a cell, so that the search finds narrow gaps.

A gap of two cells has a clearance of one cell in its middle, half-way between two rows of nodes. A node with
too little clearance is therefore represented by the best of eight positions half a cell around it. A cell is
tight if none of these has the clearance. A move is tight if it starts or ends at a tight cell, or if its leg
between the shifted positions has too little clearance.

For routes of any angle ("pulled", "flyable") only. Routes along the grid use unshifted nodes.
"""

from __future__ import annotations

import numpy as np

from gcs.jit import Call, kernel
from gcs.model import BoolArray, ByteArray, FloatArray
from gcs.planning.map.grid import free_grid
from gcs.planning.map.line_of_sight import NO_CELL, clear_leg, clearance_at, is_clear_at

_MAX_CLEARANCE_BY_ENDS = 1.4
"""In cells: up to this clearance a diagonal move keeps it if both ends do."""


@kernel
def shifted_nodes(
    blocked: BoolArray, clearance: float, shift_rows: FloatArray, shift_cols: FloatArray
) -> tuple[ByteArray, BoolArray]:
    """Return the shift index of each cell, (rows, cols), and the tight cells, for a clearance in cells.

    `shift_rows`, `shift_cols` (9,): shifts from the node; the first is zero.
    """
    rows, cols = blocked.shape
    place = np.zeros((rows, cols), np.uint8)
    tight = np.zeros((rows, cols), np.bool_)
    for row in range(rows):
        for col in range(cols):
            if blocked[row, col] or is_clear_at(blocked, float(col), float(row), clearance):
                continue
            best = 0.0
            for k in range(1, 9):
                x = col + shift_cols[k]
                y = row + shift_rows[k]
                on_map = 0.0 <= x <= cols - 1.0 and 0.0 <= y <= rows - 1.0
                if not on_map or not is_clear_at(blocked, x, y, clearance):
                    continue
                margin = clearance_at(blocked, x, y, clearance + 0.5)
                if margin > best:
                    best = margin
                    place[row, col] = k
            tight[row, col] = best == 0.0
    return place, tight


@kernel
def find_tight_moves(
    blocked: BoolArray, clearance: float, moves: ByteArray, tight: BoolArray, place: ByteArray,
    shift_rows: FloatArray, shift_cols: FloatArray,
) -> ByteArray:  # fmt: skip
    """Return the legal moves with too little clearance, as bits (rows, cols) like `moves`."""
    rows, cols = blocked.shape
    tight_moves = np.zeros((rows, cols), np.uint8)
    for row in range(rows):
        for col in range(cols):
            for move in range(8):
                if not (moves[row, col] >> move) & 1:
                    continue
                r = row + int(2.0 * shift_rows[move + 1])
                c = col + int(2.0 * shift_cols[move + 1])
                a = place[row, col]
                b = place[r, c]
                if tight[row, col] or tight[r, c]:
                    is_near = True
                elif a == 0 and b == 0 and (move < 4 or clearance < _MAX_CLEARANCE_BY_ENDS):
                    is_near = False
                elif r < row or (r == row and c < col):
                    # The reverse move is known: moves 0-3 and 4-7 turn by quarters.
                    back = (move & 4) | ((move + 2) & 3)
                    is_near = ((tight_moves[r, c] >> back) & 1) != 0
                else:
                    x = col + shift_cols[a]
                    y = row + shift_rows[a]
                    is_near = not clear_leg(
                        blocked, x, y, c + shift_cols[b], r + shift_rows[b], clearance, NO_CELL
                    )
                if is_near:
                    tight_moves[row, col] |= np.uint8(1 << move)
    return tight_moves


def warm_up_calls() -> list[Call]:
    """Return one call of every kernel with the types of a plan."""
    blocked = free_grid((2, 2), 10.0).blocked
    tight = np.zeros((2, 2), np.bool_)
    bits = np.zeros((2, 2), np.uint8)
    places = np.zeros(9)
    return [
        (shifted_nodes, blocked, 1.0, places, places),
        (find_tight_moves, blocked, 1.0, bits, tight, bits, places, places),
    ]
