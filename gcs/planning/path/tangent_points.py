"""Tangent points: the candidate vertices of string pulling.

They are the convex corners of blocked cells in a corridor around the known path. With a clearance, each
corner is wrapped by two points of the circumscribed octagon and the tip of the square. Each candidate has two
edges: a shortest path that turns there is tangent to the obstacle, so its legs lie on one side of both edges.
The vertices of the known path are candidates too.

Positions in cells: x = column, y = row.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.jit import called, inlined, leaf
from gcs.model import BoolArray, FloatArray, IntArray
from gcs.planning.map.line_of_sight import is_clear_at, is_free_at

_CORRIDOR_CELLS = 2.5
_CORNER_OFFSET = 1e-6
"""In cells: offset of a leg from an obstacle corner without clearance."""
_OCTAGON = 1.0 / math.cos(math.pi / 8.0)
_COS = _OCTAGON * math.cos(math.pi / 8.0)
_SIN = _OCTAGON * math.sin(math.pi / 8.0)

# Rows of the candidate array: position, distance along the path, and the directions of the two edges.
X = 0
Y = 1
ALONG = 2
E1X = 3
E1Y = 4
E2X = 5
E2Y = 6
ROWS = 7


class _Edges(NamedTuple):
    """Directions of the two edges of a candidate."""

    e1x: float
    e1y: float
    e2x: float
    e2y: float


class _Leg(NamedTuple):
    """Leg of the path: its begin, its direction, and the distance along the path up to it."""

    x: float
    y: float
    ux: float
    uy: float
    along: float


@inlined
def _is_free(blocked: BoolArray, row: int, col: int) -> bool:
    """Return True if a cell is free or outside the map."""
    rows, cols = blocked.shape
    return not (0 <= row < rows and 0 <= col < cols and blocked[row, col])


@inlined
def _add(
    blocked: BoolArray, clearance: float, found: FloatArray, known: BoolArray, count: int, x: float,
    y: float, along: float, edges: _Edges,
) -> int:  # fmt: skip
    """Write a candidate if it is on the map and has the clearance; return the new count."""
    if count < found.shape[0] and is_free_at(blocked, x, y) and is_clear_at(blocked, x, y, clearance):
        found[count, X] = x
        found[count, Y] = y
        found[count, ALONG] = along
        found[count, E1X] = edges.e1x
        found[count, E1Y] = edges.e1y
        found[count, E2X] = edges.e2x
        found[count, E2Y] = edges.e2y
        known[count] = False
        count += 1
    return count


@leaf
def _wrap(
    blocked: BoolArray, clearance: float, found: FloatArray, known: BoolArray, count: int, row: int,
    col: int, leg: _Leg,
) -> int:  # fmt: skip
    """Add the candidates of the convex corners of one cell; return the new count."""
    for corner in range(4):
        sx = 2 * (corner >> 1) - 1
        sy = 2 * (corner & 1) - 1
        if not (
            _is_free(blocked, row + sy, col)
            and _is_free(blocked, row, col + sx)
            and _is_free(blocked, row + sy, col + sx)
        ):
            continue
        x = col + 0.5 * sx
        y = row + 0.5 * sy
        along = leg.along + (x - leg.x) * leg.ux + (y - leg.y) * leg.uy
        far = _CORNER_OFFSET if clearance <= 0.0 else clearance
        edges = _Edges(-1.0 * sx, 0.0, 0.0, -1.0 * sy)
        count = _add(blocked, clearance, found, known, count, x + far * sx, y + far * sy, along, edges)
        if clearance > 0.0:
            c = far * _COS
            s = far * _SIN
            edges = _Edges(0.0, -1.0 * sy, -1.0 * sx, 1.0 * sy)
            count = _add(blocked, clearance, found, known, count, x + c * sx, y + s * sy, along, edges)
            edges = _Edges(-1.0 * sx, 0.0, 1.0 * sx, -1.0 * sy)
            count = _add(blocked, clearance, found, known, count, x + s * sx, y + c * sy, along, edges)
    return count


@called
def tangent_points(
    blocked: BoolArray, clearance: float, vertices: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the candidates along a path in order, (`ROWS`, n), and True for vertices of the path."""
    rows, cols = blocked.shape
    size = vertices.shape[0]
    wide = clearance + _CORRIDOR_CELLS
    length = 0.0
    for i in range(size - 1):
        length += math.hypot(vertices[i + 1, 0] - vertices[i, 0], vertices[i + 1, 1] - vertices[i, 1])
    found = np.empty((size + int(8.0 * (wide + 1.0) * (length + 4.0 * wide)), ROWS))
    known = np.empty(found.shape[0], np.bool_)
    low_x = vertices[0, 0]
    low_y = vertices[0, 1]
    high_x = vertices[0, 0]
    high_y = vertices[0, 1]
    for i in range(size):
        low_x = min(low_x, vertices[i, 0])
        high_x = max(high_x, vertices[i, 0])
        low_y = min(low_y, vertices[i, 1])
        high_y = max(high_y, vertices[i, 1])
    # Visited cells, within the bounding box of the corridor.
    west = max(0, math.floor(low_x - wide))
    south = max(0, math.floor(low_y - wide))
    east = min(cols - 1, math.ceil(high_x + wide))
    north = min(rows - 1, math.ceil(high_y + wide))
    seen = np.zeros((max(north - south, 0) + 1, max(east - west, 0) + 1), np.bool_)
    count = 0
    along = 0.0
    for i in range(size):
        for k in range(ROWS):
            found[count, k] = 0.0
        found[count, X] = vertices[i, 0]
        found[count, Y] = vertices[i, 1]
        found[count, ALONG] = along
        known[count] = True
        count += 1
        if i == size - 1:
            break
        ax = vertices[i, 0]
        ay = vertices[i, 1]
        dx = vertices[i + 1, 0] - ax
        dy = vertices[i + 1, 1] - ay
        leg = math.hypot(dx, dy)
        ux, uy = (dx / leg, dy / leg) if leg > 0.0 else (0.0, 0.0)
        for row in range(
            max(0, math.ceil(min(ay, ay + dy) - wide)),
            min(rows - 1, math.floor(max(ay, ay + dy) + wide)) + 1,
        ):
            if abs(dy) < 1e-12:
                low = min(ax, ax + dx)
                high = max(ax, ax + dx)
            else:
                ta = min(max((row - wide - ay) / dy, 0.0), 1.0)
                tb = min(max((row + wide - ay) / dy, 0.0), 1.0)
                low = ax + min(ta * dx, tb * dx)
                high = ax + max(ta * dx, tb * dx)
            for col in range(max(0, math.ceil(low - wide)), min(cols - 1, math.floor(high + wide)) + 1):
                if (
                    blocked[row, col]
                    and not seen[row - south, col - west]
                    and abs((col - ax) * uy - (row - ay) * ux) < wide
                ):
                    seen[row - south, col - west] = True
                    count = _wrap(
                        blocked, clearance, found, known, count, row, col, _Leg(ax, ay, ux, uy, along)
                    )
        along += leg
    order = np.empty(count, np.int64)
    along_way = np.empty(count)
    size = _sort(found, known, count, length, order, along_way)
    # Corners beyond the ends are left out.
    result = np.empty((ROWS, size))
    is_known = np.empty(size, np.bool_)
    for i in range(size):
        is_known[i] = known[order[i]]
        for row in range(ROWS):
            result[row, i] = found[order[i], row]
    return result, is_known


@leaf
def _sort(
    found: FloatArray, known: BoolArray, count: int, length: float, order: IntArray, along: FloatArray
) -> int:
    """Sort the candidates between the ends along the path, by insertion since they are nearly sorted.

    Returns their number.
    """
    size = 0
    for i in range(count):
        key = found[i, ALONG]
        if not known[i] and not (0.0 < key < length):
            continue
        k = size
        while k > 0 and along[k - 1] > key:
            order[k] = order[k - 1]
            along[k] = along[k - 1]
            k -= 1
        order[k] = i
        along[k] = key
        size += 1
    return size
