"""How a vehicle turns on to its first leg: an arc of the turn radius and its tangent, to the nearer side.

That is what autopilots do by themselves when they are given a place to fly to. Places in cells; angles
counter-clockwise from east.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.compiling import called, kernel
from gcs.geo import bearing_rad, wrap_pi
from gcs.planning.grid import TOUCH, Grid, Point
from gcs.planning.sight import clear_leg, line_of_sight, room_at

MOST_ARC = 1.8 * math.pi
"""No turn is longer: what is nearly a full circle is a detour or a rounding error."""
_START_SHARE = 0.5
"""How much of the clearance is asked of a start: the vehicle is where it is, and has to turn from there."""
TIGHT = 0.5
"""Radius of the tightest turns to be expected, of the planned one."""
_EITHER_SIDE = math.radians(120.0)
_TINY_S = 1e-9
_CHORD = math.radians(7.5)
ARC_HEIGHT = 1.0 - math.cos(0.5 * _CHORD)
"""Of an arc above its chords, in radii: arcs are looked at to this much (9 cm at 40 m)."""


@called
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


@called
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


@called
def start_arc(x, y, angle, to_x, to_y, radius):  # type: ignore[no-untyped-def]
    """Side (+1 left, -1 right), sweep and length of the turn to a place and the tangent that follows.

    To the nearer side; a place inside the turn is not reached: sweep and length are inf.
    """
    is_left = (to_y - y) * math.cos(angle) >= (to_x - x) * math.sin(angle)
    side = 1.0 if is_left else -1.0
    sweep, tangent = arc_to(x, y, angle, to_x, to_y, side, radius)
    return side, sweep, radius * sweep + tangent


@called
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
    return min(_START_SHARE * reach, max(room_at(blocked, x, y, reach) - TOUCH, 0.0))


@dataclass(frozen=True, slots=True)
class Motion:
    """Where a vehicle was, how it flew over ground, and how long ago that was."""

    east_m: float
    north_m: float
    speed_m_s: float
    course_rad: float
    """Clockwise from north."""
    turn_rate_rad_s: float = 0.0
    """To the right."""
    age_s: float = 0.0


def expected(
    grid: Grid, motion: Motion, ahead_s: float, toward_m: Point | None = None
) -> tuple[Point, float]:
    """Where a vehicle will be when it takes up a new route, and on which course.

    A mission that is sent now is flown some time later, and the turn that it asks for later still: a route
    that began where the vehicle is would begin behind it. Until then it turns on as it does now, but not
    beyond the bearing of `toward_m`, the point that it flies to, if there is one; and it is taken no farther
    than nothing stands in its way.
    """
    rate, speed_m_s = motion.turn_rate_rad_s, motion.speed_m_s
    now, course_rad = _flown(
        (motion.east_m, motion.north_m), motion.course_rad, speed_m_s, rate, motion.age_s
    )
    turn_rad = rate * ahead_s
    if toward_m is not None:
        left_rad = wrap_pi(bearing_rad(*now, *toward_m) - course_rad)
        turn_rad = min(max(turn_rad, min(left_rad, 0.0)), max(left_rad, 0.0))
    for share in (1.0, 0.5):
        t_s = share * ahead_s
        there, then_rad = _flown(now, course_rad, speed_m_s, turn_rad / max(ahead_s, _TINY_S), t_s)
        if line_of_sight(grid, now, there):
            return there, then_rad
    return now, course_rad


def _flown(
    place_m: Point, course_rad: float, speed_m_s: float, rate_rad_s: float, t_s: float
) -> tuple[Point, float]:
    """Place and course after a steady turn: along its chord."""
    half_rad = 0.5 * rate_rad_s * t_s
    chord_m = speed_m_s * t_s * (math.sin(half_rad) / half_rad if half_rad else 1.0)
    east_m = place_m[0] + chord_m * math.sin(course_rad + half_rad)
    north_m = place_m[1] + chord_m * math.cos(course_rad + half_rad)
    return (east_m, north_m), course_rad + 2.0 * half_rad
