"""From a path on the grid to points that an aeroplane is sent to.

A place (an agent, a target) hardly ever lies on a node. It *joins* the map by the nodes around it that it
sees, each as far off as it is in a straight line; the search starts from all of them and ends at any of them,
so the length of a way changes smoothly as a place moves through a cell. Inside an obstacle a place sees
nothing: it joins by the nearest free node.

Shaping then takes the nodes of the way and

1. drops the first ones if they are too near to fly to, or behind the agent, and the next one is in sight: an
   agent between nodes is not sent back (likewise a last node just beside the target);
2. merges what lies in a line ("grid"), or pulls the string: from each corner on, the farthest point of the
   way that is still in sight becomes the next corner; then corners whose neighbours see each other go;
3. draws the string taut around the obstacles ("pulled"; `gcs.planning.path.string_pulling`);
4. gives it turns that a fixed wing can fly ("flyable"; `gcs.planning.path.turns`).

Every new leg keeps the clearance exactly (`gcs.planning.map.line_of_sight`). Where the way itself is tighter,
it stays as tight. Places are in cells here: x = column, y = row.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from gcs.jit import called, inlined, kernel
from gcs.model import FloatArray
from gcs.planning.map.grid import BoolArray
from gcs.planning.map.line_of_sight import clear_leg, room_at
from gcs.planning.path.string_pulling import tauten
from gcs.planning.path.turns import FLYABLE, SHARP_CORNER, SHARP_START, flyable

Shape: TypeAlias = Literal["grid", "pulled", "flyable"]

_DIRECT_CELLS = 1.5
_NEAR_CELLS = 1.0
_BEHIND_CELLS = 2.0
_NO_CELL = np.int64(-1)


@inlined
def _cell(place, size):  # type: ignore[no-untyped-def]
    """Column (or row) of the cell, of `size`, that a place is in, or nearest to."""
    return int(min(max(math.floor(place + 0.5), 0.0), size - 1.0))


@kernel
def joins(blocked, mainland, tight, stride, places):  # type: ignore[no-untyped-def]
    """By which nodes places join the map, and how far off these are.

    `places` (n, 2). Returns flat nodes (n, 4), -1 for none; distances (n, 4); and whether a place is inside
    an obstacle (n,). Tight nodes are left out if there are others.
    """
    rows, cols = blocked.shape
    count = places.shape[0]
    nodes, off, inside = np.empty((count, 4), np.int64), np.empty((count, 4)), np.empty(count, np.bool_)
    for i in range(count):
        for k in range(4):
            nodes[i, k], off[i, k] = -1, 0.0
        x, y = places[i, 0], places[i, 1]
        col, row = _cell(x, cols), _cell(y, rows)
        inside[i] = blocked[row, col]
        if inside[i]:
            best = np.inf
            for r in range(rows):
                for c in range(cols):
                    gap = math.hypot(x - c, y - r)
                    if gap < best and mainland[(r + 1) * stride + c + 1]:
                        best, nodes[i, 0], off[i, 0] = gap, (r + 1) * stride + c + 1, gap
            continue
        nodes[i, 0], off[i, 0] = (row + 1) * stride + col + 1, math.hypot(x - col, y - row)
        found, west, south = 1, int(col if x >= col else col - 1), int(row if y >= row else row - 1)
        for r in range(south, south + 2):
            for c in range(west, west + 2):
                if (r == row and c == col) or not (0 <= r < rows and 0 <= c < cols) or blocked[r, c]:
                    continue
                if (
                    abs(x - c) < 1.0
                    and abs(y - r) < 1.0
                    and clear_leg(blocked, x, y, float(c), float(r), 0.0, _NO_CELL)
                ):
                    nodes[i, found], off[i, found] = (r + 1) * stride + c + 1, math.hypot(x - c, y - r)
                    found += 1
        roomy = False
        for k in range(found):
            roomy = roomy or not tight[nodes[i, k]]
        for k in range(found):
            if roomy and tight[nodes[i, k]]:
                nodes[i, k] = -1
    return nodes, off, inside


@called
def _ease(blocked, reach, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Clearance to ask of a leg: the wanted one, but no more than its own ends have."""
    if reach <= 0.0:
        return 0.0
    return min(room_at(blocked, ax, ay, reach), room_at(blocked, bx, by, reach))


@kernel
def close_and_seen(blocked, reach, a, b):  # type: ignore[no-untyped-def]
    """Whether two places are so close, and see each other so well, that nodes between them only hinder."""
    if math.hypot(b[0] - a[0], b[1] - a[1]) > _DIRECT_CELLS:
        return False
    ease = _ease(blocked, reach, a[0], a[1], b[0], b[1])
    return clear_leg(blocked, a[0], a[1], b[0], b[1], ease, _NO_CELL)


@called
def _sees(blocked, reach, points, i, j, own):  # type: ignore[no-untyped-def]
    """Whether point j is in sight of point i; point 0 is the agent, whose own cell does not hinder it."""
    hindrance = own if i == 0 else _NO_CELL
    return clear_leg(blocked, points[i, 0], points[i, 1], points[j, 0], points[j, 1], reach, hindrance)


@called
def _sees_with_ease(blocked, reach, points, i, j, own):  # type: ignore[no-untyped-def]
    """The same, but asking for no more clearance than the two points have themselves."""
    ease = _ease(blocked, reach, points[i, 0], points[i, 1], points[j, 0], points[j, 1])
    return _sees(blocked, ease, points, i, j, own)


@inlined
def _trim(blocked, reach, points, way, heading, ends_at_place, own):  # type: ignore[no-untyped-def]
    """Write to `way` which points to keep and return how many; see step 1 of the module."""
    first, size = 1, points.shape[0]
    way[0] = 0
    while first + 1 < size:
        dx, dy = points[first, 0] - points[0, 0], points[first, 1] - points[0, 1]
        gap = math.hypot(dx, dy)
        behind = dx * heading[0] + dy * heading[1] < 0.0
        if gap >= _NEAR_CELLS and not (behind and gap < _BEHIND_CELLS):
            break
        if not _sees_with_ease(blocked, reach, points, way[0], first + 1, own):
            break
        first += 1
    count = 1
    for i in range(first, size):
        way[count] = i
        count += 1
    if ends_at_place and count >= 3:
        a, b, c = way[count - 3], way[count - 2], way[count - 1]
        gap = math.hypot(points[c, 0] - points[b, 0], points[c, 1] - points[b, 1])
        if gap < _NEAR_CELLS and _sees_with_ease(blocked, reach, points, a, c, own):
            way[count - 2] = c
            count -= 1
    return count


@inlined
def _merge(points, way, n):  # type: ignore[no-untyped-def]
    """Keep the ends and the corners of the n points of `way`; returns how many these are."""
    count = 1
    for i in range(1, n - 1):
        a, b, c = way[count - 1], way[i], way[i + 1]
        ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        vx, vy = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1]
        if not (abs(ux * vy - uy * vx) < 1e-9 and ux * vx + uy * vy >= 0.0):
            way[count] = b
            count += 1
    way[count] = way[n - 1]
    return count + 1


@inlined
def _pull(blocked, reach, points, way, n, own):  # type: ignore[no-untyped-def]
    """Keep the ends and the corners of a taut string; see step 2 of the module."""
    count = 1
    for i in range(2, n):
        if not _sees(blocked, reach, points, way[count - 1], way[i], own):
            way[count] = way[i - 1]
            count += 1
    way[count] = way[n - 1]
    count += 1
    changed = True
    while changed:
        changed = False
        i = 1
        while i < count - 1:
            if _sees(blocked, reach, points, way[i - 1], way[i + 1], own):
                count -= 1
                for k in range(i, count):
                    way[k] = way[k + 1]
                changed = True
            else:
                i += 1
    return count


@kernel
def pull(blocked, reach, points, heading, own, ends_at_place, pulled):  # type: ignore[no-untyped-def]
    """Trim one way, and merge or pull it: steps 1 and 2 of the module.

    Parameters: `reach` clearance in cells; `points` (k, 2), the agent first, then the nodes, then the target
    if `ends_at_place`; `heading` (2,) unit vector, zeros if unknown; `own` the flat cell that does not hinder
    the agent, -1 for none. Returns the points to fly, the agent's included.
    """
    way = np.empty(points.shape[0], np.int64)
    count = _trim(blocked, reach, points, way, heading, ends_at_place, own)
    if count > 1:
        count = _pull(blocked, reach, points, way, count, own) if pulled else _merge(points, way, count)
    result = np.empty((count, 2))
    for i in range(count):
        result[i, 0], result[i, 1] = points[way[i], 0], points[way[i], 1]
    return result


@kernel
def is_roomy(blocked, reach, points, own, ends_at_place):  # type: ignore[no-untyped-def]
    """Whether every leg keeps the clearance, as far as the agent's and the target's own places have it."""
    last = points.shape[0] - 2
    for i in range(last + 1 if reach > 0.0 else 0):
        if i == 0 or (i == last and ends_at_place):
            if not _sees_with_ease(blocked, reach, points, i, i + 1, own):
                return False
        elif not _sees(blocked, reach, points, i, i + 1, own):
            return False
    return True


@kernel
def legs_are_clear(blocked, points, own):  # type: ignore[no-untyped-def]
    """Whether no leg touches an obstacle."""
    for i in range(points.shape[0] - 1):  # noqa: SIM110  numba compiles no generators
        if not _sees(blocked, 0.0, points, i, i + 1, own):
            return False
    return True


class Shaped(NamedTuple):
    """A way that can be flown, in cells."""

    points: FloatArray
    """(k, 2), the agent's place first."""
    length: float
    """Along the legs, or along the turns if these were asked for."""
    is_roomy: bool
    """Every leg keeps the clearance, as far as the agent's and the target's own places have it."""
    problem: int
    """What cannot be flown; see `gcs.planning.path.turns`."""


def shape_way(
    blocked: BoolArray,
    reach: float,
    points: FloatArray,
    heading: FloatArray,
    start_inside: bool,
    ends_at_place: bool,
    kind: Shape,
    radius: float,
) -> Shaped:
    """Shape one way; arguments as for `pull`, and the least radius of turns in cells for "flyable"."""
    rows, cols = blocked.shape
    own = -1
    if start_inside:
        col, row = (int(np.clip(np.floor(points[0, k] + 0.5), 0, n - 1)) for k, n in ((0, cols), (1, rows)))
        own = row * cols + col
    radius = radius if kind == "flyable" else 0.0
    way = pull(blocked, reach, points, heading, own, ends_at_place, kind != "grid")
    if kind != "grid" and len(way) > 1:
        way = tauten(blocked, reach, way, heading, radius, radius, own)
    length, problem = float(np.hypot(*np.diff(way, axis=0).T).sum()), FLYABLE
    if radius > 0.0 and len(way) > 1:
        turned, flown, problem = flyable(blocked, reach, way, heading, radius, own)
        # Whatever the turns need, no leg may lead through an obstacle: rather no loop on to the route, or the
        # string as it was.
        if not legs_are_clear(blocked, turned, own):
            turned, flown, problem = flyable(blocked, reach, way, np.zeros(2), radius, own)
            problem += SHARP_START
        if legs_are_clear(blocked, turned, own):
            way, length = turned, float(flown)
        else:
            problem = SHARP_START + SHARP_CORNER
    return Shaped(way, length, bool(is_roomy(blocked, reach, way, own, ends_at_place)), problem)
