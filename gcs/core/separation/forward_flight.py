"""Forward simulation of many vehicles at once.

Each vehicle flies from goal to goal: it turns towards a waypoint with its planned turn rate and flies on
straight, or follows a vector field round a circle. At distance d from the centre of a circle of radius R the
desired course is the tangent, turned inwards by ``atan((d - R) / (v tau))`` (`CONVERGENCE_S`). A vehicle
without a goal keeps its turn rate.

Autopilots follow legs and circles over ground and keep their airspeed V. So in a wind w the speed over ground
on a course with the unit vector c is ``w . c + sqrt(V^2 - (w x c)^2)``. L1 guidance banks more the faster a
vehicle is over ground: the greatest turn rate stays. A vehicle without a goal keeps its bank instead.

A height is a band. Autopilots change heights at once or evenly along a leg, and the band has both. Along a
leg a height changes as far as the vehicle comes nearer to its end: while it turns round it stays.

Shapes: n vehicles, m goals of each, k time steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from gcs.model import FloatArray, IntArray

STEP_S: Final = 1.0
CONVERGENCE_S: Final = 1.5
"""Time constant tau of the approach to a circle: that of L1 guidance with NAVL1_PERIOD 15 to 17 s."""
CLIMB_M_S: Final = 5.0
"""Vertical speed of a change of height."""
_MAX_CLIMB_M_S: Final = 7.5
"""Greatest vertical speed of a change of height."""
_LOW_SPEED_M_S: Final = 1.0
_ROUNDING_M: Final = 1e-3
"""More than rounding adds to a simulated way."""
_CLIMB_SPREAD: Final = 0.4
"""Relative uncertainty of the vertical speed after a take-off."""
_BEHIND_RAD: Final = 1.8
"""A near waypoint at this angle from the course has been passed, if it was ahead before."""
_AT_CENTRE_M: Final = 1.0
"""Distance from a centre within which a vehicle counts as flying straight away from it (AP_L1_Control)."""
_ON_CIRCLE: Final = 1.3
"""Distance from the centre of a circle, in radii, within which a vehicle flies on it."""
_LEVEL_S: Final = 2.0
"""Time in which a vehicle with another height to keep stops its climb."""


class GoalKind(IntEnum):
    """How a vehicle flies to a goal."""

    KEEP = 0
    """Keep turn rate and height."""
    WAYPOINT = 1
    CIRCLE = 2
    CLIMB = 3
    """Keep the course until the height is reached."""
    LAND = 4
    """Fly to a place; there the flight ends."""
    DRIFT = 5
    """Keep turn rate and vertical speed."""


_KEEP, _WAYPOINT, _CIRCLE, _CLIMB, _LAND, _DRIFT = (float(kind) for kind in GoalKind)


@dataclass(frozen=True, slots=True)
class Goal:
    """Part of a flight."""

    kind: GoalKind
    east_m: float = 0.0
    north_m: float = 0.0
    radius_m: float = 0.0
    """Of acceptance, or of the circle; a circle to the left has a negative one."""
    height_m: float = 0.0
    """Height at its end, above mean sea level."""
    for_s: float = np.inf
    """Time on the circle."""


@dataclass(frozen=True, slots=True)
class Flight:
    """State and intent of one vehicle."""

    vehicle: int
    east_m: float
    north_m: float
    height_m: float
    """Above mean sea level."""
    speed_m_s: float
    """Over ground."""
    course_rad: float
    climb_m_s: float
    turn_rate_rad_s: float
    """Positive to the right."""
    max_turn_rate_rad_s: float
    goals: tuple[Goal, ...]
    """At least one."""
    age_s: float = 0.0
    """Age of the state."""
    climb_gradient: float = 0.0
    """Vertical speed in a take-off climb, by ground speed."""
    height_error_m: float = 0.0
    """Half the width of the band of heights at the begin."""
    wind_m_s: tuple[float, float] = (0.0, 0.0)
    """Velocity of the air, east and north."""

    @property
    def airspeed_m_s(self) -> float:
        """Airspeed in the plane."""
        return airspeed_m_s(self.speed_m_s, self.course_rad, self.wind_m_s)

    def time_s(self, leg_m: tuple[float, float], circle_m: float) -> float:
        """Return the time of a straight leg, east and north, and of a way round circles."""
        wind_m_s = math.hypot(*self.wind_m_s)
        airspeed = self.airspeed_m_s
        along, _ = _over_ground(math.atan2(*leg_m), airspeed, *self.wind_m_s)
        around = max(airspeed - wind_m_s * wind_m_s / airspeed, _LOW_SPEED_M_S)
        return math.hypot(*leg_m) / float(along) + circle_m / around

    def reach_m(self, for_s: float) -> float:
        """Return an upper bound of the distance from its place after some time."""
        speed_m_s = max(self.speed_m_s, _LOW_SPEED_M_S)
        if self.wind_m_s != (0.0, 0.0):
            speed_m_s = airspeed_m_s(speed_m_s, self.course_rad, self.wind_m_s) + math.hypot(*self.wind_m_s)
        return speed_m_s * (for_s + self.age_s) + _ROUNDING_M


@dataclass(frozen=True, slots=True)
class FlightPaths:
    """Predicted positions of vehicles, at multiples of `STEP_S` from now."""

    vehicles: tuple[int, ...]
    east_m: FloatArray
    """(k, n)."""
    north_m: FloatArray
    """(k, n)."""
    low_m: FloatArray
    """(k, n), lower bound of the height; NaN after a landing."""
    high_m: FloatArray
    """(k, n), upper bound."""

    def since(self, step: int) -> FlightPaths:
        """Return the positions from a time step on."""
        east_m, north_m, low_m, high_m = (
            one[step:] for one in (self.east_m, self.north_m, self.low_m, self.high_m)
        )
        return FlightPaths(self.vehicles, east_m, north_m, low_m, high_m)


def airspeed_m_s(speed_m_s: float, course_rad: float, wind_m_s: tuple[float, float]) -> float:
    """Return the airspeed of a vehicle with a speed and a course over ground."""
    east, north = wind_m_s
    along = east * math.sin(course_rad) + north * math.cos(course_rad)
    squared = speed_m_s * (speed_m_s - 2.0 * along) + east * east + north * north
    return max(math.sqrt(max(squared, 0.0)), _LOW_SPEED_M_S)


def simulate_flights(flights: Sequence[Flight], for_s: float, step_s: float = STEP_S) -> FlightPaths:
    """Return the positions of vehicles for some time ahead; now is the first."""
    n = len(flights)
    steps = round(for_s / step_s) + 1
    most = max((len(flight.goals) for flight in flights), default=1)
    padded = [flight.goals + (flight.goals[-1],) * (most - len(flight.goals)) for flight in flights]
    table = np.array(
        [[(g.kind, g.east_m, g.north_m, g.radius_m, g.height_m, g.for_s) for g in goals] for goals in padded],
        dtype=np.float64,
    ).reshape(n, most, 6)
    last = np.array([len(flight.goals) - 1 for flight in flights], dtype=np.int64)
    state = np.array(
        [
            (
                flight.east_m,
                flight.north_m,
                flight.height_m,
                max(flight.speed_m_s, _LOW_SPEED_M_S),
                flight.course_rad,
                flight.climb_m_s,
                flight.turn_rate_rad_s,
                flight.max_turn_rate_rad_s,
                flight.age_s,
                flight.climb_gradient,
                flight.height_error_m,
                *flight.wind_m_s,
                flight.airspeed_m_s,
            )
            for flight in flights
        ],
        dtype=np.float64,
    ).reshape(n, 14)
    paths = np.empty((4, steps, n))
    _fly(table, last, state, paths, step_s)
    return FlightPaths(tuple(flight.vehicle for flight in flights), *paths)


def _fly(table: FloatArray, last: IntArray, state: FloatArray, paths: FloatArray, step_s: float) -> None:
    """Fill (4, k, n) with east, north, lower and upper height."""
    rows = np.arange(len(last))
    goal = np.zeros_like(last)
    columns = state.T.copy()
    east, north, height, speed, course, climb, turn_rate, max_rate, age, gradient, error_m = columns[:11]
    wind_east, wind_north, airspeed = columns[11:]
    is_windy = bool(wind_east.any() or wind_north.any())
    ahead = np.maximum(speed - wind_east * np.sin(course) - wind_north * np.cos(course), _LOW_SPEED_M_S)
    lateral = turn_rate * speed / ahead  # by airspeed
    low = height - error_m
    high = height + error_m
    in_air = np.ones(len(last), dtype=bool)
    circled_s = np.zeros(len(last))
    rising = np.maximum(climb, gradient * speed)
    dt = step_s + age  # the first step makes up for the age of the state
    paths[:, 0] = east + speed * age * np.sin(course), north + speed * age * np.cos(course), low, high
    closest = np.full(len(last), np.inf)  # to the goal, since it is the goal
    was_ahead = np.zeros(len(last), dtype=bool)
    is_new = True
    is_any_done = False
    for k in range(1, paths.shape[1]):
        if is_new or is_any_done:
            kind, to_east, to_north, radius, to_height, for_s = table[rows, goal].T
            is_leg = (kind == _WAYPOINT) | (kind == _LAND)
            is_circle = kind == _CIRCLE
            is_climb = kind == _CLIMB
            keeps = (kind == _KEEP) | (kind == _DRIFT)
            circle = np.maximum(np.abs(radius), 1.0)
            side = np.where(radius < 0.0, -1.0, 1.0)
            accept = np.maximum(radius, 0.0)
            is_new = False
        ahead_east = to_east - east
        ahead_north = to_north - north
        away = np.hypot(ahead_east, ahead_north)
        closest = np.minimum(closest, away)
        bearing = np.where(away > _AT_CENTRE_M, np.arctan2(ahead_east, ahead_north), course + np.pi)
        # Round a circle: the tangent, half a step ahead.
        inwards = np.arctan((away - circle) / (speed * CONVERGENCE_S))
        lead = 0.5 * speed * dt / np.maximum(away, 0.5 * circle)
        bearing += is_circle * (np.pi + side * (0.5 * np.pi + inwards + lead))
        error = (bearing - course + np.pi) % (2.0 * np.pi) - np.pi
        turned = np.minimum(np.maximum(error, -max_rate * dt), max_rate * dt)
        turned = np.where(keeps, turn_rate * dt, turned * ~is_climb)
        course += 0.5 * turned
        if is_windy:
            speed, ahead = _over_ground(course, airspeed, wind_east, wind_north)
            turn_rate = lateral * ahead / speed
        moved = speed * dt * in_air
        east += moved * np.sin(course)
        north += moved * np.cos(course)
        course += 0.5 * turned
        # Heights change at once, or evenly up to the goal.
        change = CLIMB_M_S * dt
        most = _MAX_CLIMB_M_S * dt
        on_circle = is_circle & (away <= _ON_CIRCLE * circle)
        left = np.hypot(to_east - east, to_north - north)
        share = np.maximum(1.0 - left / np.maximum(closest, 1e-3), 0.0)
        share = np.where(on_circle, np.minimum(moved / np.maximum(away, 1e-3), 1.0), share)
        up = to_height - low
        up_high = to_height - high
        at_once = np.minimum(np.maximum(up, -change), change)
        at_once_high = np.minimum(np.maximum(up_high, -change), change)
        evenly = np.minimum(np.maximum(up * share, -most), most)
        evenly_high = np.minimum(np.maximum(up_high * share, -most), most)
        drift = climb * dt * ((k * step_s <= _LEVEL_S) | (kind == _DRIFT))
        by_goal = is_leg | is_circle
        low += np.where(by_goal, np.minimum(at_once, evenly), np.minimum(drift, 0.0) * ~is_climb)
        high += np.where(by_goal, np.maximum(at_once_high, evenly_high), np.maximum(drift, 0.0) * ~is_climb)
        low += is_climb * (1.0 - _CLIMB_SPREAD) * rising * dt
        high += is_climb * (1.0 + _CLIMB_SPREAD) * rising * dt
        high = np.where(is_climb, np.minimum(high, np.maximum(to_height, height)), high)
        is_done = is_climb & (0.5 * (low + high) >= to_height)
        is_behind = np.abs(error) > _BEHIND_RAD
        is_passed = is_behind & was_ahead & (away < 2.0 * speed / max_rate)
        was_ahead |= ~is_behind
        is_done |= is_leg & ((away <= accept + moved) | is_passed)
        circled_s = (circled_s + dt) * on_circle
        is_done |= is_circle & (circled_s >= for_s)
        is_any_done = bool(is_done.any())
        if is_any_done:
            in_air &= ~(is_done & (kind == _LAND))
            circled_s[is_done] = 0.0
            closest[is_done] = np.inf
            was_ahead[is_done] = False
            goal = np.where(is_done, np.minimum(goal + 1, last), goal)
        paths[0, k] = east
        paths[1, k] = north
        paths[2, k] = low
        paths[3, k] = high
        paths[2:, k, ~in_air] = np.nan
        dt = step_s


def _over_ground(
    course: FloatArray | float,
    airspeed: FloatArray | float,
    wind_east: FloatArray | float,
    wind_north: FloatArray | float,
) -> tuple[FloatArray, FloatArray]:
    """Return the speed over ground on a course, and the part of the airspeed along it."""
    sine = np.sin(course)
    cosine = np.cos(course)
    across = wind_east * cosine - wind_north * sine
    ahead: FloatArray = np.sqrt(np.maximum(airspeed * airspeed - across * across, 0.0))
    along = wind_east * sine + wind_north * cosine
    return np.maximum(along + ahead, _LOW_SPEED_M_S), ahead
