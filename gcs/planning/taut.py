"""The shortest string near a way: corners slide from the grid's nodes to the corners of the obstacles.

A shortest way among polygons bends at their convex corners alone, and there it is tangent: the obstacle lies
on one side of the leg (Lozano-Perez & Wesley 1979). So a string near a known way is found by looking at the
convex corners of blocked cells within `_WIDTH` cells of it. With a clearance c the obstacles are rounded by
it; each corner is then wrapped by three points: two of the circumscribed octagon and the tip of the square.

- *Candidates* are ordered by how far along the way they lie.
- Each gets the cheapest predecessor before it (`_WINDOW` at most), among those that its leg is tangent to and
  that it sees. The straight line is the length that a sight test could confirm at best, so far predecessors
  are tried first and few tests are made.
- A leg shorter than the turn radius, or than its turns need, costs what is missing threefold (`_UNFIT`), and
  a start against the heading costs the turn. So corners that cannot be flown are passed by where there is
  another way. The known way's own legs are always allowed: the result is never worse.
- Then every corner *slides* towards its neighbours, and towards the leg between them, as far as it sees them.

The cost of the search is that of a corridor, not of the map. It looks at other sides of single obstacles, not
for other ways round the map: those are the grid search's business.

Places in cells: x = column, y = row. Sight is exact (`gcs.planning.sight`).
"""

from __future__ import annotations

import math

import numpy as np

from gcs.compiling import called, inlined, kernel
from gcs.planning.grid import TOUCH
from gcs.planning.sight import clear_leg, leg_room
from gcs.planning.starts import start_arc, start_is_clear, start_room

_WIDTH = 2.5
_WINDOW = 48
_UNFIT = 3.0
_FORCED = 3.0
"""What a cell of a known leg without the clearance counts."""
_CORNER = 0.25
"""What a corner counts, in cells: corners that save less are not worth flying."""
_APART = 3.0
_SWEEPS = 4
_HALVINGS = 7
_AWAY = 1e-6
"""In cells: how far off an obstacle's corner a string bends that needs no clearance."""
_TIP = math.sqrt(2.0)
_OCTAGON = 1.0 / math.cos(math.pi / 8.0)
_COS, _SIN = _OCTAGON * math.cos(math.pi / 8.0), _OCTAGON * math.sin(math.pi / 8.0)
_NO_CELL = np.int64(-1)

# Columns of the candidates' array.
_X, _Y, _ALONG, _E1X, _E1Y, _E2X, _E2Y, _KNOWN, _COLUMNS = 0, 1, 2, 3, 4, 5, 6, 7, 8


@inlined
def _is_free(blocked, row, col):  # type: ignore[no-untyped-def]
    """Whether a cell is free; beyond the map everything is."""
    rows, cols = blocked.shape
    return not (0 <= row < rows and 0 <= col < cols and blocked[row, col])


@inlined
def _gap(points, i, j):  # type: ignore[no-untyped-def]
    return math.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])


@called
def _turn(ux, uy, vx, vy):  # type: ignore[no-untyped-def]
    """Tangent of half the angle between two directions; a large number for about-turns."""
    cos = (ux * vx + uy * vy) / max(math.hypot(ux, uy) * math.hypot(vx, vy), 1e-12)
    return math.sqrt(max(1.0 - cos, 0.0) / max(1.0 + cos, 1e-4))


@called
def _start_cost(blocked, reach, found, i, heading, radius, own):  # type: ignore[no-untyped-def]
    """By how much a start on the vehicle's course makes the way to candidate i dearer than the straight line.

    It counts what the turn adds, and a full circle for one that hits something or cannot reach it.
    """
    if heading[0] == 0.0 and heading[1] == 0.0:
        return 0.0
    x, y, to_x, to_y = found[0, _X], found[0, _Y], found[i, _X], found[i, _Y]
    angle = math.atan2(heading[1], heading[0])
    if not start_is_clear(blocked, reach, x, y, angle, to_x, to_y, radius, own):
        return 2.0 * math.pi * radius
    return start_arc(x, y, angle, to_x, to_y, radius)[2] - math.hypot(to_x - x, to_y - y)


@inlined
def _add(blocked, reach, found, count, x, y, along, e1x, e1y, e2x, e2y):  # type: ignore[no-untyped-def]
    """Write one candidate if it is on the map and has the clearance itself; returns the new count."""
    rows, cols = blocked.shape
    on_map = abs(x - 0.5 * (cols - 1)) <= 0.5 * cols and abs(y - 0.5 * (rows - 1)) <= 0.5 * rows
    if on_map and count < found.shape[0] and clear_leg(blocked, x, y, x, y, reach, _NO_CELL):
        found[count, _X], found[count, _Y], found[count, _ALONG] = x, y, along
        found[count, _E1X], found[count, _E1Y], found[count, _E2X], found[count, _E2Y] = e1x, e1y, e2x, e2y
        found[count, _KNOWN] = -1.0
        count += 1
    return count


@called
def _wrap(blocked, reach, found, count, row, col, ax, ay, ux, uy, start_along):  # type: ignore[no-untyped-def]
    """Add the points that wrap the convex corners of one cell; returns the new count."""
    for corner in range(4):
        sx, sy = 2 * (corner >> 1) - 1, 2 * (corner & 1) - 1
        if not (
            _is_free(blocked, row + sy, col)
            and _is_free(blocked, row, col + sx)
            and _is_free(blocked, row + sy, col + sx)
        ):
            continue
        x, y = col + 0.5 * sx, row + 0.5 * sy
        along = start_along + (x - ax) * ux + (y - ay) * uy
        far = _AWAY if reach <= 0.0 else reach
        count = _add(blocked, reach, found, count, x + far * sx, y + far * sy, along, -sx, 0.0, 0.0, -sy)
        if reach > 0.0:
            c, s = far * _COS, far * _SIN
            count = _add(blocked, reach, found, count, x + c * sx, y + s * sy, along, 0.0, -sy, -sx, sy)
            count = _add(blocked, reach, found, count, x + s * sx, y + c * sy, along, -sx, 0.0, sx, -sy)
    return count


@called
def _candidates(blocked, reach, way):  # type: ignore[no-untyped-def]
    """The points that a string near a way may bend at, the way's own among them, ordered along it."""
    rows, cols = blocked.shape
    size, wide = way.shape[0], reach + _WIDTH
    length = 0.0
    for i in range(size - 1):
        length += math.hypot(way[i + 1, 0] - way[i, 0], way[i + 1, 1] - way[i, 1])
    found = np.empty((size + int(8.0 * (wide + 1.0) * (length + 4.0 * wide)), _COLUMNS))
    seen = np.zeros((rows, cols), np.bool_)
    count, along = 0, 0.0
    for i in range(size):
        for k in range(_COLUMNS):
            found[count, k] = 0.0
        found[count, _X], found[count, _Y], found[count, _ALONG], found[count, _KNOWN] = (
            way[i, 0],
            way[i, 1],
            along,
            i,
        )
        count += 1
        if i == size - 1:
            break
        ax, ay = way[i, 0], way[i, 1]
        dx, dy = way[i + 1, 0] - ax, way[i + 1, 1] - ay
        leg = math.hypot(dx, dy)
        ux, uy = (dx / leg, dy / leg) if leg > 0.0 else (0.0, 0.0)
        for row in range(
            max(0, math.ceil(min(ay, ay + dy) - wide)),
            min(rows - 1, math.floor(max(ay, ay + dy) + wide)) + 1,
        ):
            if abs(dy) < 1e-12:
                low, high = min(ax, ax + dx), max(ax, ax + dx)
            else:
                ta = min(max((row - wide - ay) / dy, 0.0), 1.0)
                tb = min(max((row + wide - ay) / dy, 0.0), 1.0)
                low, high = ax + min(ta * dx, tb * dx), ax + max(ta * dx, tb * dx)
            for col in range(max(0, math.ceil(low - wide)), min(cols - 1, math.floor(high + wide)) + 1):
                if blocked[row, col] and not seen[row, col] and abs((col - ax) * uy - (row - ay) * ux) < wide:
                    seen[row, col] = True
                    count = _wrap(blocked, reach, found, count, row, col, ax, ay, ux, uy, along)
        along += leg
    return _ordered(found, count, length)


@called
def _ordered(found, count, length):  # type: ignore[no-untyped-def]
    """Candidates between the ends, by place along the way; insertion, since they nearly are in order."""
    result, size = np.empty((count, _COLUMNS)), 0
    for i in range(count):
        inner = found[i, _KNOWN] < 0.0
        if inner and not (0.0 < found[i, _ALONG] < length):
            continue
        k = size
        while k > 0 and result[k - 1, _ALONG] > found[i, _ALONG]:
            for column in range(_COLUMNS):
                result[k, column] = result[k - 1, column]
            k -= 1
        for column in range(_COLUMNS):
            result[k, column] = found[i, column]
        size += 1
    # Corners as far along as an end may have come to stand beyond it.
    return result[:size]


@inlined
def _is_tangent(found, i, dx, dy):  # type: ignore[no-untyped-def]
    """Whether a leg leaves the obstacle of candidate i on one side; known points have none."""
    first = dx * found[i, _E1Y] - dy * found[i, _E1X]
    second = dx * found[i, _E2Y] - dy * found[i, _E2X]
    return first * second >= -1e-9


@inlined
def _unfit(found, came_from, spent, i, dx, dy, leg, radius):  # type: ignore[no-untyped-def]
    """Cells that the turn at candidate i, on to a leg (dx, dy), lacks; and what it takes of the new leg."""
    p = came_from[i]
    ux, uy = found[i, _X] - found[p, _X], found[i, _Y] - found[p, _Y]
    need = radius * _turn(ux, uy, dx, dy)
    return max(need + spent[i] - math.hypot(ux, uy), 0.0) + max(need - leg, 0.0), need


@called
def _string(blocked, reach, found, heading, radius, own):  # type: ignore[no-untyped-def]
    """Cheapest string through ordered candidates, from the first to the last: their indices, backwards."""
    size = found.shape[0]
    cost, came_from, spent = np.empty(size), np.empty(size, np.int64), np.zeros(size)
    last_known = 0
    room = start_room(blocked, reach, found[0, _X], found[0, _Y])
    cost[0], came_from[0] = 0.0, -1
    for j in range(1, size):
        cost[j], came_from[j] = np.inf, -1
        known = found[j, _KNOWN] >= 0.0
        first = max(0, j - _WINDOW)
        for k in range(first - 1, j):
            i = k if k >= first else last_known
            if k < first and last_known >= first:
                continue
            if cost[i] == np.inf:
                continue
            dx, dy = found[j, _X] - found[i, _X], found[j, _Y] - found[i, _Y]
            leg = math.hypot(dx, dy)
            forced = known and i == last_known
            if not forced and (
                leg < 1e-9
                or cost[i] + leg + _CORNER >= cost[j]
                or not _is_tangent(found, i, dx, dy)
                or not _is_tangent(found, j, dx, dy)
            ):
                continue
            here, need = cost[i] + leg + _CORNER, 0.0
            if radius > 0.0:
                here += _UNFIT * max(radius - leg, 0.0)
                if i == 0:
                    here += _start_cost(blocked, room, found, j, heading, radius, own)
                elif leg > 0.0:
                    lacking, need = _unfit(found, came_from, spent, i, dx, dy, leg, radius)
                    here += _UNFIT * lacking
            if here >= cost[j]:
                continue
            hindrance = own if i == 0 else _NO_CELL
            if not clear_leg(
                blocked, found[i, _X], found[i, _Y], found[j, _X], found[j, _Y], reach, hindrance
            ):
                if not forced or here + (_FORCED - 1.0) * leg >= cost[j]:
                    continue
                here += (_FORCED - 1.0) * leg
            cost[j], came_from[j], spent[j] = here, i, need
        if known:
            last_known = j
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
    good, bad, step = 0.0, 1.0, 1.0
    for _ in range(_HALVINGS):
        px, py = x + step * (aim_x - x), y + step * (aim_y - y)
        if (
            math.hypot(px - ax, py - ay) >= least
            and math.hypot(px - bx, py - by) >= least
            and clear_leg(blocked, ax, ay, px, py, reach, hindrance)
            and clear_leg(blocked, px, py, bx, by, reach, _NO_CELL)
        ):
            good = step
            if step == 1.0:
                break
        else:
            bad = step
        step = 0.5 * (good + bad)
    way[i, 0], way[i, 1] = x + good * (aim_x - x), y + good * (aim_y - y)
    return good * math.hypot(aim_x - x, aim_y - y)


@called
def _slide(blocked, reach, way, count, least, own):  # type: ignore[no-untyped-def]
    """Slide the corners of a string, and drop those whose neighbours see each other; returns the count."""
    for _ in range(_SWEEPS):
        moved, i = 0.0, 1
        while i < count - 1:
            ax, ay, bx, by = way[i - 1, 0], way[i - 1, 1], way[i + 1, 0], way[i + 1, 1]
            if clear_leg(blocked, ax, ay, bx, by, reach, own if i == 1 else _NO_CELL):
                count -= 1
                for k in range(i, count):
                    way[k, 0], way[k, 1] = way[k + 1, 0], way[k + 1, 1]
                moved = 1.0
                continue
            a, b = math.hypot(way[i, 0] - ax, way[i, 1] - ay), math.hypot(way[i, 0] - bx, way[i, 1] - by)
            floor = min(least, a, b)
            share = a / max(a + b, 1e-12)
            moved += _slid(blocked, reach, way, i, ax + share * (bx - ax), ay + share * (by - ay), floor, own)
            moved += _slid(blocked, reach, way, i, ax, ay, floor, own)
            moved += _slid(blocked, reach, way, i, bx, by, floor, own)
            i += 1
        if moved < 1e-3:
            break
    return count


@called
def _tautened(blocked, reach, way, heading, radius, least, own):  # type: ignore[no-untyped-def]
    """Shorten a way whose legs keep `reach`, or have no other choice; see `tauten`."""
    found = _candidates(blocked, reach, way)
    path = _string(blocked, reach, found, heading, radius, own)
    count = path.size
    string = np.empty((count, 2))
    for i in range(count):
        string[i, 0], string[i, 1] = found[path[count - 1 - i], _X], found[path[count - 1 - i], _Y]
    return string[: _slide(blocked, reach, string, count, least, own)].copy()


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
