"""From a taut string to a route that a fixed wing can fly: turns of a least radius, begun on its course.

A vehicle at speed V and bank phi turns on a circle of R = V^2 / (g tan phi), no tighter. So

- *Corners* are flown as arcs that touch both legs. The arc passes inside the corner by R (sec(a/2) - 1), a
  the angle of the turn, and where the string is taut an obstacle stands just there. So corners are moved, all
  together, until the arcs are clear and the legs long enough for them (`gcs.planning.path.corner_smoothing`).
  Then two corners become one where their outer legs meet, or one goes, if that is clear and hardly dearer.
- *The start* follows the vehicle's course: an arc and its tangent to the first corner, to the nearer side, as
  an autopilot flies it by itself. If that hits something, the shortest way that is clear leads on to the
  first leg (`gcs.planning.path.initial_turn_search`). Its arcs become waypoints.
- A corner sharper than `SPLIT` becomes two: an autopilot cuts sharp corners, or swings out of them.

Every leg and every arc is checked for what clearance the string had there. What cannot be had stays as it was
and is reported: a straight plan is better than none.

Places in cells; angles counter-clockwise from east.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.jit import called, inlined, kernel
from gcs.model import FloatArray
from gcs.planning.map.line_of_sight import clear_leg, leg_room
from gcs.planning.path.corner_smoothing import cost, ease, half_turn, is_flown, leg_fits
from gcs.planning.path.initial_turn import (
    start_arc,
    start_is_safe,
    start_room,
)
from gcs.planning.path.initial_turn_search import SPLIT, entry

FLYABLE, SHARP_CORNER, SHARP_START = 0, 1, 2
"""What keeps a route from being flown: nothing, a corner, the turn on to it; or both (their sum)."""

_CORNER = 0.06
"""What one corner less may cost, in cells."""
_START_TRIES = 3
_NO_CELL = np.int64(-1)


@dataclass(frozen=True, slots=True)
class TurnAnticipation:
    """How early vehicles are told to turn at corners."""

    radius_m: float
    """Of their turns."""
    lag_m: float
    """How far they fly before a turn is taken up."""
    least_m: float
    """How near every waypoint counts as reached."""

    def accept_radii_m(self, points_m: FloatArray) -> FloatArray:
        """How far before each waypoint an autopilot should turn to the next one.

        An arc of the turn radius R begins R tan(a/2) before a corner of angle a; a vehicle that takes up a
        turn late, by `lag_m`, must begin that much before. The two together, by the root of the sum of their
        squares: for an airframe whose heading closes in on the new bearing exponentially, this is within 5 %
        of the distance that swings neither out nor across (see docs/planning.md).

        Parameters
        ----------
        points_m : ndarray, shape (k, 2)
            Where the vehicle starts, and the waypoints.

        Returns
        -------
        ndarray, shape (k - 1,)
            Of each waypoint; the last has `least_m`. Never more than half of the leg that leads to the
            waypoint, so that no corner is skipped, but for `least_m`.
        """
        legs = np.diff(points_m, axis=0)
        lengths = np.hypot(legs[:, 0], legs[:, 1])
        result = np.full(len(legs), self.least_m)
        for i in range(len(legs) - 1):
            turn = math.atan2(
                legs[i, 0] * legs[i + 1, 1] - legs[i, 1] * legs[i + 1, 0], float(legs[i] @ legs[i + 1])
            )
            wanted = math.hypot(self.radius_m * math.tan(min(abs(turn), SPLIT) / 2.0), self.lag_m)
            result[i] = max(self.least_m, min(wanted, 0.5 * lengths[i]))
        return result


@inlined
def _leg(points, i):  # type: ignore[no-untyped-def]
    return points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]


@called
def _angle(points, i):  # type: ignore[no-untyped-def]
    """Angle of the turn at corner i, positive to the left, in (-pi, pi]."""
    ux, uy = _leg(points, i - 1)
    vx, vy = _leg(points, i)
    return math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)


@inlined
def _without(points, rooms, i):  # type: ignore[no-untyped-def]
    """The points but i; the new leg has the lesser clearance of the two it replaces."""
    size = points.shape[0]
    fewer, fewer_rooms = np.empty((size - 1, 2)), np.empty(size - 2)
    for k in range(size - 1):
        at = k if k < i else k + 1
        fewer[k, 0], fewer[k, 1] = points[at, 0], points[at, 1]
    for k in range(size - 2):
        fewer_rooms[k] = rooms[k] if k < i else rooms[k + 1]
    fewer_rooms[i - 1] = min(rooms[i - 1], rooms[i])
    return fewer, fewer_rooms


@called
def _joined(blocked, points, rooms, i, own):  # type: ignore[no-untyped-def]
    """Corners i and i + 1 as one, where their outer legs meet; as they were if that is not clear."""
    if i >= points.shape[0] - 2:
        return points, rooms
    ux, uy = _leg(points, i - 1)
    vx, vy = _leg(points, i + 1)
    across = ux * vy - uy * vx
    if abs(across) < 1e-9:
        return points, rooms
    gx, gy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
    ahead, behind = (gx * vy - gy * vx) / across, (gx * uy - gy * ux) / across
    if ahead <= 0.0 or behind >= 0.0:
        return points, rooms
    fewer, fewer_rooms = _without(points, rooms, i + 1)
    fewer[i, 0], fewer[i, 1] = points[i, 0] + ahead * ux, points[i, 1] + ahead * uy
    for k in range(i - 1, i + 1):
        hindrance = own if k == 0 else _NO_CELL
        if not clear_leg(
            blocked,
            fewer[k, 0],
            fewer[k, 1],
            fewer[k + 1, 0],
            fewer[k + 1, 1],
            fewer_rooms[k],
            hindrance,
        ):
            return points, rooms
    return fewer, fewer_rooms


@called
def _fewer(blocked, points, rooms, radius, own):  # type: ignore[no-untyped-def]
    """Join or drop corners where that is clear, and no dearer than what a corner is worth.

    Also returns which corners something changed at.
    """
    i, fresh = 1, np.zeros(points.shape[0], np.bool_)
    while i < points.shape[0] - 1:
        most = cost(blocked, points, rooms, i - 2, i + 3, radius, own, np.inf) + _CORNER
        fewer, fewer_rooms = _joined(blocked, points, rooms, i, own)
        is_better = fewer.shape[0] < points.shape[0]
        is_better = is_better and cost(blocked, fewer, fewer_rooms, i - 2, i + 2, radius, own, most) < most
        if not is_better:
            room, hindrance = min(rooms[i - 1], rooms[i]), own if i == 1 else _NO_CELL
            ax, ay, bx, by = points[i - 1, 0], points[i - 1, 1], points[i + 1, 0], points[i + 1, 1]
            if clear_leg(blocked, ax, ay, bx, by, room, hindrance):
                fewer, fewer_rooms = _without(points, rooms, i)
                is_better = cost(blocked, fewer, fewer_rooms, i - 2, i + 2, radius, own, most) < most
        if is_better:
            points, rooms = fewer, fewer_rooms
            for k in range(i, points.shape[0]):
                fresh[k] = fresh[k + 1]
            fresh[i - 1] = fresh[i] = fresh[i + 1] = True
            i = max(i - 1, 1)
        else:
            i += 1
    return points, rooms, fresh[: points.shape[0]].copy()


@called
def _corners_are_clear(blocked, points, rooms, radius, own):  # type: ignore[no-untyped-def]
    """Whether every leg is long enough for its turns and every arc keeps its clearance."""
    for i in range(1, points.shape[0] - 1):  # noqa: SIM110  numba compiles no generators
        if not is_flown(blocked, points, rooms, i, radius, own):
            return False
    return True


@called
def _split(blocked, points, rooms, radius):  # type: ignore[no-untyped-def]
    """Sharp corners as two, around the same arc, where that is clear."""
    size = points.shape[0]
    result, count = np.empty((2 * size, 2)), 0
    for i in range(size):
        result[count, 0], result[count, 1] = points[i, 0], points[i, 1]
        count += 1
        turn = abs(_angle(points, i)) if 0 < i < size - 1 else 0.0
        if turn <= SPLIT or not (leg_fits(points, i - 1, radius) and leg_fits(points, i, radius)):
            continue
        ux, uy = _leg(points, i - 1)
        vx, vy = _leg(points, i)
        back = radius * abs(half_turn(points, i)) - radius * math.tan(0.25 * turn)
        u, v = back / math.hypot(ux, uy), back / math.hypot(vx, vy)
        ax, ay = points[i, 0] - u * ux, points[i, 1] - u * uy
        bx, by = points[i, 0] + v * vx, points[i, 1] + v * vy
        if clear_leg(blocked, ax, ay, bx, by, min(rooms[i - 1], rooms[i]), _NO_CELL):
            result[count - 1, 0], result[count - 1, 1] = ax, ay
            result[count, 0], result[count, 1] = bx, by
            count += 1
    return result[:count].copy()


@called
def _flown_length(points, radius):  # type: ignore[no-untyped-def]
    """Length along legs and arcs; along the legs alone where an arc does not fit."""
    length = 0.0
    for i in range(points.shape[0] - 1):
        dx, dy = _leg(points, i)
        length += math.hypot(dx, dy)
        if i > 0 and leg_fits(points, i - 1, radius) and leg_fits(points, i, radius):
            length -= 2.0 * radius * abs(half_turn(points, i)) - radius * abs(_angle(points, i))
    return length


@kernel
def flyable(blocked, reach, string, heading, radius, own):  # type: ignore[no-untyped-def]
    """Give a taut string turns that can be flown.

    Parameters: `reach` clearance in cells; `string` (k, 2), the vehicle first; `heading` (2,) unit vector,
    zeros if unknown; `radius` > 0 of the turns, in cells; `own` as for `tauten`. Returns the corners (j, 2),
    the length flown along the arcs, in cells, and what cannot be flown (`FLYABLE` ...).
    """
    legs = string.shape[0] - 1
    rooms, problem = np.empty(legs), FLYABLE
    for i in range(legs):
        hindrance = own if i == 0 else _NO_CELL
        rooms[i] = leg_room(
            blocked, string[i, 0], string[i, 1], string[i + 1, 0], string[i + 1, 1], reach, hindrance
        )
    points = string.copy()
    ease(blocked, points, rooms, radius, own, np.ones(legs + 1, np.bool_))
    points, rooms, fresh = _fewer(blocked, points, rooms, radius, own)
    ease(blocked, points, rooms, radius, own, fresh)
    if not _corners_are_clear(blocked, points, rooms, radius, own):
        problem = SHARP_CORNER
    length = _flown_length(points, radius)
    points = _split(blocked, points, rooms, radius)
    if legs > 0 and (heading[0] != 0.0 or heading[1] != 0.0):
        angle = math.atan2(heading[1], heading[0])
        x, y, to_x, to_y = points[0, 0], points[0, 1], points[1, 0], points[1, 1]
        room = start_room(blocked, min(reach, rooms[0]), x, y)
        straight = math.hypot(to_x - x, to_y - y)
        problem += SHARP_START
        # Rather a turn with less room than a loop with more: an autopilot flies the one by itself.
        for attempt in range(2 * _START_TRIES):
            tried = room * 0.5 ** (attempt % _START_TRIES)
            if attempt < _START_TRIES:
                if start_is_safe(blocked, tried, x, y, angle, to_x, to_y, radius, own):
                    length += start_arc(x, y, angle, to_x, to_y, radius)[2] - straight
                    problem -= SHARP_START
                    break
                continue
            other, word_length = entry(blocked, points, tried, angle, radius, own)
            if other.shape[0] > points.shape[0]:
                points = other
                length += word_length - straight
                problem -= SHARP_START
                break
    return points, length, problem
