"""Forward simulation of a fixed-wing vehicle that flies its onboard mission.

A mission is flown some seconds after its upload begins. A route that started at the current position would
start behind the vehicle and on another course.

Model: for a bearing error e to the next waypoint, the commanded turn rate is e / L with the turn lag L. The
turn rate follows with a lag of L / 3, a second-order heading loop with a damping of 0.87. On a loiter circle
of radius R, at distance d from the centre and speed V, a vector field commands the tangent course turned
inwards by atan((d - R) / (V tau)). A vehicle without a known mission keeps its turn rate.

Behind the first waypoint autopilots follow the line of each leg. The L1 guidance of ArduPlane (S. Park, J.
Deyst and J. How, "A new nonlinear guidance logic for trajectory tracking", AIAA 2004) aims at a point of the
line a time T1 of flight ahead. It commands sin(e) in place of e, at most that of 90 degrees, and its loop is
no faster than `L1_TURN` T1. Flights along a whole mission are simulated with it; turns on to a route fly to
their waypoints straight.

Other autopilots command the bearing of a point of the line as heading, with the error e in full. The
simulated airframe of the paper does so with `HEADING_S`.

To a circle farther than `_TRACKED_RADII`, autopilots that follow lines follow the line to its centre. From
there L1 flies to the circle (`gcs.planning.circle_guidance`).

In wind the vehicle heads into it: the bearing error is that of the course over ground, and a line's reference
point is farther off downwind. On a line the lateral acceleration of L1 turns the velocity over ground, so the
heading turns faster downwind.

A turn rate may be limited: a fast vehicle with a short lag turns with its greatest bank, much wider than by
its lag alone. Whether a path is clear is decided by several flights (`gcs.planning.flight_variants`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from gcs.jit import Call, inlined, kernel
from gcs.model import BoolArray, FloatArray
from gcs.planning.circle_guidance import L1_S, L1_TURN, l1_circle_rate
from gcs.planning.map.grid import Grid, Point, free_grid
from gcs.planning.map.line_of_sight import NO_CELL, clear_leg
from gcs.planning.wind_triangle import airspeed_m_s, over_ground

STEP_S = 0.2
_MIN_LAG_S = 0.5
_MAX_BEARING_ERROR_RAD = 0.75 * math.pi
_MAX_LEAD_RAD = 1.6
"""Limit of the feed-forward turn rate times lag. The field turns faster near the centre than vehicles can."""
HEADING_S = 6.0
"""Time of flight to the reference point of a heading law."""
_CATCHING = math.sqrt(0.5)
"""Sine of the greatest angle to a line."""
_TRACKED_RADII = 3.0
"""Distance from the centre of a circle beyond which the line to it is followed, in radii."""
_CIRCLE_CAPTURE_S = 5.0
"""Time constant tau of the vector field."""


@dataclass(frozen=True, slots=True)
class LoiterCircle:
    """Loiter circle, flown clockwise."""

    centre_m: Point
    radius_m: float


@dataclass(frozen=True, slots=True)
class RemainingMission:
    """Part of the onboard mission that a vehicle still has to fly."""

    points_m: tuple[Point, ...] = ()
    """Remaining waypoints, the next one first. Empty for a vehicle that loiters or has an unknown mission."""
    radii_m: tuple[float, ...] = ()
    """Acceptance radius of each waypoint."""
    wait_s: float = 0.0
    """Time until the next upload may begin (`gcs.core.tasking.upload_manager`)."""
    next_s: float = 0.0
    """Time until the first waypoint is passed."""
    circle: LoiterCircle | None = None
    """Loiter circle behind the last waypoint, if known."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Position, ground speed, course and turn rate of a vehicle at the time of its report."""

    east_m: float
    north_m: float
    speed_m_s: float
    course_rad: float
    """Clockwise from north."""
    turn_rate_rad_s: float = 0.0
    """Positive to the right."""
    age_s: float = 0.0
    """Age of the report."""
    ahead: RemainingMission = RemainingMission()

    @property
    def place_m(self) -> Point:
        """East and north."""
        return self.east_m, self.north_m


@dataclass(frozen=True, slots=True)
class SimulatedFlight:
    """States of a forward simulation, up to the first obstacle."""

    initial: Motion
    states: FloatArray
    """(k, 5): east, north, course, turn rate, waypoints passed. The report comes first."""
    is_clear: bool
    """True if no obstacle is nearer than the clearance."""
    max_bearing_error_rad: float
    """Greatest bearing error. The side of the turn is ambiguous for a waypoint astern."""

    def motion_at(self, index: int) -> Motion:
        """Return the motion and the remaining mission at a step."""
        east_m, north_m, course_rad, rate, passed = self.states[index].tolist()
        ahead = self.initial.ahead
        count = int(passed)
        left = RemainingMission(ahead.points_m[count:], ahead.radii_m[count:], circle=ahead.circle)
        return Motion(east_m, north_m, self.initial.speed_m_s, course_rad, rate, 0.0, left)


def simulate(
    grid: Grid,
    motion: Motion,
    ahead_s: float,
    lag_s: float = 1.0,
    clearance_m: float = 0.0,
    min_radius_m: float = 0.0,
    l1_s: float = 0.0,
    wind_m_s: Point = (0.0, 0.0),
) -> SimulatedFlight:
    """Simulate a vehicle ahead, until it comes nearer than the clearance to an obstacle.

    No turn is tighter than `min_radius_m`, in still air; 0 for no limit. Lines are followed by L1 with T1 =
    `l1_s`; below 0 by heading, to a point `-l1_s` of flight ahead; 0: each waypoint is flown to straight.
    `wind_m_s`: velocity of the air, east and north; in wind the speed of the motion is its airspeed, and the
    flight ends at the last waypoint if no circle follows. Without waypoints a vehicle keeps its turn rate.
    """
    ahead = motion.ahead
    circle = (0.0, 0.0, -1.0) if ahead.circle is None else (*ahead.circle.centre_m, ahead.circle.radius_m)
    states, is_clear, max_bearing_error_rad = simulate_states(
        grid.blocked,
        np.array([*grid.origin_m, grid.spacing_m]),
        np.array([*motion.place_m, motion.course_rad, motion.turn_rate_rad_s, motion.speed_m_s, *wind_m_s]),
        np.array(ahead.points_m, dtype=np.float64).reshape(-1, 2),
        np.array(ahead.radii_m, dtype=np.float64),
        np.array(circle),
        max(0.0, motion.age_s + ahead_s),
        max(lag_s, _MIN_LAG_S),
        max_turn_rate_rad_s(motion.speed_m_s, min_radius_m),
        max(clearance_m, 0.0) / grid.spacing_m,
        l1_s,
    )
    return SimulatedFlight(motion, states, bool(is_clear), float(max_bearing_error_rad))


def max_turn_rate_rad_s(speed_m_s: float, min_radius_m: float) -> float:
    """Return the turn rate on a circle; infinite for a radius of 0."""
    return speed_m_s / min_radius_m if min_radius_m > 0.0 else math.inf


@inlined
def _heading_for(course: float, speed: float, wind_x: float, wind_y: float) -> float:
    """Return the heading that gives a course over ground in a wind."""
    across = wind_x * math.cos(course) - wind_y * math.sin(course)
    return course - math.asin(min(max(across / max(speed, 1.0), -1.0), 1.0))


@inlined
def _is_reached(
    x: float, y: float, from_x: float, from_y: float, to_x: float, to_y: float, radius: float
) -> bool:
    """Return True within the acceptance radius, or past the end of the leg."""
    dx = to_x - x
    dy = to_y - y
    return math.hypot(dx, dy) <= radius or dx * (to_x - from_x) + dy * (to_y - from_y) <= 0.0


@inlined
def _line_bearing(
    x: float, y: float, from_x: float, from_y: float, to_x: float, to_y: float, reference: float
) -> float:
    """Return the bearing of the point of a line that is `reference` ahead."""
    leg_x = to_x - from_x
    leg_y = to_y - from_y
    aside = ((y - to_y) * leg_x - (x - to_x) * leg_y) / max(math.hypot(leg_x, leg_y), 1.0)
    return math.atan2(leg_x, leg_y) + math.asin(min(max(aside / reference, -_CATCHING), _CATCHING))


@inlined
def _circle_error(x: float, y: float, course: float, speed: float, circle: FloatArray) -> tuple[float, float]:
    """Return the course error to the vector field of a circle, and the turn rate of the field in flight."""
    dx = x - circle[0]
    dy = y - circle[1]
    gap = math.hypot(dx, dy)
    clearance = max(speed * _CIRCLE_CAPTURE_S, 1.0)
    inwards = math.atan((gap - circle[2]) / clearance)
    # At the centre there is no bearing: straight on.
    bearing = math.atan2(dx, dy) if gap > 1.0 else course
    off = (bearing + 0.5 * math.pi + inwards - course + math.pi) % (2.0 * math.pi) - math.pi
    turning = speed * math.cos(inwards) / max(gap, 0.5 * circle[2], 1.0)
    turning -= speed * math.sin(inwards) * math.cos(inwards) ** 2 / clearance
    return off, turning * max(0.0, math.cos(off))


_circle_rate_in_kernel = inlined(l1_circle_rate)


@kernel
def simulate_states(
    blocked: BoolArray, frame: FloatArray, motion: FloatArray, points: FloatArray, radii: FloatArray,
    circle: FloatArray, duration_s: float, lag_s: float, max_rate: float, clearance: float, l1_s: float,
) -> tuple[FloatArray, bool, float]:  # fmt: skip
    """Simulate the states of a flight: `SimulatedFlight.states`, `is_clear` and `max_bearing_error_rad`.

    `frame`: east and north of the grid origin and spacing, in metres. `motion`: east, north, course, turn
    rate, airspeed, and the wind, east and north. `circle`: east, north, radius, negative for none.
    `max_rate`: limit of the commanded turn rate. `clearance` in cells. `l1_s` as of `simulate`.
    """
    x = motion[0]
    y = motion[1]
    course = motion[2]
    rate = motion[3]
    speed = motion[4]
    wind_x = motion[5]
    wind_y = motion[6]
    is_windy = wind_x != 0.0 or wind_y != 0.0
    ground = speed
    heading = course
    if is_windy:
        heading = _heading_for(course, speed, wind_x, wind_y)
    states = np.empty((int(duration_s / STEP_S) + 3, 5))
    states[0, 0] = x
    states[0, 1] = y
    states[0, 2] = course
    states[0, 3] = rate
    states[0, 4] = 0.0
    from_x = x
    from_y = y
    passed = 0
    count = 1
    left = duration_s
    max_error = 0.0
    is_l1 = l1_s > 0.0
    guidance_s = max(lag_s, L1_TURN * l1_s) if is_l1 else lag_s
    while left > 0.0:
        step = min(STEP_S, left)
        left -= step
        if is_windy:
            over_x = speed * math.sin(heading) + wind_x
            over_y = speed * math.cos(heading) + wind_y
            ground = math.hypot(over_x, over_y)
            course = math.atan2(over_x, over_y)
        if passed < radii.size and _is_reached(
            x, y, from_x, from_y, points[passed, 0], points[passed, 1], radii[passed]
        ):
            from_x = points[passed, 0]
            from_y = points[passed, 1]
            passed += 1
            # A leg that would end at once begins at the vehicle.
            if (
                l1_s != 0.0
                and passed < radii.size
                and _is_reached(x, y, from_x, from_y, points[passed, 0], points[passed, 1], 0.0)
            ):
                from_x = x
                from_y = y
        if is_windy and 0 < passed == radii.size and circle[2] < 0.0:  # it flies on elsewhere
            break
        if passed < radii.size or circle[2] >= 0.0:
            is_leg = passed < radii.size
            if is_leg:
                goal_x = points[passed, 0]
                goal_y = points[passed, 1]
            else:
                goal_x = circle[0]
                goal_y = circle[1]
                if l1_s != 0.0 and math.hypot(goal_x - x, goal_y - y) > _TRACKED_RADII * circle[2]:
                    is_leg = not _is_reached(x, y, from_x, from_y, goal_x, goal_y, 0.0)
            if is_leg:
                bearing = math.atan2(goal_x - x, goal_y - y)
                loop_s = guidance_s
                if l1_s != 0.0 and passed > 0:
                    ahead = max(l1_s * ground, -l1_s * speed, 1.0)
                    bearing = _line_bearing(x, y, from_x, from_y, goal_x, goal_y, ahead)
                off = (bearing - course + math.pi) % (2.0 * math.pi) - math.pi
                turning = 0.0
            else:
                off, turning = _circle_error(x, y, course, speed, circle)
                loop_s = lag_s
                turning = min(max(turning, -_MAX_LEAD_RAD / lag_s), _MAX_LEAD_RAD / lag_s)
            max_error = max(max_error, abs(off))
            if l1_s >= 0.0:
                off = min(max(off, -_MAX_BEARING_ERROR_RAD), _MAX_BEARING_ERROR_RAD)
            if is_l1 and is_leg:
                off = math.sin(min(max(off, -0.5 * math.pi), 0.5 * math.pi))
                if is_windy:
                    off *= ground / speed
            wanted = off / loop_s + turning
            if is_l1 and not is_leg:
                wanted = _circle_rate_in_kernel(
                    x - circle[0], y - circle[1], course, ground, speed, circle[2], l1_s, guidance_s
                )
            wanted = min(max(wanted, -max_rate), max_rate)
            rate += (wanted - rate) * (1.0 - math.exp(-3.0 * step / lag_s))
        half = 0.5 * rate * step
        to_x = x + speed * step * math.sin(heading + half) + wind_x * step
        to_y = y + speed * step * math.cos(heading + half) + wind_y * step
        if not clear_leg(
            blocked,
            (x - frame[0]) / frame[2],
            (y - frame[1]) / frame[2],
            (to_x - frame[0]) / frame[2],
            (to_y - frame[1]) / frame[2],
            clearance,
            NO_CELL,
        ):
            return states[:count], False, max_error
        x = to_x
        y = to_y
        heading = heading + 2.0 * half
        if not is_windy:
            course = heading
        states[count, 0] = x
        states[count, 1] = y
        states[count, 2] = course
        states[count, 3] = rate
        states[count, 4] = passed
        count += 1
    return states[:count], True, max_error


def predict_motion(
    grid: Grid,
    motion: Motion,
    ahead_s: float,
    lag_s: float = 1.0,
    wind_m_s: Point | None = None,
    turn_radius_m: float = 0.0,
) -> Motion:
    """Return the predicted motion of a vehicle. If an obstacle is in the way, return that half-way to it.

    Parameters
    ----------
    wind_m_s : tuple of float, optional
        Velocity of the air that the vehicle reports, east and north. If one is given, L1 guidance in it is
        simulated, as autopilots fly that estimate the wind. If None, the vehicle turns straight to each
        waypoint, as the airframe of the paper.
    turn_radius_m : float
        Radius of the tightest turn in still air; not used if no wind is given.
    """
    if wind_m_s is None:
        return _end(simulate(grid, motion, ahead_s, lag_s))
    in_air = replace(motion, speed_m_s=airspeed_m_s(motion.speed_m_s, motion.course_rad, wind_m_s))
    end = _end(simulate(grid, in_air, ahead_s, lag_s, 0.0, turn_radius_m, L1_S, wind_m_s))
    return replace(end, speed_m_s=over_ground(end.course_rad, end.speed_m_s, *wind_m_s)[0])


def _end(flight: SimulatedFlight) -> Motion:
    return flight.motion_at(-1 if flight.is_clear else len(flight.states) // 2)


def warm_up_calls() -> list[Call]:
    """Return one call of the kernel with the types of a plan."""
    grid = free_grid((2, 2), 10.0)
    row = np.zeros(7)
    points = np.zeros((1, 2))
    radii = np.zeros(1)
    circle = np.array([0.0, 0.0, -1.0])
    return [(simulate_states, grid.blocked, np.ones(3), row, points, radii, circle, 0.2, 1.0, 1.0, 0.0, 0.0)]
