"""From a path on the grid to points that an aeroplane is sent to.

A place (an agent, a target) hardly ever lies on a node. It *joins* the map by the nodes around it that it
sees, each as far off as it is in a straight line; the search starts from all of them and ends at any of them,
so the length of a way changes smoothly as a place moves through a cell. Inside an obstacle a place sees
nothing: it joins by the nearest free node.

Shaping then takes the nodes of the way and

1. drops the first ones if they are too near to fly to, or behind the agent, and the next one is in sight: an
agent
   between nodes is not sent back (likewise a last node just beside the target);
2. merges what lies in a line ("grid"), or pulls the string taut ("pulled"): from each corner on, the farthest
point of
   the way that is still in sight becomes the next corner; then corners whose neighbours see each other go.

Every new leg keeps the clearance exactly (`gcs.planning.sight`). Where the way itself is tighter, its nodes
stay. Places are in cells here: x = column, y = row.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from gcs.planning.sight import clear_leg, room_at

NO_WAY, DIRECT = -1, -2
"""In place of the node by which a way ends: there is none; the two places are close and see each other."""

_DIRECT_CELLS = 1.5
_NEAR_CELLS = 1.0
_BEHIND_CELLS = 2.0


@numba.njit(nogil=True, cache=True)
def joins(blocked, mainland, tight, stride, places):  # type: ignore[no-untyped-def]
    """By which nodes places join the map, and how far off these are.

    `places` (n, 2). Returns flat nodes (n, 4), -1 for none; distances (n, 4); and whether a place is inside
    an obstacle (n,). Tight nodes are left out if there are others.
    """
    rows, cols = blocked.shape
    count = places.shape[0]
    nodes = np.full((count, 4), -1, np.int64)
    off = np.zeros((count, 4))
    inside = np.zeros(count, np.bool_)
    for i in range(count):
        x, y = places[i, 0], places[i, 1]
        col = int(min(max(math.floor(x + 0.5), 0.0), cols - 1.0))
        row = int(min(max(math.floor(y + 0.5), 0.0), rows - 1.0))
        if blocked[row, col]:
            inside[i] = True
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
                if abs(x - c) < 1.0 and abs(y - r) < 1.0 and clear_leg(blocked, x, y, c, r, 0.0, -1, -1):
                    nodes[i, found], off[i, found] = (r + 1) * stride + c + 1, math.hypot(x - c, y - r)
                    found += 1
        roomy = False
        for k in range(found):
            roomy = roomy or not tight[nodes[i, k]]
        for k in range(found):
            if roomy and tight[nodes[i, k]]:
                nodes[i, k] = -1
    return nodes, off, inside


@numba.njit(nogil=True, cache=True)
def close_and_seen(blocked, reach, a, b):  # type: ignore[no-untyped-def]
    """Whether two places are so close, and see each other so well, that nodes between them only hinder."""
    return math.hypot(b[0] - a[0], b[1] - a[1]) <= _DIRECT_CELLS and clear_leg(
        blocked, a[0], a[1], b[0], b[1], _ease(blocked, reach, a, b), -1, -1
    )


@numba.njit(nogil=True, cache=True)
def ends_of_ways(blocked, reach, field, starts, starts_inside, goals, goal_nodes, goal_off, goals_inside):  # type: ignore[no-untyped-def]
    """Cost in cells of the way from each start to each goal, (n, m), and the node by which it ends."""
    n, m = starts.shape[0], goals.shape[0]
    cost = np.full((n, m), np.inf)
    via = np.full((n, m), NO_WAY, np.int64)
    for i in range(n):
        for j in range(m):
            if not (starts_inside[i] or goals_inside[j]) and close_and_seen(
                blocked, reach, starts[i], goals[j]
            ):
                cost[i, j] = math.hypot(goals[j, 0] - starts[i, 0], goals[j, 1] - starts[i, 1])
                via[i, j] = DIRECT
                continue
            for k in range(goal_nodes.shape[1]):
                node = goal_nodes[j, k]
                if node >= 0 and field[i, node] + goal_off[j, k] < cost[i, j]:
                    cost[i, j] = field[i, node] + goal_off[j, k]
                    via[i, j] = node
    return cost, via


@numba.njit(nogil=True, cache=True)
def _ease(blocked, reach, a, b):  # type: ignore[no-untyped-def]
    """Clearance to ask of a leg: the wanted one, but no more than its own ends have."""
    if reach <= 0.0:
        return 0.0
    return min(room_at(blocked, a[0], a[1], reach), room_at(blocked, b[0], b[1], reach))


@numba.njit(nogil=True, cache=True)
def _sees(blocked, reach, points, i, j, own_col, own_row):  # type: ignore[no-untyped-def]
    """Whether point j is in sight of point i; point 0 is the agent, whose own cell does not hinder it."""
    a, b = points[i], points[j]
    return clear_leg(
        blocked, a[0], a[1], b[0], b[1], reach, own_col if i == 0 else -1, own_row if i == 0 else -1
    )


@numba.njit(nogil=True, cache=True)
def _trim(blocked, reach, points, heading, ends_at_place, own_col, own_row):  # type: ignore[no-untyped-def]
    """Range [first, last) of the way's points to keep, and the rest; see step 1 of the module."""
    first, count = 1, points.shape[0]
    while first + 1 < count:
        dx, dy = points[first, 0] - points[0, 0], points[first, 1] - points[0, 1]
        gap = math.hypot(dx, dy)
        behind = dx * heading[0] + dy * heading[1] < 0.0
        if gap >= _NEAR_CELLS and not (behind and gap < _BEHIND_CELLS):
            break
        ease = _ease(blocked, reach, points[0], points[first + 1])
        if not _sees(blocked, ease, points, 0, first + 1, own_col, own_row):
            break
        first += 1
    kept = np.empty((1 + count - first, 2))
    kept[0] = points[0]
    kept[1:] = points[first:]
    count = kept.shape[0]
    if ends_at_place and count >= 3:
        gap = math.hypot(kept[-1, 0] - kept[-2, 0], kept[-1, 1] - kept[-2, 1])
        ease = _ease(blocked, reach, kept[count - 3], kept[count - 1])
        if gap < _NEAR_CELLS and _sees(blocked, ease, kept, count - 3, count - 1, own_col, own_row):
            kept[count - 2] = kept[count - 1]
            kept = kept[: count - 1]
    return kept


@numba.njit(nogil=True, cache=True)
def _straight(a, b, c):  # type: ignore[no-untyped-def]
    """Whether b lies on the way straight from a to c."""
    ux, uy, vx, vy = b[0] - a[0], b[1] - a[1], c[0] - b[0], c[1] - b[1]
    return abs(ux * vy - uy * vx) < 1e-9 and ux * vx + uy * vy >= 0.0


@numba.njit(nogil=True, cache=True)
def _merge(points, keep):  # type: ignore[no-untyped-def]
    """Keep the ends and the corners."""
    count = 1
    for i in range(1, points.shape[0] - 1):
        if not _straight(points[keep[count - 1]], points[i], points[i + 1]):
            keep[count] = i
            count += 1
    keep[count] = points.shape[0] - 1
    return count + 1


@numba.njit(nogil=True, cache=True)
def _pull(blocked, reach, points, keep, own_col, own_row):  # type: ignore[no-untyped-def]
    """Keep the ends and the corners of a taut string; see step 2 of the module."""
    count = 1
    for i in range(2, points.shape[0]):
        if not _sees(blocked, reach, points, keep[count - 1], i, own_col, own_row):
            keep[count] = i - 1
            count += 1
    keep[count] = points.shape[0] - 1
    count += 1
    changed = True
    while changed:
        changed = False
        i = 1
        while i < count - 1:
            if _sees(blocked, reach, points, keep[i - 1], keep[i + 1], own_col, own_row):
                keep[i : count - 1] = keep[i + 1 : count].copy()
                count -= 1
                changed = True
            else:
                i += 1
    return count


@numba.njit(nogil=True, cache=True)
def shape(blocked, reach, points, heading, start_inside, ends_at_place, pulled):  # type: ignore[no-untyped-def]
    """Shape one way.

    Parameters: `reach` clearance in cells; `points` (k, 2), the agent first, then the nodes, then the target
    if `ends_at_place`; `heading` (2,) unit vector, zeros if unknown. Returns the points to fly, the agent's
    included, and whether every leg keeps the clearance, as far as the agent's and the target's own places
    have it.
    """
    own_col, own_row = -1, -1
    if start_inside:
        own_col = int(min(max(math.floor(points[0, 0] + 0.5), 0.0), blocked.shape[1] - 1.0))
        own_row = int(min(max(math.floor(points[0, 1] + 0.5), 0.0), blocked.shape[0] - 1.0))
    kept = _trim(blocked, reach, points, heading, ends_at_place, own_col, own_row)
    keep = np.zeros(kept.shape[0], np.int64)
    if kept.shape[0] == 1:
        count = 1
    elif pulled:
        count = _pull(blocked, reach, kept, keep, own_col, own_row)
    else:
        count = _merge(kept, keep)
    shaped = kept[keep[:count]]
    roomy = True
    for i in range(count - 1):
        own = i == 0 or (i == count - 2 and ends_at_place)
        wanted = _ease(blocked, reach, shaped[i], shaped[i + 1]) if own else reach
        if reach > 0.0 and not _sees(blocked, wanted, shaped, i, i + 1, own_col, own_row):
            roomy = False
    return shaped, roomy
