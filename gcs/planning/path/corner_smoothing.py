"""Corner smoothing: move the corners of a route until its turns can be flown.

At a corner of angle a, an arc of turn radius R is tangent to both legs, R tan(a/2) before and after the
corner. Where a string-pulled path turns around an obstacle, the arc passes nearer to it than the corner. Two
close corners may need more of their leg than there is. Corners are moved jointly to the least cost: length
along legs and arcs, plus penalties for legs that are too short and arcs with too little clearance. Legs keep
their own clearance. Method: compass search (R. Hooke and T. A. Jeeves, JACM 8, 1961), corner by corner.
Corners whose turns fit do not move.

*Clearance of an arc* is exact. Its legs are clear, so the nearest obstacle is between the legs: on the inner
side of the arc, where the farthest point of a square from the centre of the arc is one of its corners, or
between the arc and the corner of a sharp turn, where the nearest point counts. A square that the arc crosses
counts by the less of the two distances that would free it.

Positions in cells: x = column, y = row.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import called, inlined, leaf
from gcs.model import BoolArray, FloatArray
from gcs.planning.map.line_of_sight import NO_CELL, blocking_cell, is_free_at
from gcs.planning.path.points import leg_vector, set_point

_SHORT_LEG_WEIGHT = 4.0
"""Cost of a length that turns lack of their leg."""
_SHORTFALL_WEIGHT = 3.0
"""Cost of a clearance shortfall, besides the root of shortfall times radius: a turn that is late by d comes
nearer by d^2 / 2R only.
"""
_SHORTFALL_TOLERANCE = 1e-3
"""Tolerated shortfall, in radii: 4 cm at 40 m."""
_MAX_STEP = 0.2
"""First step of a corner, in radii."""
_MIN_STEP = 0.007
"""Last step of a corner, in radii."""
_DIRECTIONS = 4
_SWEEPS = 40
_MAX_HALF_ANGLE_TAN = math.tan(0.475 * math.pi)
"""Tangent of half the sharpest angle that is distinguished."""


@called
def turn_angle(points: FloatArray, i: int) -> float:
    """Return the turn angle at corner i, positive to the left, in (-pi, pi]."""
    ux, uy = leg_vector(points, i - 1)
    vx, vy = leg_vector(points, i)
    return math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)


@leaf
def half_angle_tan(points: FloatArray, i: int) -> float:
    """Return the tangent of half the turn angle at corner i, positive to the left; 0 at the ends."""
    if i <= 0 or i >= points.shape[0] - 1:
        return 0.0
    ux = points[i, 0] - points[i - 1, 0]
    uy = points[i, 1] - points[i - 1, 1]
    vx = points[i + 1, 0] - points[i, 0]
    vy = points[i + 1, 1] - points[i, 1]
    along = ux * vx + uy * vy
    across = ux * vy - uy * vx
    whole = math.sqrt((ux * ux + uy * uy) * (vx * vx + vy * vy))
    # tan(a/2) = sin(a) / (1 + cos(a))
    half = abs(across) / max(whole + along, 1e-12 + 1e-6 * whole)
    return math.copysign(
        min(half, _MAX_HALF_ANGLE_TAN) if along > -whole * (1.0 - 1e-9) else _MAX_HALF_ANGLE_TAN, across
    )


@leaf
def clearance_shortfall(
    blocked: BoolArray, points: FloatArray, i: int, half: float, radius: float, clearance: float,
    own_cell: int,
) -> float:  # fmt: skip
    """Return how much nearer than `clearance` the arc at corner i comes to an obstacle.

    `half`: its `half_angle_tan`. Its legs are clear.
    """
    if half == 0.0:
        return 0.0
    rows, cols = blocked.shape
    px = points[i, 0]
    py = points[i, 1]
    ux = px - points[i - 1, 0]
    uy = py - points[i - 1, 1]
    vx = points[i + 1, 0] - px
    vy = points[i + 1, 1] - py
    u = math.hypot(ux, uy)
    v = math.hypot(vx, vy)
    if u == 0.0 or v == 0.0:
        return 0.0
    ux = ux / u
    uy = uy / u
    vx = vx / v
    vy = vy / v
    side = math.copysign(1.0, half)
    back = radius * abs(half)
    ax = px - back * ux
    ay = py - back * uy
    bx = px + back * vx
    by = py + back * vy
    # Unit vectors from the ends of the arc to its centre.
    mx = -side * uy
    my = side * ux
    nx = -side * vy
    ny = side * vx
    cx = ax + radius * mx
    cy = ay + radius * my
    inner = max(radius - clearance, 0.0)
    depth = min(clearance, radius)
    low_x = min(px, ax, bx, ax + depth * mx, bx + depth * nx)
    high_x = max(px, ax, bx, ax + depth * mx, bx + depth * nx)
    low_y = min(py, ay, by, ay + depth * my, by + depth * ny)
    high_y = max(py, ay, by, ay + depth * my, by + depth * ny)
    worst = 0.0
    for row in range(max(0, math.ceil(low_y - 0.5)), min(rows - 1, math.floor(high_y + 0.5)) + 1):
        for col in range(max(0, math.ceil(low_x - 0.5)), min(cols - 1, math.floor(high_x + 0.5)) + 1):
            if not blocked[row, col] or row * cols + col == own_cell:
                continue
            near_x = max(abs(col - cx) - 0.5, 0.0)
            near_y = max(abs(row - cy) - 0.5, 0.0)
            from_outside = radius + clearance - math.sqrt(near_x * near_x + near_y * near_y)
            if from_outside <= worst:
                continue
            for corner in range(4):
                x = col - 0.5 + (corner >> 1) - cx
                y = row - 0.5 + (corner & 1) - cy
                far2 = x * x + y * y
                if far2 <= (inner + worst) * (inner + worst):
                    continue
                # Between the ends of the arc seen from its centre, on the inner side of both legs.
                if (
                    side * (x * my - y * mx) > 0.0
                    and side * (y * nx - x * ny) > 0.0
                    and x * mx + y * my > -radius
                    and x * nx + y * ny > -radius
                ):
                    worst = max(worst, min(math.sqrt(far2) - inner, from_outside))
    return worst


@leaf
def cost(
    blocked: BoolArray, points: FloatArray, clearances: FloatArray, first: int, beyond: int, radius: float,
    own_cell: int, most: float,
) -> float:  # fmt: skip
    """Return the cost of legs `first` to `beyond` - 1 and their corners; above `most` not in full."""
    first = max(first, 0)
    beyond = min(beyond, points.shape[0] - 1)
    total = 0.0
    half = half_angle_tan(points, first)
    for leg in range(first, beyond):
        length = math.hypot(points[leg + 1, 0] - points[leg, 0], points[leg + 1, 1] - points[leg, 1])
        before = abs(half)
        half = half_angle_tan(points, leg + 1)
        need = radius * (before + abs(half))
        if 0 < leg < points.shape[0] - 2:
            need = max(need, radius)
        total += length + _SHORT_LEG_WEIGHT * max(need - length, 0.0)
        if leg > first:
            total -= 2.0 * radius * (before - math.atan(before))
    for i in range(first + 1, beyond):
        if total >= most:
            break
        margin = min(clearances[i - 1], clearances[i])
        ignored_cell = own_cell if i == 1 else NO_CELL
        half = half_angle_tan(points, i)
        near = clearance_shortfall(blocked, points, i, half, radius, margin, ignored_cell)
        total += _SHORTFALL_WEIGHT * near + math.sqrt(radius * near)
    return total


@leaf
def leg_fits(points: FloatArray, leg: int, radius: float) -> bool:
    """Return True if a leg is long enough for its turns, and no shorter than the radius between corners."""
    length = math.hypot(points[leg + 1, 0] - points[leg, 0], points[leg + 1, 1] - points[leg, 1])
    need = abs(half_angle_tan(points, leg)) + abs(half_angle_tan(points, leg + 1))
    if 0 < leg < points.shape[0] - 2:
        need = max(need, 1.0)
    return radius * need <= length + 1e-9


@leaf
def turn_fits(
    blocked: BoolArray, points: FloatArray, clearances: FloatArray, i: int, radius: float, own_cell: int
) -> bool:
    """Return True if the turn at corner i fits its legs and keeps their clearance."""
    if not (leg_fits(points, i - 1, radius) and leg_fits(points, i, radius)):
        return False
    margin = min(clearances[i - 1], clearances[i])
    ignored_cell = own_cell if i == 1 else NO_CELL
    near = clearance_shortfall(blocked, points, i, half_angle_tan(points, i), radius, margin, ignored_cell)
    return near <= _SHORTFALL_TOLERANCE * radius


@inlined
def _move_corner(
    blocked: BoolArray, points: FloatArray, clearances: FloatArray, i: int, step: float, turned: float,
    radius: float, own_cell: int,
) -> bool:  # fmt: skip
    """Move corner i by a step to where it costs least; return True if it moved."""
    x = points[i, 0]
    y = points[i, 1]
    least = cost(blocked, points, clearances, i - 2, i + 2, radius, own_cell, np.inf) - 1e-9
    best_x = x
    best_y = y
    moved = False
    ignored_cell = own_cell if i == 1 else NO_CELL
    hit = NO_CELL
    beyond = NO_CELL
    for k in range(_DIRECTIONS):
        angle = 2.0 * math.pi * (k + turned) / _DIRECTIONS
        set_point(points, i, x + step * math.cos(angle), y + step * math.sin(angle))
        if not is_free_at(blocked, points[i, 0], points[i, 1]):
            continue
        here = cost(blocked, points, clearances, i - 2, i + 2, radius, own_cell, least)
        if here >= least:
            continue
        ax = points[i - 1, 0]
        ay = points[i - 1, 1]
        px = points[i, 0]
        py = points[i, 1]
        seen = blocking_cell(blocked, ax, ay, px, py, clearances[i - 1], ignored_cell, hit)
        if seen >= 0:
            hit = seen
            continue
        bx = points[i + 1, 0]
        by = points[i + 1, 1]
        seen = blocking_cell(blocked, px, py, bx, by, clearances[i], NO_CELL, beyond)
        if seen >= 0:
            beyond = seen
            continue
        least = here
        best_x = px
        best_y = py
        moved = True
    set_point(points, i, best_x, best_y)
    return moved


@leaf
def _compass_search(
    blocked: BoolArray, points: FloatArray, clearances: FloatArray, radius: float, own_cell: int,
    steps: FloatArray,
) -> None:  # fmt: skip
    size = points.shape[0]
    for _ in range(_SWEEPS):
        busy = False
        for i in range(1, size - 1):
            if steps[i] < _MIN_STEP:
                continue
            busy = True
            # Every other step size uses directions half-way between those of the one before.
            turned = 0.5 * (int(math.log2(_MAX_STEP / steps[i]) + 0.5) & 1)
            if not _move_corner(blocked, points, clearances, i, steps[i] * radius, turned, radius, own_cell):
                steps[i] *= 0.5
        if not busy:
            break


@called
def smooth_corners(
    blocked: BoolArray, points: FloatArray, clearances: FloatArray, radius: float, own_cell: int,
    changed: BoolArray,
) -> None:  # fmt: skip
    """Move the `changed` (k,) corners whose turns do not fit, and their neighbours, in place; ends stay.

    `clearances` (k - 1,): clearance that each leg keeps, in cells.
    """
    size = points.shape[0]
    steps = np.zeros(size)
    for i in range(1, size - 1):
        if changed[i] and not turn_fits(blocked, points, clearances, i, radius, own_cell):
            for k in range(max(1, i - 1), min(size - 1, i + 2)):
                steps[k] = _MAX_STEP
    _compass_search(blocked, points, clearances, radius, own_cell, steps)
