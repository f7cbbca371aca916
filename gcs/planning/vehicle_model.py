"""Where a vehicle will be in some seconds: what its autopilot holds is flown ahead in thought.

A mission that is sent now is flown some time later, and the turn that it asks for later still: a route that
began where the vehicle is would begin behind it, and on another course.

A vehicle that flies to a point off its course by e turns at the rate e / L, where L is its turn lag, and
takes a rate up with a lag of L / 3: so do heading loops of second order with a damping of 0.87, the simulated
airframe's among them. At the end of its mission it comes on to a circle by a vector field: at distance d from
the centre of a circle of radius R its course is to be the tangent, turned inwards by atan((d - R) / (V tau)).
One of which no more is known turns on as it does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.jit import Call, inlined, kernel
from gcs.model import FloatArray
from gcs.planning.map.grid import Grid, Point, free_grid
from gcs.planning.map.line_of_sight import clear_leg

STEP_S = 0.2
_LEAST_LAG_S = 0.5
_MOST_OFF_RAD = 0.75 * math.pi
_MOST_LEAD_RAD = 1.6
"""Near its centre a circle's field turns faster than vehicles follow; they lead it by so much at most."""
_CLOSING_S = 5.0
"""tau: how fast a circle's field brings a vehicle on to it."""


@dataclass(frozen=True, slots=True)
class LoiterCircle:
    """Where a vehicle waits, flying round to the right."""

    centre_m: Point
    radius_m: float


@dataclass(frozen=True, slots=True)
class RemainingMission:
    """What a vehicle flies to by itself."""

    points_m: tuple[Point, ...] = ()
    """The next one first; none for one that circles, or of which nothing is known."""
    radii_m: tuple[float, ...] = ()
    """How near to each it turns to the next."""
    wait_s: float = 0.0
    """How long no new mission should be sent to it (`gcs.core.tasking.upload_manager`)."""
    next_s: float = 0.0
    """Until it has the first of the points behind it."""
    circle: LoiterCircle | None = None
    """What it flies when all points are behind it, if that is known."""


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
    ahead: RemainingMission = RemainingMission()

    @property
    def place_m(self) -> Point:
        """East and north."""
        return self.east_m, self.north_m


@dataclass(frozen=True, slots=True)
class SimulatedFlight:
    """What was flown in thought, a moment after the other, up to what stands in the way."""

    initial: Motion
    way: FloatArray
    """(k, 5): east, north, course, turn rate, and how many points were behind it; the last report first."""
    is_clear: bool
    """Whether nothing stands in the way."""
    max_bearing_error_rad: float
    """How far off its course it had to turn at most: to what is behind it, it may turn either way."""

    def motion_at(self, index: int) -> Motion:
        """How the vehicle moves then, and what is ahead of it."""
        east_m, north_m, course_rad, rate, passed = self.way[index].tolist()
        ahead, count = self.initial.ahead, int(passed)
        left = RemainingMission(ahead.points_m[count:], ahead.radii_m[count:], circle=ahead.circle)
        return Motion(east_m, north_m, self.initial.speed_m_s, course_rad, rate, 0.0, left)


def simulate(
    grid: Grid, motion: Motion, ahead_s: float, lag_s: float = 1.0, clearance_m: float = 0.0
) -> SimulatedFlight:
    """Fly a vehicle ahead for a while, until it comes nearer than the clearance to an obstacle."""
    ahead = motion.ahead
    circle = (0.0, 0.0, -1.0) if ahead.circle is None else (*ahead.circle.centre_m, ahead.circle.radius_m)
    way, is_clear, max_bearing_error_rad = simulate_states(
        grid.blocked,
        np.array([*grid.origin_m, grid.spacing_m]),
        np.array([*motion.place_m, motion.course_rad, motion.turn_rate_rad_s, motion.speed_m_s]),
        np.array(ahead.points_m, dtype=np.float64).reshape(-1, 2),
        np.array(ahead.radii_m, dtype=np.float64),
        np.array(circle),
        max(0.0, motion.age_s + ahead_s),
        max(lag_s, _LEAST_LAG_S),
        max(clearance_m, 0.0) / grid.spacing_m,
    )
    return SimulatedFlight(motion, way, bool(is_clear), float(max_bearing_error_rad))


@inlined
def _is_reached(x, y, from_x, from_y, to_x, to_y, radius):  # type: ignore[no-untyped-def]
    """Within the radius, or beside the end of the leg."""
    dx, dy = to_x - x, to_y - y
    return math.hypot(dx, dy) <= radius or dx * (to_x - from_x) + dy * (to_y - from_y) <= 0.0


@inlined
def _round_off(x, y, course, speed, circle):  # type: ignore[no-untyped-def]
    """How far off a vehicle's course is from a circle's field, and how fast the field turns as it flies."""
    dx, dy = x - circle[0], y - circle[1]
    gap = math.hypot(dx, dy)
    reach = max(speed * _CLOSING_S, 1.0)
    inwards = math.atan((gap - circle[2]) / reach)
    # Over the centre there is no bearing: straight on, outwards.
    bearing = math.atan2(dx, dy) if gap > 1.0 else course
    off = (bearing + 0.5 * math.pi + inwards - course + math.pi) % (2.0 * math.pi) - math.pi
    turning = speed * math.cos(inwards) / max(gap, 0.5 * circle[2], 1.0)
    turning -= speed * math.sin(inwards) * math.cos(inwards) ** 2 / reach
    return off, turning * max(0.0, math.cos(off))


@kernel
def simulate_states(blocked, frame, motion, points, radii, circle, for_s, lag_s, reach):  # type: ignore[no-untyped-def]
    """Fly ahead: `Flight.way`, whether it is clear, and how far the course was off at most.

    `frame`: east and north of the grid's origin, spacing, in metres; `motion`: east, north, course, turn
    rate, speed; `circle`: east, north, radius, negative for none; `reach`: clearance in cells.
    """
    x, y, course, rate, speed = motion[0], motion[1], motion[2], motion[3], motion[4]
    way = np.empty((int(for_s / STEP_S) + 3, 5))
    way[0, 0], way[0, 1], way[0, 2], way[0, 3], way[0, 4] = x, y, course, rate, 0.0
    from_x, from_y, passed, count, left, most_off = x, y, 0, 1, for_s, 0.0
    while left > 0.0:
        step = min(STEP_S, left)
        left -= step
        if passed < radii.size and _is_reached(
            x, y, from_x, from_y, points[passed, 0], points[passed, 1], radii[passed]
        ):
            from_x, from_y = points[passed, 0], points[passed, 1]
            passed += 1
        if passed < radii.size or circle[2] >= 0.0:
            if passed < radii.size:
                bearing = math.atan2(points[passed, 0] - x, points[passed, 1] - y)
                off, turning = (bearing - course + math.pi) % (2.0 * math.pi) - math.pi, 0.0
            else:
                off, turning = _round_off(x, y, course, speed, circle)
                turning = min(max(turning, -_MOST_LEAD_RAD / lag_s), _MOST_LEAD_RAD / lag_s)
            most_off = max(most_off, abs(off))
            wanted = min(max(off, -_MOST_OFF_RAD), _MOST_OFF_RAD) / lag_s + turning
            rate += (wanted - rate) * (1.0 - math.exp(-3.0 * step / lag_s))
        half = 0.5 * rate * step
        to_x = x + speed * step * math.sin(course + half)
        to_y = y + speed * step * math.cos(course + half)
        if not clear_leg(
            blocked,
            (x - frame[0]) / frame[2],
            (y - frame[1]) / frame[2],
            (to_x - frame[0]) / frame[2],
            (to_y - frame[1]) / frame[2],
            reach,
            np.int64(-1),
        ):
            return way[:count], False, most_off
        x, y, course = to_x, to_y, course + 2.0 * half
        way[count, 0], way[count, 1], way[count, 2], way[count, 3], way[count, 4] = x, y, course, rate, passed
        count += 1
    return way[:count], True, most_off


def predict_motion(grid: Grid, motion: Motion, ahead_s: float, lag_s: float = 1.0) -> Motion:
    """How a vehicle will move in a while.

    Where something stands in its way, the answer is half of the way until there: it will not have been flown
    into.
    """
    flight = simulate(grid, motion, ahead_s, lag_s)
    return flight.motion_at(-1 if flight.is_clear else len(flight.way) // 2)


def warm_up_calls() -> list[Call]:
    """One call of the kernel, types as in a plan."""
    grid, row = free_grid((2, 2), 10.0), np.zeros(5)
    points, radii, circle = np.zeros((1, 2)), np.zeros(1), np.array([0.0, 0.0, -1.0])
    return [(simulate_states, grid.blocked, np.ones(3), row, points, radii, circle, 0.2, 1.0, 0.0)]
