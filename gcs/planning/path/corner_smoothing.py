"""Corners moved a little, all together, until the turns at them can be flown.

A vehicle does not fly through a corner of angle a: an arc of its turn radius R touches both legs R tan(a/2)
before and after it. Where a taut string bends around an obstacle, that arc passes nearer to it than the
string does; and two corners close by may want more of the leg between them than there is. Moving each corner
out by itself moves the legs at its neighbours into other obstacles. So each is moved a little at a time, to
where the way as it is flown becomes cheapest: its length along legs and arcs, and what its turns lack of
room and of clearance. No leg gives up its own clearance on the way. That is a compass search (R. Hooke and
T. A. Jeeves, JACM 8, 1961), corner by corner, until none moves. Corners whose turns fit, and whose
neighbours' do, stay where the string was taut.

*How near an arc comes* is exact: the legs are clear, so what is nearest to the arc is on its inner side, and
there the farthest point of a square from the arc's centre is one of its corners.

Places in cells: x = column, y = row.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import called, inlined, leaf
from gcs.planning.map.line_of_sight import blocker

_UNFIT = 4.0
"""What a length counts that turns lack of their leg."""
_NEAR = 3.0
"""What it counts how much an arc comes too near, besides the root of that and the radius: a corner before a
narrow gap that turns late by d comes nearer by d^2 / 2R only, and yet it should pay to turn in time."""
_HARDLY = 1e-3
"""Nearer by so much, in radii, is no matter: 4 cm at 40 m."""
_STEP, _LEAST_STEP = 0.2, 0.007
"""Of a corner, first and last, in radii."""
_DIRECTIONS = 4
_SWEEPS = 40
_NO_CELL = np.int64(-1)
_SHARPEST = math.tan(0.475 * math.pi)
"""Tangent of half the angle of the sharpest turn that is told from others."""


@leaf
def half_turn(points, i):  # type: ignore[no-untyped-def]
    """Tangent of half the angle of the turn at corner i, positive to the left; 0 at the ends."""
    if i <= 0 or i >= points.shape[0] - 1:
        return 0.0
    ux, uy = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
    vx, vy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
    along, across = ux * vx + uy * vy, ux * vy - uy * vx
    whole = math.sqrt((ux * ux + uy * uy) * (vx * vx + vy * vy))
    # tan(a/2) = sin(a) / (1 + cos(a))
    half = abs(across) / max(whole + along, 1e-12 + 1e-6 * whole)
    return math.copysign(min(half, _SHARPEST) if along > -whole * (1.0 - 1e-9) else _SHARPEST, across)


@leaf
def shortfall(blocked, points, i, half, radius, reach, own):  # type: ignore[no-untyped-def]
    """By how much the arc at corner i, `half` its `half_turn`, comes nearer to an obstacle than `reach`.

    Its legs are known to be clear.
    """
    if half == 0.0:
        return 0.0
    rows, cols = blocked.shape
    px, py = points[i, 0], points[i, 1]
    ux, uy = px - points[i - 1, 0], py - points[i - 1, 1]
    vx, vy = points[i + 1, 0] - px, points[i + 1, 1] - py
    u, v = math.hypot(ux, uy), math.hypot(vx, vy)
    if u == 0.0 or v == 0.0:
        return 0.0
    ux, uy, vx, vy = ux / u, uy / u, vx / v, vy / v
    side, back = math.copysign(1.0, half), radius * abs(half)
    ax, ay, bx, by = px - back * ux, py - back * uy, px + back * vx, py + back * vy
    # From the arc's ends to its centre; what is too near lies within `reach` of the arc in that direction.
    mx, my, nx, ny = -side * uy, side * ux, -side * vy, side * vx
    cx, cy = ax + radius * mx, ay + radius * my
    inner = max(radius - reach, 0.0)
    depth = min(reach, radius)
    low_x = min(px, ax, bx, ax + depth * mx, bx + depth * nx)
    high_x = max(px, ax, bx, ax + depth * mx, bx + depth * nx)
    low_y = min(py, ay, by, ay + depth * my, by + depth * ny)
    high_y = max(py, ay, by, ay + depth * my, by + depth * ny)
    worst = 0.0
    for row in range(max(0, math.ceil(low_y - 0.5)), min(rows - 1, math.floor(high_y + 0.5)) + 1):
        for col in range(max(0, math.ceil(low_x - 0.5)), min(cols - 1, math.floor(high_x + 0.5)) + 1):
            if not blocked[row, col] or row * cols + col == own:
                continue
            for corner in range(4):
                x, y = col - 0.5 + (corner >> 1) - cx, row - 0.5 + (corner & 1) - cy
                far2 = x * x + y * y
                if far2 <= (inner + worst) * (inner + worst):
                    continue
                # Between the arc's ends as seen from its centre, and on the inner side of both legs.
                if (
                    side * (x * my - y * mx) > 0.0
                    and side * (y * nx - x * ny) > 0.0
                    and x * mx + y * my > -radius
                    and x * nx + y * ny > -radius
                ):
                    worst = math.sqrt(far2) - inner
    return worst


@leaf
def cost(blocked, points, rooms, first, beyond, radius, own, most):  # type: ignore[no-untyped-def]
    """What legs `first` to `beyond` - 1 and the corners between them cost; above `most` not in full."""
    first, beyond = max(first, 0), min(beyond, points.shape[0] - 1)
    total, half = 0.0, half_turn(points, first)
    for leg in range(first, beyond):
        length = math.hypot(points[leg + 1, 0] - points[leg, 0], points[leg + 1, 1] - points[leg, 1])
        before, half = abs(half), half_turn(points, leg + 1)
        need = radius * (before + abs(half))
        if 0 < leg < points.shape[0] - 2:
            need = max(need, radius)
        total += length + _UNFIT * max(need - length, 0.0)
        if leg > first:
            total -= 2.0 * radius * (before - math.atan(before))
    for i in range(first + 1, beyond):
        if total >= most:
            break
        room, hindrance = min(rooms[i - 1], rooms[i]), own if i == 1 else _NO_CELL
        half = half_turn(points, i)
        near = shortfall(blocked, points, i, half, radius, room, hindrance)
        total += _NEAR * near + math.sqrt(radius * near)
    return total


@leaf
def leg_fits(points, leg, radius):  # type: ignore[no-untyped-def]
    """Whether a leg is as long as its turns need, and between two corners no shorter than the radius."""
    length = math.hypot(points[leg + 1, 0] - points[leg, 0], points[leg + 1, 1] - points[leg, 1])
    need = abs(half_turn(points, leg)) + abs(half_turn(points, leg + 1))
    if 0 < leg < points.shape[0] - 2:
        need = max(need, 1.0)
    return radius * need <= length + 1e-9


@leaf
def is_flown(blocked, points, rooms, i, radius, own):  # type: ignore[no-untyped-def]
    """Whether the turn at corner i fits its legs and keeps their clearance, but for `_HARDLY`."""
    if not (leg_fits(points, i - 1, radius) and leg_fits(points, i, radius)):
        return False
    room, hindrance = min(rooms[i - 1], rooms[i]), own if i == 1 else _NO_CELL
    near = shortfall(blocked, points, i, half_turn(points, i), radius, room, hindrance)
    return near <= _HARDLY * radius


@inlined
def _moved(blocked, points, rooms, i, step, turned, radius, own):  # type: ignore[no-untyped-def]
    """Move corner i by a step to where it costs least; whether it moved."""
    x, y = points[i, 0], points[i, 1]
    least = cost(blocked, points, rooms, i - 2, i + 2, radius, own, np.inf) - 1e-9
    best_x, best_y, moved = x, y, False
    hindrance, hit, beyond = own if i == 1 else _NO_CELL, _NO_CELL, _NO_CELL
    for k in range(_DIRECTIONS):
        angle = 2.0 * math.pi * (k + turned) / _DIRECTIONS
        points[i, 0], points[i, 1] = x + step * math.cos(angle), y + step * math.sin(angle)
        here = cost(blocked, points, rooms, i - 2, i + 2, radius, own, least)
        if here >= least:
            continue
        ax, ay, px, py = points[i - 1, 0], points[i - 1, 1], points[i, 0], points[i, 1]
        seen = blocker(blocked, ax, ay, px, py, rooms[i - 1], hindrance, hit)
        if seen >= 0:
            hit = seen
            continue
        bx, by = points[i + 1, 0], points[i + 1, 1]
        seen = blocker(blocked, px, py, bx, by, rooms[i], _NO_CELL, beyond)
        if seen >= 0:
            beyond = seen
            continue
        least, best_x, best_y, moved = here, px, py, True
    points[i, 0], points[i, 1] = best_x, best_y
    return moved


@leaf
def _descend(blocked, points, rooms, radius, own, steps):  # type: ignore[no-untyped-def]
    size = points.shape[0]
    for _ in range(_SWEEPS):
        busy = False
        for i in range(1, size - 1):
            if steps[i] < _LEAST_STEP:
                continue
            busy = True
            # Every other size of step looks between the directions of the one before.
            turned = 0.5 * (int(math.log2(_STEP / steps[i]) + 0.5) & 1)
            if not _moved(blocked, points, rooms, i, steps[i] * radius, turned, radius, own):
                steps[i] *= 0.5
        if not busy:
            break


@called
def ease(blocked, points, rooms, radius, own, fresh):  # type: ignore[no-untyped-def]
    """Move those `fresh` (k,) corners whose turns do not fit, and their neighbours, in place; ends stay.

    `rooms` (k - 1,) the clearance of each leg, in cells, that it keeps.
    """
    size = points.shape[0]
    steps = np.zeros(size)
    for i in range(1, size - 1):
        if fresh[i] and not is_flown(blocked, points, rooms, i, radius, own):
            for k in range(max(1, i - 1), min(size - 1, i + 2)):
                steps[k] = _STEP
    _descend(blocked, points, rooms, radius, own, steps)
