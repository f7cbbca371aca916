"""How a vehicle turns on to its first leg: an arc of the turn radius and its tangent, to the nearer side.

That is what autopilots do by themselves when they are given a place to fly to. Places in cells; angles
counter-clockwise from east.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import kernel, leaf
from gcs.planning.map.grid import TOUCH
from gcs.planning.map.line_of_sight import clear_leg, room_at

MOST_ARC = 1.8 * math.pi
"""No turn is longer: what is nearly a full circle is a detour or a rounding error."""
START_SHARE = 0.5
"""How much of the clearance is asked of a start: the vehicle is where it is, and has to turn from there."""
TIGHT = 0.5
"""Radius of the tightest turns to be expected, of the planned one."""
_EITHER_SIDE = math.radians(120.0)
_CHORD = math.radians(7.5)
ARC_HEIGHT = 1.0 - math.cos(0.5 * _CHORD)
"""Of an arc above its chords, in radii: arcs are looked at to this much (9 cm at 40 m)."""


@leaf
def arc_is_clear(blocked, reach, x, y, angle, side, sweep, radius, own):  # type: ignore[no-untyped-def]
    """Whether an arc from a place on a course keeps `reach`, looked at by its chords."""
    count = max(1, math.ceil(sweep / _CHORD))
    step = sweep / count
    chord = 2.0 * radius * math.sin(0.5 * step)
    for _ in range(count):
        to_x, to_y = (
            x + chord * math.cos(angle + side * 0.5 * step),
            y + chord * math.sin(angle + side * 0.5 * step),
        )
        if not clear_leg(blocked, x, y, to_x, to_y, reach, own):
            return False
        x, y, angle = to_x, to_y, angle + side * step
    return True


@leaf
def arc_to(x, y, angle, to_x, to_y, side, radius):  # type: ignore[no-untyped-def]
    """Sweep of the turn to a side until a place lies straight ahead, and the length of the tangent to it.

    A place inside the turn is not reached: both are inf.
    """
    dx, dy = to_x - x, to_y - y
    ahead = dx * math.cos(angle) + dy * math.sin(angle)
    beyond = side * (dy * math.cos(angle) - dx * math.sin(angle)) - radius
    gap = math.hypot(ahead, beyond)
    if gap < radius:
        return np.inf, np.inf
    sweep = math.atan2(ahead, -beyond) - math.acos(min(radius / gap, 1.0))
    if sweep < 0.0:
        sweep = 0.0 if sweep > -1e-9 else sweep + 2.0 * math.pi
    return sweep, math.sqrt(gap * gap - radius * radius)


@leaf
def start_arc(x, y, angle, to_x, to_y, radius):  # type: ignore[no-untyped-def]
    """Side (+1 left, -1 right), sweep and length of the turn to a place and the tangent that follows.

    To the nearer side; a place inside the turn is not reached: sweep and length are inf.
    """
    is_left = (to_y - y) * math.cos(angle) >= (to_x - x) * math.sin(angle)
    side = 1.0 if is_left else -1.0
    sweep, tangent = arc_to(x, y, angle, to_x, to_y, side, radius)
    return side, sweep, radius * sweep + tangent


@leaf
def _turn_is_clear(blocked, reach, x, y, angle, side, sweep, to_x, to_y, radius, own):  # type: ignore[no-untyped-def]
    """Whether an arc and the straight leg from its end to a place keep `reach`."""
    if not arc_is_clear(blocked, reach, x, y, angle, side, sweep, radius, own):
        return False
    turned = angle + side * sweep
    x += side * radius * (math.sin(turned) - math.sin(angle))
    y -= side * radius * (math.cos(turned) - math.cos(angle))
    return clear_leg(blocked, x, y, to_x, to_y, reach, own)


@kernel
def start_is_clear(blocked, reach, x, y, angle, to_x, to_y, radius, own):  # type: ignore[no-untyped-def]
    """Whether the turn to a place, and the tangent that follows, keep `reach`."""
    side, sweep, _ = start_arc(x, y, angle, to_x, to_y, radius)
    if sweep > MOST_ARC:
        return False
    return _turn_is_clear(blocked, reach, x, y, angle, side, sweep, to_x, to_y, radius, own)


@kernel
def start_is_safe(blocked, reach, x, y, angle, to_x, to_y, radius, own):  # type: ignore[no-untyped-def]
    """Whether the turn to a place keeps `reach` as it may be flown: tighter, or to the other side.

    No vehicle turns just as planned. Against the wind, or with more bank, it turns on half the radius; and
    towards a place that is nearly behind it, it turns to the side to which it happens to turn already.
    """
    dx, dy = to_x - x, to_y - y
    ahead, aside = dx * math.cos(angle) + dy * math.sin(angle), dy * math.cos(angle) - dx * math.sin(angle)
    nearer = 1.0 if aside >= 0.0 else -1.0
    sides = 2 if math.atan2(abs(aside), ahead) > _EITHER_SIDE else 1
    for one in (radius, TIGHT * radius):
        for k in range(sides):
            side = nearer if k == 0 else -nearer
            sweep = arc_to(x, y, angle, to_x, to_y, side, one)[0]
            if sweep > MOST_ARC:
                return False
            if not _turn_is_clear(blocked, reach, x, y, angle, side, sweep, to_x, to_y, one, own):
                return False
    return True


@kernel
def start_room(blocked, reach, x, y):  # type: ignore[no-untyped-def]
    """Clearance to ask of a start: a share of the wanted one, and no more than the vehicle has now."""
    return min(START_SHARE * reach, max(room_at(blocked, x, y, reach) - TOUCH, 0.0))
