"""Path from the grid to a route: places connected to nodes, shortcuts, then pulling and turns.

A place (an agent, a target) rarely lies on a node. It connects to the surrounding nodes in line of sight,
with their straight-line distances. The search starts from all of them and ends at any, so path lengths change
smoothly as a place moves. Inside an obstacle a place connects to the nearest free node.

Shaping takes the nodes of the path and

1. drops the first nodes if they are too near or behind the agent and the next one is visible (likewise a last
   node next to the target), so that an agent between nodes is not sent back;
2. merges collinear legs ("grid"), or takes shortcuts: the farthest visible point becomes the next corner;
3. shortens it by string pulling ("pulled"; `gcs.planning.path.string_pulling`);
4. adds turns that a fixed wing can fly ("flyable"; `gcs.planning.path.turns`).

Every new leg keeps the clearance exactly (`gcs.planning.map.line_of_sight`). A path that is tighter stays as
tight. Positions in cells: x = column, y = row.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from gcs.jit import called, inlined, kernel
from gcs.model import BoolArray, FloatArray, IntArray
from gcs.planning.map.line_of_sight import NO_CELL, clear_leg, clearance_at
from gcs.planning.path.points import copy_point
from gcs.planning.path.string_pulling import pull_string
from gcs.planning.path.turns import FLYABLE, SHARP_CORNER, SHARP_START, make_flyable

Shape: TypeAlias = Literal["grid", "pulled", "flyable"]

_MAX_DIRECT_CELLS = 1.5
_MIN_FIRST_LEG_CELLS = 1.0
_BEHIND_CELLS = 2.0


@inlined
def _cell(place: float, size: int) -> int:
    """Return the column (or row), of `size`, of the cell that contains a position or is nearest to it."""
    return int(min(max(math.floor(place + 0.5), 0.0), size - 1.0))


@kernel
def connect_to_grid(
    blocked: BoolArray, largest_component: BoolArray, tight: BoolArray, stride: int, places: FloatArray
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Connect places to grid nodes.

    `places` (n, 2). Returns flat nodes (n, 4), -1 for none; their distances (n, 4); and True for places
    inside an obstacle (n,). Tight nodes are left out if there are others.
    """
    rows, cols = blocked.shape
    count = places.shape[0]
    nodes = np.empty((count, 4), np.int64)
    gaps = np.empty((count, 4))
    inside = np.empty(count, np.bool_)
    for i in range(count):
        for k in range(4):
            nodes[i, k] = -1
            gaps[i, k] = 0.0
        x = places[i, 0]
        y = places[i, 1]
        col = _cell(x, cols)
        row = _cell(y, rows)
        inside[i] = blocked[row, col]
        if inside[i]:
            best = np.inf
            for r in range(rows):
                for c in range(cols):
                    gap = math.hypot(x - c, y - r)
                    if gap < best and largest_component[(r + 1) * stride + c + 1]:
                        best = gap
                        nodes[i, 0] = (r + 1) * stride + c + 1
                        gaps[i, 0] = gap
            continue
        nodes[i, 0] = (row + 1) * stride + col + 1
        gaps[i, 0] = math.hypot(x - col, y - row)
        found = 1
        west = int(col if x >= col else col - 1)
        south = int(row if y >= row else row - 1)
        for r in range(south, south + 2):
            for c in range(west, west + 2):
                if (r == row and c == col) or not (0 <= r < rows and 0 <= c < cols) or blocked[r, c]:
                    continue
                if (
                    abs(x - c) < 1.0
                    and abs(y - r) < 1.0
                    and clear_leg(blocked, x, y, float(c), float(r), 0.0, NO_CELL)
                ):
                    nodes[i, found] = (r + 1) * stride + c + 1
                    gaps[i, found] = math.hypot(x - c, y - r)
                    found += 1
        has_open = False
        for k in range(found):
            has_open = has_open or not tight[nodes[i, k]]
        for k in range(found):
            if has_open and tight[nodes[i, k]]:
                nodes[i, k] = -1
    return nodes, gaps, inside


@called
def _end_clearance(blocked: BoolArray, clearance: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the clearance that a leg must keep: the required one, at most that of its ends."""
    if clearance <= 0.0:
        return 0.0
    return min(clearance_at(blocked, ax, ay, clearance), clearance_at(blocked, bx, by, clearance))


@kernel
def is_adjacent_and_visible(blocked: BoolArray, clearance: float, a: FloatArray, b: FloatArray) -> bool:
    """Return True if two places are so close in line of sight that no node is needed between them."""
    if math.hypot(b[0] - a[0], b[1] - a[1]) > _MAX_DIRECT_CELLS:
        return False
    end_clearance = _end_clearance(blocked, clearance, a[0], a[1], b[0], b[1])
    return clear_leg(blocked, a[0], a[1], b[0], b[1], end_clearance, NO_CELL)


@called
def _is_visible(
    blocked: BoolArray, clearance: float, points: FloatArray, i: int, j: int, own_cell: int
) -> bool:
    """Return True if point j is visible from point i. The own cell of point 0, the agent, is ignored."""
    ignored_cell = own_cell if i == 0 else NO_CELL
    return clear_leg(blocked, points[i, 0], points[i, 1], points[j, 0], points[j, 1], clearance, ignored_cell)


@called
def _is_visible_from_ends(
    blocked: BoolArray, clearance: float, points: FloatArray, i: int, j: int, own_cell: int
) -> bool:
    """Do the same with no more clearance than the two points have."""
    end_clearance = _end_clearance(blocked, clearance, points[i, 0], points[i, 1], points[j, 0], points[j, 1])
    return _is_visible(blocked, end_clearance, points, i, j, own_cell)


@inlined
def _trim_ends(
    blocked: BoolArray, clearance: float, points: FloatArray, kept: IntArray, heading: FloatArray,
    ends_at_place: bool, own_cell: int,
) -> int:  # fmt: skip
    """Write the points to keep to `kept` and return their number; step 1 of the module."""
    first = 1
    size = points.shape[0]
    kept[0] = 0
    while first + 1 < size:
        dx = points[first, 0] - points[0, 0]
        dy = points[first, 1] - points[0, 1]
        gap = math.hypot(dx, dy)
        behind = dx * heading[0] + dy * heading[1] < 0.0
        if gap >= _MIN_FIRST_LEG_CELLS and not (behind and gap < _BEHIND_CELLS):
            break
        if not _is_visible_from_ends(blocked, clearance, points, kept[0], first + 1, own_cell):
            break
        first += 1
    count = 1
    for i in range(first, size):
        kept[count] = i
        count += 1
    if ends_at_place and count >= 3:
        a = kept[count - 3]
        b = kept[count - 2]
        c = kept[count - 1]
        gap = math.hypot(points[c, 0] - points[b, 0], points[c, 1] - points[b, 1])
        if gap < _MIN_FIRST_LEG_CELLS and _is_visible_from_ends(blocked, clearance, points, a, c, own_cell):
            kept[count - 2] = c
            count -= 1
    return count


@inlined
def _merge_collinear(points: FloatArray, kept: IntArray, n: int) -> int:
    """Keep the ends and corners of the n points of `kept`; return their number."""
    count = 1
    for i in range(1, n - 1):
        a = kept[count - 1]
        b = kept[i]
        c = kept[i + 1]
        ux = points[b, 0] - points[a, 0]
        uy = points[b, 1] - points[a, 1]
        vx = points[c, 0] - points[b, 0]
        vy = points[c, 1] - points[b, 1]
        if not (abs(ux * vy - uy * vx) < 1e-9 and ux * vx + uy * vy >= 0.0):
            kept[count] = b
            count += 1
    kept[count] = kept[n - 1]
    return count + 1


@inlined
def _shortcut(
    blocked: BoolArray, clearance: float, points: FloatArray, kept: IntArray, n: int, own_cell: int
) -> int:
    """Keep the ends and the corners after shortcuts; step 2 of the module."""
    count = 1
    for i in range(2, n):
        if not _is_visible(blocked, clearance, points, kept[count - 1], kept[i], own_cell):
            kept[count] = kept[i - 1]
            count += 1
    kept[count] = kept[n - 1]
    count += 1
    changed = True
    while changed:
        changed = False
        i = 1
        while i < count - 1:
            if _is_visible(blocked, clearance, points, kept[i - 1], kept[i + 1], own_cell):
                count -= 1
                for k in range(i, count):
                    kept[k] = kept[k + 1]
                changed = True
            else:
                i += 1
    return count


@kernel
def shorten(
    blocked: BoolArray, clearance: float, points: FloatArray, heading: FloatArray, own_cell: int,
    ends_at_place: bool, pulled: bool,
) -> FloatArray:  # fmt: skip
    """Trim one path, then merge or shortcut it: steps 1 and 2 of the module.

    `clearance` in cells. `points` (k, 2): the agent, the nodes, then the target if `ends_at_place`. `heading`
    (2,): unit vector, zeros if unknown. `own_cell`: flat cell that does not block the agent, -1 for none.
    Returns the waypoints, with the agent's position.
    """
    kept = np.empty(points.shape[0], np.int64)
    count = _trim_ends(blocked, clearance, points, kept, heading, ends_at_place, own_cell)
    if count > 1:
        count = (
            _shortcut(blocked, clearance, points, kept, count, own_cell)
            if pulled
            else _merge_collinear(points, kept, count)
        )
    result = np.empty((count, 2))
    for i in range(count):
        copy_point(points, kept[i], result, i)
    return result


@kernel
def keeps_clearance(
    blocked: BoolArray, clearance: float, points: FloatArray, own_cell: int, ends_at_place: bool
) -> bool:
    """Return True if every leg keeps the clearance, as far as the positions of agent and target have it."""
    last = points.shape[0] - 2
    for i in range(last + 1 if clearance > 0.0 else 0):
        if i == 0 or (i == last and ends_at_place):
            if not _is_visible_from_ends(blocked, clearance, points, i, i + 1, own_cell):
                return False
        elif not _is_visible(blocked, clearance, points, i, i + 1, own_cell):
            return False
    return True


@kernel
def legs_are_clear(blocked: BoolArray, points: FloatArray, own_cell: int) -> bool:
    """Return True if no leg touches an obstacle."""
    for i in range(points.shape[0] - 1):  # noqa: SIM110  numba compiles no generators
        if not _is_visible(blocked, 0.0, points, i, i + 1, own_cell):
            return False
    return True


class ShapedPath(NamedTuple):
    """Shaped path, in cells."""

    points: FloatArray
    """(k, 2), the agent's position first."""
    length: float
    """Length along the legs, or along the turns of a flyable path."""
    keeps_clearance: bool
    """True if every leg keeps the clearance, as far as the positions of agent and target have it."""
    problem: int
    """Turns that cannot be flown; see `gcs.planning.path.turns`."""


def shape_path(
    blocked: BoolArray,
    clearance: float,
    points: FloatArray,
    heading: FloatArray,
    start_inside: bool,
    ends_at_place: bool,
    kind: Shape,
    radius: float,
) -> ShapedPath:
    """Shape one path; arguments as of `shorten`, and the minimum turn radius in cells for "flyable"."""
    rows, cols = blocked.shape
    own_cell = -1
    if start_inside:
        col, row = (int(np.clip(np.floor(points[0, k] + 0.5), 0, n - 1)) for k, n in ((0, cols), (1, rows)))
        own_cell = row * cols + col
    radius = radius if kind == "flyable" else 0.0
    waypoints = shorten(blocked, clearance, points, heading, own_cell, ends_at_place, kind != "grid")
    if kind != "grid" and len(waypoints) > 1:
        waypoints = pull_string(blocked, clearance, waypoints, heading, radius, radius, own_cell)
    length = float(np.hypot(*np.diff(waypoints, axis=0).T).sum())
    problem = FLYABLE
    if radius > 0.0 and len(waypoints) > 1:
        turned, flown, problem = make_flyable(blocked, clearance, waypoints, heading, radius, own_cell)
        # No leg may lead through an obstacle: rather no explicit turn, or the path without turns.
        if not legs_are_clear(blocked, turned, own_cell):
            turned, flown, problem = make_flyable(
                blocked, clearance, waypoints, np.zeros(2), radius, own_cell
            )
            problem += SHARP_START
        if legs_are_clear(blocked, turned, own_cell):
            waypoints = turned
            length = float(flown)
        else:
            problem = SHARP_START + SHARP_CORNER
    return ShapedPath(
        waypoints,
        length,
        bool(keeps_clearance(blocked, clearance, waypoints, own_cell, ends_at_place)),
        problem,
    )
