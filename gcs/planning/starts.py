"""How a vehicle turns on to its first leg: an arc of the turn radius and its tangent, to the nearer side.

That is what autopilots do by themselves when they are given a place to fly to. Places in cells; angles
counter-clockwise from east.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.compiling import called, kernel
from gcs.planning.grid import TOUCH, Grid, Point
from gcs.planning.sight import clear_leg, line_of_sight, room_at

MOST_ARC = 1.8 * math.pi
"""No turn is longer: what is nearly a full circle is a detour or a rounding error."""
_START_SHARE = 0.5
"""How much of the clearance is asked of a start: the vehicle is where it is, and has to turn from there."""
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
def start_arc(x, y, angle, to_x, to_y, radius):  # type: ignore[no-untyped-def]
    """Side (+1 left, -1 right), sweep and length of the turn to a place and the tangent that follows.

    A place inside the turn is not reached: sweep and length are inf.
    """
    dx, dy = to_x - x, to_y - y
    ahead, aside = dx * math.cos(angle) + dy * math.sin(angle), dy * math.cos(angle) - dx * math.sin(angle)
    side = 1.0 if aside >= 0.0 else -1.0
    gap = math.hypot(ahead, abs(aside) - radius)
    if gap < radius:
        return side, np.inf, np.inf
    sweep = math.atan2(ahead, radius - abs(aside)) - math.acos(min(radius / gap, 1.0))
    if sweep < 0.0:
        sweep = 0.0 if sweep > -1e-9 else sweep + 2.0 * math.pi
    return side, sweep, radius * sweep + math.sqrt(gap * gap - radius * radius)


@kernel
def start_is_clear(blocked, reach, x, y, angle, to_x, to_y, radius, own):  # type: ignore[no-untyped-def]
    """Whether the turn to a place, and the tangent that follows, keep `reach`."""
    side, sweep, _ = start_arc(x, y, angle, to_x, to_y, radius)
    if sweep > MOST_ARC or not arc_is_clear(blocked, reach, x, y, angle, side, sweep, radius, own):
        return False
    turned = angle + side * sweep
    x += side * radius * (math.sin(turned) - math.sin(angle))
    y -= side * radius * (math.cos(turned) - math.cos(angle))
    return clear_leg(blocked, x, y, to_x, to_y, reach, own)


@kernel
def start_room(blocked, reach, x, y):  # type: ignore[no-untyped-def]
    """Clearance to ask of a start: a share of the wanted one, and no more than the vehicle has now."""
    return min(_START_SHARE * reach, max(room_at(blocked, x, y, reach) - TOUCH, 0.0))


def expected_place(grid: Grid, place_m: Point, velocity_m_s: Point, ahead_s: float) -> Point:
    """Where a vehicle will be when it takes up a new route, as far as nothing stands in its way until there.

    A mission that is sent now is flown some time later, and the turn that it asks for later still: a route
    that began where the vehicle is would begin behind it.
    """
    for share in (1.0, 0.5):
        east_m, north_m = (place_m[k] + share * ahead_s * velocity_m_s[k] for k in range(2))
        if line_of_sight(grid, place_m, (east_m, north_m)):
            return east_m, north_m
    return place_m
