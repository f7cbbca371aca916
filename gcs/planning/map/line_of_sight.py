"""Exact line of sight: the distance of a straight leg from blocked cells. Nothing is sampled.

A blocked cell is a closed square, so a leg that touches an edge or corner is blocked. Leg and square are
convex: if they do not meet, the least distance is at an end of the leg or at a corner of the square. Only
cells in the corridor of the leg, widened by the clearance, are tested.

Kernels work in cells (x = column, y = row); public functions in metres.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import inlined, int64, kernel, leaf
from gcs.model import BoolArray, FloatArray
from gcs.planning.map.grid import TOUCH, Grid, Point

NO_CELL = int64(-1)
"""No ignored cell. A literal -1 would compile the callees once more."""
_NO_LEG = 1e-100
_HALF_SQUARE = 0.7072
"""Half the diagonal of a cell, rounded up: the extent of a square along any leg."""


@inlined
def _point_square(x: float, y: float, col: float, row: float) -> float:
    """Return the distance of a point from the square of a cell."""
    return math.hypot(max(abs(x - col) - 0.5, 0.0), max(abs(y - row) - 0.5, 0.0))


@inlined
def _leg_square(x0: float, y0: float, x1: float, y1: float, col: float, row: float) -> float:
    """Return the distance of a leg from the square of a cell."""
    dx = x1 - x0
    dy = y1 - y0
    # Clip the leg by the two slabs of the square.
    low = 0.0
    high = 1.0
    for axis in range(2):
        start, step, centre = (x0, dx, col) if axis == 0 else (y0, dy, row)
        if step != 0.0:
            a = (centre - 0.5 - start) / step
            b = (centre + 0.5 - start) / step
            low = max(low, min(a, b))
            high = min(high, max(a, b))
        elif abs(start - centre) > 0.5:
            high = -1.0
    if low <= high:
        return 0.0
    best = min(_point_square(x0, y0, col, row), _point_square(x1, y1, col, row))
    norm2 = dx * dx + dy * dy
    for corner in range(4):
        x = col - 0.5 + (corner >> 1)
        y = row - 0.5 + (corner & 1)
        along = 0.0 if norm2 == 0.0 else min(max(((x - x0) * dx + (y - y0) * dy) / norm2, 0.0), 1.0)
        best = min(best, math.hypot(x - x0 - along * dx, y - y0 - along * dy))
    return best


@leaf
def leg_clearance(
    blocked: BoolArray, x0: float, y0: float, x1: float, y1: float, clearance: float, ignored_cell: int
) -> float:
    """Return the distance in cells of a leg from the nearest blocked cell, at most `clearance`.

    `ignored_cell` is a flat index, -1 for none.
    """
    rows, cols = blocked.shape
    wide = clearance + 0.5 + 2.0 * TOUCH
    dx = x1 - x0
    dy = y1 - y0
    best = clearance
    first = max(0, math.ceil(min(y0, y1) - wide))
    last = min(rows - 1, math.floor(max(y0, y1) + wide))
    for row in range(first, last + 1):
        if abs(dy) < 1e-12:
            low = min(x0, x1)
            high = max(x0, x1)
        else:
            ta = min(max((row - wide - y0) / dy, 0.0), 1.0)
            tb = min(max((row + wide - y0) / dy, 0.0), 1.0)
            low = x0 + min(ta * dx, tb * dx)
            high = x0 + max(ta * dx, tb * dx)
        for col in range(max(0, math.ceil(low - wide)), min(cols - 1, math.floor(high + wide)) + 1):
            if blocked[row, col] and row * cols + col != ignored_cell:
                best = min(best, _leg_square(x0, y0, x1, y1, col, row))
    return best


@leaf
def blocking_cell(
    blocked: BoolArray, x0: float, y0: float, x1: float, y1: float, clearance: float, ignored_cell: int,
    guess: int,
) -> int:  # fmt: skip
    """Return the flat index of a blocked cell nearer to a leg than `clearance`; -1 for none.

    `guess` is tested first: neighbouring legs often share their obstacle. `ignored_cell` does not count.
    """
    rows, cols = blocked.shape
    limit = max(clearance - TOUCH, TOUCH)
    wide = clearance + 0.5 + 2.0 * TOUCH
    dx = x1 - x0
    dy = y1 - y0
    norm2 = dx * dx + dy * dy
    # The squared length of a very short leg may underflow.
    length = math.sqrt(norm2) if norm2 > _NO_LEG else math.hypot(dx, dy)
    # The distance from the line through the leg is a lower bound, which excludes most cells. It is exact for
    # a square that lies alongside the leg.
    near_line = limit * length + 0.5 * (abs(dx) + abs(dy))
    maybe = near_line + TOUCH * length
    end = _HALF_SQUARE * length
    per_row = 0.0 if abs(dy) < 1e-12 else 1.0 / dy
    first = max(0, math.ceil(min(y0, y1) - wide))
    last = min(rows - 1, math.floor(max(y0, y1) + wide))
    row = first if guess < 0 or guess == ignored_cell else int64(-1)
    while row <= last:
        if row < 0:
            at = guess // cols
            left = right = guess - at * cols
        else:
            at = row
            if per_row == 0.0:
                low = min(x0, x1)
                high = max(x0, x1)
            else:
                ta = min(max((row - wide - y0) * per_row, 0.0), 1.0)
                tb = min(max((row + wide - y0) * per_row, 0.0), 1.0)
                low = x0 + min(ta * dx, tb * dx)
                high = x0 + max(ta * dx, tb * dx)
            left = max(0, math.ceil(low - wide))
            right = min(cols - 1, math.floor(high + wide))
        for col in range(left, right + 1):
            if not blocked[at, col] or at * cols + col == ignored_cell:
                continue
            across = abs((col - x0) * dy - (at - y0) * dx)
            if across > maybe:
                continue
            along = (col - x0) * dx + (at - y0) * dy
            if end < along < norm2 - end:
                if across < near_line:
                    return at * cols + col
            elif _leg_square(x0, y0, x1, y1, col, at) < limit:
                return at * cols + col
        row = first if row < 0 else row + 1
    return int64(-1)


@kernel
def clear_leg(
    blocked: BoolArray, x0: float, y0: float, x1: float, y1: float, clearance: float, ignored_cell: int
) -> bool:
    """Return True if a leg keeps `clearance` cells from every blocked cell but `ignored_cell` (-1: none)."""
    return blocking_cell(blocked, x0, y0, x1, y1, clearance, ignored_cell, NO_CELL) < 0


@kernel
def path_clearance(blocked: BoolArray, frame: FloatArray, path_m: FloatArray, most: float) -> float:
    """Return the distance in cells of a path from the nearest blocked cell, at most `most`.

    `frame`: east and north of the grid origin and spacing, in metres. `path_m` (k, 2 or more): east, north.
    """
    margin = most
    for i in range(path_m.shape[0] - 1):
        x = (path_m[i, 0] - frame[0]) / frame[2]
        y = (path_m[i, 1] - frame[1]) / frame[2]
        to_x = (path_m[i + 1, 0] - frame[0]) / frame[2]
        to_y = (path_m[i + 1, 1] - frame[1]) / frame[2]
        margin = leg_clearance(blocked, x, y, to_x, to_y, margin, NO_CELL)
    return margin


@kernel
def clearances_along(blocked: BoolArray, frame: FloatArray, path_m: FloatArray, most: float) -> FloatArray:
    """Return the distance in cells of each point of a path from the nearest blocked cell, at most `most`."""
    found = np.empty(path_m.shape[0])
    for i in range(path_m.shape[0]):
        x = (path_m[i, 0] - frame[0]) / frame[2]
        y = (path_m[i, 1] - frame[1]) / frame[2]
        found[i] = clearance_at(blocked, x, y, most)
    return found


@inlined
def is_free_at(blocked: BoolArray, x: float, y: float) -> bool:
    """Return True if a point lies in a free cell of the map: waypoints may lie nowhere else."""
    rows, cols = blocked.shape
    if not (-0.5 <= x <= cols - 0.5 and -0.5 <= y <= rows - 0.5):
        return False
    return not blocked[min(int(y + 0.5), rows - 1), min(int(x + 0.5), cols - 1)]


@leaf
def is_clear_at(blocked: BoolArray, x: float, y: float, clearance: float) -> bool:
    """Return True if a point keeps `clearance` cells from every blocked cell."""
    rows, cols = blocked.shape
    limit = max(clearance - TOUCH, TOUCH)
    wide = clearance + 0.5 + 2.0 * TOUCH
    for row in range(max(0, math.ceil(y - wide)), min(rows - 1, math.floor(y + wide)) + 1):
        for col in range(max(0, math.ceil(x - wide)), min(cols - 1, math.floor(x + wide)) + 1):
            if blocked[row, col] and _point_square(x, y, col, row) < limit:
                return False
    return True


@leaf
def clearance_at(blocked: BoolArray, x: float, y: float, clearance: float) -> float:
    """Return the distance in cells from a point to the nearest blocked cell, at most `clearance`."""
    rows, cols = blocked.shape
    best = clearance
    for row in range(
        max(0, math.ceil(y - clearance - 0.5)), min(rows - 1, math.floor(y + clearance + 0.5)) + 1
    ):
        for col in range(
            max(0, math.ceil(x - clearance - 0.5)), min(cols - 1, math.floor(x + clearance + 0.5)) + 1
        ):
            if blocked[row, col]:
                best = min(best, _point_square(x, y, col, row))
    return best


def line_of_sight(grid: Grid, from_m: Point, to_m: Point, clearance_m: float = 0.0) -> bool:
    """Return True if the leg between two points keeps `clearance_m` from every blocked cell.

    Without clearance the leg must not touch a blocked cell, not even a corner. A clearance is kept up to
    `TOUCH` cells. Nothing is blocked outside the map.
    """
    x0, y0 = to_cells(grid, from_m)
    x1, y1 = to_cells(grid, to_m)
    return bool(clear_leg(grid.blocked, x0, y0, x1, y1, max(clearance_m, 0.0) / grid.spacing_m, -1))


def to_cells(grid: Grid, point_m: Point) -> tuple[float, float]:
    """Return a point in cells: (column, row) as floats."""
    return (
        (point_m[0] - grid.origin_m[0]) / grid.spacing_m,
        (point_m[1] - grid.origin_m[1]) / grid.spacing_m,
    )
