"""Where a vehicle will be in some seconds: what its autopilot holds is flown ahead in thought.

A mission that is sent now is flown some time later, and the turn that it asks for later still: a route that
began where the vehicle is would begin behind it, and on another course.

A vehicle that flies to a point off its course by e turns at the rate e / L, where L is its turn lag, and
takes a rate up with a lag of L / 3: so do heading loops of second order with a damping of 0.87, the simulated
airframe's among them. One that circles turns on as it does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gcs.geo import bearing_rad, wrap_pi
from gcs.planning.grid import Grid, Point
from gcs.planning.sight import line_of_sight

_STEP_S = 0.2
_LEAST_LAG_S = 0.5
_MOST_OFF_RAD = 0.75 * math.pi


@dataclass(frozen=True, slots=True)
class Ahead:
    """What a vehicle flies to by itself."""

    points_m: tuple[Point, ...] = ()
    """The next one first; none for one that circles, or of which nothing is known."""
    radii_m: tuple[float, ...] = ()
    """How near to each it turns to the next."""
    wait_s: float = 0.0
    """How long no new mission should be sent to it (`gcs.command.tasking`)."""
    next_s: float = 0.0
    """Until it has the first of the points behind it."""


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
    ahead: Ahead = Ahead()

    @property
    def place_m(self) -> Point:
        """East and north."""
        return self.east_m, self.north_m


@dataclass(frozen=True, slots=True)
class Flight:
    """What was flown in thought, a moment after the other."""

    moments: tuple[Motion, ...]
    """From the last report on, each with what is ahead then; up to what stands in the way."""
    is_clear: bool
    """Whether nothing does."""


def fly(grid: Grid, motion: Motion, ahead_s: float, lag_s: float = 1.0, clearance_m: float = 0.0) -> Flight:
    """Fly a vehicle ahead for a while, until it comes nearer than the clearance to an obstacle."""
    place, course_rad, rate = motion.place_m, motion.course_rad, motion.turn_rate_rad_s
    points, radii, speed_m_s = motion.ahead.points_m, motion.ahead.radii_m, motion.speed_m_s
    leg_from = place
    lag_s = max(lag_s, _LEAST_LAG_S)
    left_s = motion.age_s + ahead_s
    moments = [replace(motion, age_s=0.0)]
    while left_s > 0.0:
        step_s = min(_STEP_S, left_s)
        left_s -= step_s
        if points and _is_reached(place, leg_from, points[0], radii[0]):
            leg_from, points, radii = points[0], points[1:], radii[1:]
        if points:
            off_rad = wrap_pi(bearing_rad(*place, *points[0]) - course_rad)
            wanted = min(max(off_rad, -_MOST_OFF_RAD), _MOST_OFF_RAD) / lag_s
            rate += (wanted - rate) * (1.0 - math.exp(-3.0 * step_s / lag_s))
        half_rad = 0.5 * rate * step_s
        chord_m = speed_m_s * step_s
        there = (
            place[0] + chord_m * math.sin(course_rad + half_rad),
            place[1] + chord_m * math.cos(course_rad + half_rad),
        )
        if not line_of_sight(grid, place, there, clearance_m):
            return Flight(tuple(moments), False)
        place, course_rad = there, course_rad + 2.0 * half_rad
        moments.append(Motion(*place, speed_m_s, course_rad, rate, 0.0, Ahead(points, radii)))
    return Flight(tuple(moments), True)


def expected(grid: Grid, motion: Motion, ahead_s: float, lag_s: float = 1.0) -> Motion:
    """How a vehicle will move in a while.

    Where something stands in its way, the answer is half of the way until there: it will not have been flown
    into.
    """
    flight = fly(grid, motion, ahead_s, lag_s)
    return flight.moments[-1 if flight.is_clear else len(flight.moments) // 2]


def _is_reached(place: Point, leg_from: Point, point: Point, radius_m: float) -> bool:
    """Within the radius, or beside the end of the leg."""
    east_m, north_m = point[0] - place[0], point[1] - place[1]
    along = east_m * (point[0] - leg_from[0]) + north_m * (point[1] - leg_from[1])
    return math.hypot(east_m, north_m) <= radius_m or along <= 0.0
