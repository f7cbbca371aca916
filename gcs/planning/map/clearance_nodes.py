"""Nodes that lean away from obstacles, so that a way finds gaps which are wide enough but hold no node.

A gap of two cells is wide enough for a clearance of a whole cell: in its middle, half-way between two rows of
nodes. So where a node itself is nearer to an obstacle than the clearance, the best of the eight places half a
cell around it stands for its cell. A cell is tight when it has no such place; a move is near when it leads
from or to a tight cell, or its leg between two places comes nearer than the clearance.

This is for routes of any angle, which bend where they like. Along the grid a node is where it is.
"""

from __future__ import annotations

import numpy as np

from gcs.jit import Call, kernel
from gcs.planning.map.grid import free_grid
from gcs.planning.map.line_of_sight import clear_leg, is_clear_at, room_at

_NO_CELL = np.int64(-1)
_ENDS_TELL = 1.4
"""In cells: up to this clearance a diagonal between two nodes keeps it if its ends do."""


@kernel
def lean(blocked, reach, lean_rows, lean_cols):  # type: ignore[no-untyped-def]
    """Which place stands for each cell, (rows, cols), and which cells are tight, by a clearance in cells.

    `lean_rows`, `lean_cols` (9,): the places, from the node; the first is the node's own.
    """
    rows, cols = blocked.shape
    place, tight = np.zeros((rows, cols), np.uint8), np.zeros((rows, cols), np.bool_)
    for row in range(rows):
        for col in range(cols):
            if blocked[row, col] or is_clear_at(blocked, float(col), float(row), reach):
                continue
            best = 0.0
            for k in range(1, 9):
                x, y = col + lean_cols[k], row + lean_rows[k]
                on_map = 0.0 <= x <= cols - 1.0 and 0.0 <= y <= rows - 1.0
                if not on_map or not is_clear_at(blocked, x, y, reach):
                    continue
                room = room_at(blocked, x, y, reach + 0.5)
                if room > best:
                    best, place[row, col] = room, k
            tight[row, col] = best == 0.0
    return place, tight


@kernel
def near_moves(blocked, reach, moves, tight, place, lean_rows, lean_cols):  # type: ignore[no-untyped-def]
    """Which legal moves come nearer than the clearance: bits, (rows, cols), as `moves` are."""
    rows, cols = blocked.shape
    near = np.zeros((rows, cols), np.uint8)
    for row in range(rows):
        for col in range(cols):
            for move in range(8):
                if not (moves[row, col] >> move) & 1:
                    continue
                r, c = row + int(2.0 * lean_rows[move + 1]), col + int(2.0 * lean_cols[move + 1])
                a, b = place[row, col], place[r, c]
                if tight[row, col] or tight[r, c]:
                    is_near = True
                elif a == 0 and b == 0 and (move < 4 or reach < _ENDS_TELL):
                    is_near = False
                elif r < row or (r == row and c < col):
                    # The way back, which has been looked at: moves 0-3 and 4-7 turn by quarters.
                    back = (move & 4) | ((move + 2) & 3)
                    is_near = ((near[r, c] >> back) & 1) != 0
                else:
                    x, y = col + lean_cols[a], row + lean_rows[a]
                    is_near = not clear_leg(
                        blocked, x, y, c + lean_cols[b], r + lean_rows[b], reach, _NO_CELL
                    )
                if is_near:
                    near[row, col] |= np.uint8(1 << move)
    return near


def warm_up_calls() -> list[Call]:
    """One call of every kernel, types as in a plan."""
    blocked, tight = free_grid((2, 2), 10.0).blocked, np.zeros((2, 2), np.bool_)
    bits, places = np.zeros((2, 2), np.uint8), np.zeros(9)
    return [
        (lean, blocked, 1.0, places, places),
        (near_moves, blocked, 1.0, bits, tight, bits, places, places),
    ]
