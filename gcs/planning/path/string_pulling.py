"""The shortest string near a way: corners slide from the grid's nodes to the corners of the obstacles.

A shortest way among polygons bends at their convex corners alone, and there it is tangent: the obstacle lies
on one side of the leg (Lozano-Perez & Wesley 1979). So a string near a known way is found by looking at the
convex corners of blocked cells within `_WIDTH` cells of it. With a clearance c the obstacles are rounded by
it; each corner is then wrapped by three points: two of the circumscribed octagon and the tip of the square.

- *Candidates* are ordered by how far along the way they lie.
- Each gets the cheapest predecessor before it (`_WINDOW` at most), among those that its leg is tangent to and
  that it sees. The straight line is the length that a sight test could confirm at best, so far predecessors
  are tried first and few tests are made.
- A leg shorter than the turn radius, or than its turns need, costs `_UNFIT` times what is missing, and
  a start against the heading costs the turn. So corners that cannot be flown are passed by where there is
  another way. The known way's own legs are always allowed: the result is never worse.
- Then every corner *slides* towards its neighbours, and towards the leg between them, as far as it sees them.

The cost of the search is that of a corridor, not of the map. It looks at other sides of single obstacles, not
for other ways round the map: those are the grid search's business.

Places in cells: x = column, y = row. Sight is exact (`gcs.planning.map.line_of_sight`).
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import called, inlined, kernel, leaf
from gcs.planning.map.grid import TOUCH
from gcs.planning.map.line_of_sight import blocker, clear_leg, leg_room
from gcs.planning.path.initial_turn import start_arc, start_is_clear, start_room
from gcs.planning.path.tangent_points import E1X, E1Y, E2X, E2Y, X, Y, candidates

_WINDOW = 48
_UNFIT = 0.8
_FORCED = 3.0
"""What a cell of a known leg without the clearance counts."""
_CORNER = 0.25
"""What a corner counts, in cells: corners that save less are not worth flying."""
_APART = 3.0
_SWEEPS = 4
_HALVINGS = 7
_NO_CELL = np.int64(-1)
_SURELY = 1.0 - 1e-12
"""A root times this is no longer than a leg, however either was rounded."""


@inlined
def _gap(points, i, j):  # type: ignore[no-untyped-def]
    return math.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])


@inlined
def _turn(ux, uy, u, vx, vy, v):  # type: ignore[no-untyped-def]
    """Tangent of half the angle between two legs of lengths u and v; a large number for about-turns."""
    cos = (ux * vx + uy * vy) / max(u * v, 1e-12)
    return math.sqrt(max(1.0 - cos, 0.0) / max(1.0 + cos, 1e-4))


@leaf
def _start_cost(blocked, reach, x, y, to_x, to_y, heading, radius, own):  # type: ignore[no-untyped-def]
    """By how much a start on the vehicle's course makes the way to a place dearer than the straight line.

    It counts what the turn adds, and a full circle for one that hits something or cannot reach it.
    """
    if heading[0] == 0.0 and heading[1] == 0.0:
        return 0.0
    angle = math.atan2(heading[1], heading[0])
    if not start_is_clear(blocked, reach, x, y, angle, to_x, to_y, radius, own):
        return 2.0 * math.pi * radius
    return start_arc(x, y, angle, to_x, to_y, radius)[2] - math.hypot(to_x - x, to_y - y)


@leaf
def _at_least(x, y, e1x, e1y, e2x, e2y, cost, first, beyond, j, least):  # type: ignore[no-untyped-def]
    """What the way to candidate j costs at least by those from `first` on; inf if a leg is not tangent.

    Plain arithmetic without a branch, so that several are done at a time. A known point has no edges.
    """
    for i in range(first, beyond):
        dx, dy = x[j] - x[i], y[j] - y[i]
        leaves = (dx * e1y[i] - dy * e1x[i]) * (dx * e2y[i] - dy * e2x[i]) >= -1e-9
        joins = (dx * e1y[j] - dy * e1x[j]) * (dx * e2y[j] - dy * e2x[j]) >= -1e-9
        beeline = cost[i] + _SURELY * math.sqrt(dx * dx + dy * dy) + _CORNER
        least[i] = beeline if leaves & joins else np.inf


@leaf
def _fill(  # type: ignore[no-untyped-def]
    blocked, reach, x, y, e1x, e1y, e2x, e2y, known, heading, radius, own, cost, came_from, led, spent, least
):
    """Find the cheapest string to each candidate and which one comes before it; arguments as `_string`'s."""
    last_known = 0
    room = start_room(blocked, reach, x[0], y[0])
    cost[0], came_from[0] = 0.0, -1
    for j in range(1, x.size):
        cost[j], came_from[j] = np.inf, -1
        first, hit = max(0, j - _WINDOW), _NO_CELL
        _at_least(x, y, e1x, e1y, e2x, e2y, cost, first, j, j, least)
        if last_known < first:
            _at_least(x, y, e1x, e1y, e2x, e2y, cost, last_known, last_known + 1, j, least)
        for k in range(first - 1 if last_known < first else first, j):
            i = k if k >= first else last_known
            forced = known[j] and i == last_known
            if not forced and least[i] >= cost[j]:
                continue
            dx, dy = x[j] - x[i], y[j] - y[i]
            leg = math.hypot(dx, dy)
            here, need = cost[i] + leg + _CORNER, 0.0
            if not forced and (leg < 1e-9 or here >= cost[j]):
                continue
            if radius > 0.0:
                here += _UNFIT * max(radius - leg, 0.0)
                if i == 0:
                    here += _start_cost(blocked, room, x[0], y[0], x[j], y[j], heading, radius, own)
                elif leg > 0.0:
                    p = came_from[i]
                    need = radius * _turn(x[i] - x[p], y[i] - y[p], led[i], dx, dy, leg)
                    here += _UNFIT * (max(need + spent[i] - led[i], 0.0) + max(need - leg, 0.0))
            if here >= cost[j]:
                continue
            hindrance = own if i == 0 else _NO_CELL
            seen = blocker(blocked, x[i], y[i], x[j], y[j], reach, hindrance, hit)
            if seen >= 0:
                hit = seen
                if not forced or here + (_FORCED - 1.0) * leg >= cost[j]:
                    continue
                here += (_FORCED - 1.0) * leg
            cost[j], came_from[j], led[j], spent[j] = here, i, leg, need
        if known[j]:
            last_known = j


@called
def _string(blocked, reach, found, known, heading, radius, own):  # type: ignore[no-untyped-def]
    """Cheapest string through ordered candidates, from the first to the last: their indices, backwards."""
    size = known.size
    cost, came_from, least = np.empty(size), np.empty(size, np.int64), np.empty(size)
    led, spent = np.zeros(size), np.zeros(size)
    _fill(
        *(blocked, reach, found[X], found[Y], found[E1X], found[E1Y], found[E2X], found[E2Y], known),
        *(heading, radius, own, cost, came_from, led, spent, least),
    )
    path, count, node = np.empty(size, np.int64), 0, size - 1
    while node >= 0:
        path[count] = node
        count += 1
        node = came_from[node]
    return path[:count]


@inlined
def _slid(blocked, reach, way, i, aim_x, aim_y, least, own):  # type: ignore[no-untyped-def]
    """Move corner i towards a place as far as it sees its neighbours; returns how far it came, in cells."""
    ax, ay, bx, by = way[i - 1, 0], way[i - 1, 1], way[i + 1, 0], way[i + 1, 1]
    x, y = way[i, 0], way[i, 1]
    hindrance = own if i == 1 else _NO_CELL
    good, bad, step, hit, beyond = 0.0, 1.0, 1.0, _NO_CELL, _NO_CELL
    for _ in range(_HALVINGS):
        px, py = x + step * (aim_x - x), y + step * (aim_y - y)
        clear = math.hypot(px - ax, py - ay) >= least and math.hypot(px - bx, py - by) >= least
        if clear:
            seen = blocker(blocked, ax, ay, px, py, reach, hindrance, hit)
            clear, hit = seen < 0, seen if seen >= 0 else hit
        if clear:
            seen = blocker(blocked, px, py, bx, by, reach, _NO_CELL, beyond)
            clear, beyond = seen < 0, seen if seen >= 0 else beyond
        if clear:
            good = step
            if step == 1.0:
                break
        else:
            bad = step
        step = 0.5 * (good + bad)
    way[i, 0], way[i, 1] = x + good * (aim_x - x), y + good * (aim_y - y)
    return good * math.hypot(aim_x - x, aim_y - y)


@leaf
def _slide(blocked, reach, way, count, least, own, settled):  # type: ignore[no-untyped-def]
    """Slide the corners of a string, and drop those whose neighbours see each other; returns the count.

    `settled` (count,), all false: corners that did not move, nor did their neighbours since.
    """
    for _ in range(_SWEEPS):
        moved, i = 0.0, 1
        while i < count - 1:
            if settled[i]:
                i += 1
                continue
            ax, ay, bx, by = way[i - 1, 0], way[i - 1, 1], way[i + 1, 0], way[i + 1, 1]
            if clear_leg(blocked, ax, ay, bx, by, reach, own if i == 1 else _NO_CELL):
                count -= 1
                for k in range(i, count):
                    way[k, 0], way[k, 1], settled[k] = way[k + 1, 0], way[k + 1, 1], settled[k + 1]
                moved, settled[i - 1], settled[i] = 1.0, False, False
                continue
            a, b = math.hypot(way[i, 0] - ax, way[i, 1] - ay), math.hypot(way[i, 0] - bx, way[i, 1] - by)
            floor = min(least, a, b)
            share = a / max(a + b, 1e-12)
            by_all = _slid(blocked, reach, way, i, ax + share * (bx - ax), ay + share * (by - ay), floor, own)
            by_all += _slid(blocked, reach, way, i, ax, ay, floor, own)
            by_all += _slid(blocked, reach, way, i, bx, by, floor, own)
            settled[i] = by_all == 0.0
            if by_all > 0.0:
                settled[i - 1] = settled[i + 1] = False
            moved += by_all
            i += 1
        if moved < 1e-3:
            break
    return count


@called
def _tautened(blocked, reach, way, heading, radius, least, own):  # type: ignore[no-untyped-def]
    """Shorten a way whose legs keep `reach`, or have no other choice; see `tauten`."""
    found, known = candidates(blocked, reach, way)
    path = _string(blocked, reach, found, known, heading, radius, own)
    count = path.size
    string = np.empty((count, 2))
    for i in range(count):
        string[i, 0], string[i, 1] = found[X, path[count - 1 - i]], found[Y, path[count - 1 - i]]
    return string[: _slide(blocked, reach, string, count, least, own, np.zeros(count, np.bool_))].copy()


@called
def _rooms(blocked, reach, way, own):  # type: ignore[no-untyped-def]
    """Clearance of each leg of a way, at most `reach`; what lies between two tight legs close by is tight."""
    legs = way.shape[0] - 1
    rooms = np.empty(legs)
    for i in range(legs):
        hindrance = own if i == 0 else _NO_CELL
        rooms[i] = leg_room(blocked, way[i, 0], way[i, 1], way[i + 1, 0], way[i + 1, 1], reach, hindrance)
    last, since = -1, 0.0
    for i in range(legs):
        if rooms[i] < reach - TOUCH:
            if last >= 0 and since < _APART:
                for k in range(last + 1, i):
                    rooms[k] = min(rooms[last], rooms[i])
            last, since = i, 0.0
        else:
            since += _gap(way, i, i + 1)
    return rooms


@kernel
def tauten(blocked, reach, way, heading, radius, least, own):  # type: ignore[no-untyped-def]
    """Shorten a way.

    Parameters: `reach` clearance in cells; `way` (k, 2) the corners, both ends included, each leg with the
    clearance or, where the map leaves no other way, with less; `heading` (2,) unit vector, zeros if unknown;
    `radius` of the turns in cells, 0 if any turn can be flown; `least` length of a leg; `own` the flat cell
    that does not hinder the first leg, -1 for none. Returns the new corners (j, 2).

    Stretches with less clearance are shortened by themselves, and keep what clearance they have.
    """
    rooms = _rooms(blocked, reach, way, own)
    legs, first, size = rooms.size, 0, 1
    result = np.empty((0, 2))
    unknown = np.zeros(2)
    while first < legs:
        room, is_tight = rooms[first], rooms[first] < reach - TOUCH
        last = first + 1
        while last < legs and (rooms[last] < reach - TOUCH) == is_tight:
            room = min(room, rooms[last])
            last += 1
        part = _tautened(
            blocked,
            room if is_tight else reach,
            way[first : last + 1].copy(),
            heading if first == 0 else unknown,
            radius,
            least,
            own if first == 0 else _NO_CELL,
        )
        before, result = result, np.empty((size + part.shape[0] - 1, 2))
        for i in range(size - 1):
            result[i, 0], result[i, 1] = before[i, 0], before[i, 1]
        for i in range(part.shape[0]):
            result[size - 1 + i, 0], result[size - 1 + i, 1] = part[i, 0], part[i, 1]
        size += part.shape[0] - 1
        first = last
    return result
