"""Forward flight: where many vehicles will be in the next seconds, with their climbs.

Each vehicle flies from goal to goal: it turns towards a waypoint with its planned turn rate and flies on
straight, or by L1 guidance to a circle and round it (`gcs.planning.circle_guidance`). A vehicle without a
goal keeps its turn rate.

Autopilots follow legs and circles over ground and keep their airspeed (`gcs.planning.wind_triangle`). L1
guidance banks more the faster a vehicle is over ground: the greatest turn rate stays. A vehicle without a
goal keeps its bank instead.

A height is a band. Autopilots change heights at once or evenly along a leg, and the band has both. Along a
leg a height changes as far as the vehicle comes nearer to its end: while it turns round it stays. Vertical
speeds follow with a lag, and the band has the heights with and without it.

Shapes: n vehicles, m goals of each, k time steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from typing import Final

import numpy as np

from gcs.geo import wrap_pi
from gcs.jit import Call, kernel, spliced
from gcs.model import FloatArray, IntArray
from gcs.planning.circle_guidance import L1_S, L1_TURN, l1_circle_rate
from gcs.planning.wind_triangle import LOW_SPEED_M_S, airspeed_m_s, leg_time_s, over_ground

STEP_S: Final = 1.0
_CIRCLE_STEPS: Final = 4
"""Steps on a circle for each step in time."""
_ROLL_S: Final = 0.2
"""Time constant with which the turn rate follows on circles."""
CLIMB_M_S: Final = 5.0
"""Vertical speed of a change of height."""
SLOW_SINK_M_S: Final = 2.5
"""Vertical speed of a return that descends on its circle (ArduPlane over Davos: 2.6 m/s)."""
_SINKS_M_S: Final = 1.0
"""A descent to a circle that has begun goes on as fast, or faster."""
_MAX_CLIMB_M_S: Final = 7.5
"""Greatest vertical speed of a change of height."""
_ROUNDING_M: Final = 1e-3
"""More than rounding adds to a simulated way."""
_CLIMB_LAG_S: Final = 3.0
"""Time constant with which the vertical speed follows: that of TECS."""
_CLIMB_SPREAD: Final = 0.4
"""Relative uncertainty of the vertical speed after a take-off."""
_BEHIND_RAD: Final = 1.8
"""A near waypoint at this angle from the course has been passed, if it was ahead before."""
_LOOP_S: Final = L1_TURN * L1_S
_ON_CIRCLE: Final = 1.3
"""Distance from the centre of a circle, in radii, within which a vehicle flies on it."""
_LEVEL_S: Final = 2.0
"""Time in which a vehicle with another height to keep stops its climb."""


MAX_ROUND_S: Final = 120.0
"""Longest time to a circle and once round it that is predicted."""


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
    delay_s: float = 0.0
    """Time from now until it flies to its goals; until then it keeps its turn rate."""

    @property
    def airspeed_m_s(self) -> float:
        """Airspeed in the plane."""
        return airspeed_m_s(self.speed_m_s, self.course_rad, self.wind_m_s)

    @property
    def turn_rad(self) -> float:
        """Turn from the course to the next waypoint, positive to the right; 0 to other goals."""
        goal = self.goals[0]
        if goal.kind is not GoalKind.WAYPOINT:
            return 0.0
        bearing_rad = math.atan2(goal.east_m - self.east_m, goal.north_m - self.north_m)
        return wrap_pi(bearing_rad - self.course_rad)

    def time_s(self, leg_m: tuple[float, float], circle_m: float) -> float:
        """Return the time of a straight leg, east and north, and of a way round circles."""
        wind_m_s = math.hypot(*self.wind_m_s)
        airspeed = self.airspeed_m_s
        around = max(airspeed - wind_m_s * wind_m_s / airspeed, LOW_SPEED_M_S)
        return leg_time_s(leg_m, airspeed, self.wind_m_s) + circle_m / around

    @property
    def round_s(self) -> float:
        """Time to the circle at the end of the flight, straight, and once round it; at most `MAX_ROUND_S`."""
        last = self.goals[-1]
        leg_m = (last.east_m - self.east_m, last.north_m - self.north_m)
        return min(self.time_s(leg_m, 2.0 * math.pi * abs(last.radius_m)), MAX_ROUND_S)

    def way_s(self, most_s: float) -> float:
        """Return the time of the legs over all goals, to the circle at the last one; at most `most_s`."""
        places_m = [(self.east_m, self.north_m), *((goal.east_m, goal.north_m) for goal in self.goals)]
        legs_m = [(end[0] - begin[0], end[1] - begin[1]) for begin, end in pairwise(places_m)]
        return min(sum(self.time_s(leg_m, 0.0) for leg_m in legs_m), most_s)

    @property
    def turning_s(self) -> float:
        """Time of a full turn, and on circles that are left after a time."""
        waits_s = sum(goal.for_s for goal in self.goals if math.isfinite(goal.for_s))
        return waits_s + 2.0 * math.pi / self.max_turn_rate_rad_s

    def return_s(self, most_s: float) -> float:
        """Return an upper bound of the time to the last circle, with a turn back; at most `most_s`."""
        return min(self.turning_s + self.way_s(most_s), most_s)

    def reach_m(self, for_s: float) -> float:
        """Return an upper bound of the distance from its place after some time."""
        speed_m_s = max(self.speed_m_s, LOW_SPEED_M_S)
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

    def joined(self, later: FlightPaths) -> FlightPaths:
        """Return the positions up to the last time step, and then those of later flights of the vehicles."""
        arrays = (
            np.vstack((one[:-1], other)) for one, other in zip(self._arrays, later._arrays, strict=True)
        )
        return FlightPaths(self.vehicles, *arrays)

    def beside(self, others: FlightPaths) -> FlightPaths:
        """Return the positions of these vehicles and others."""
        arrays = (np.hstack(both) for both in zip(self._arrays, others._arrays, strict=True))
        return FlightPaths((*self.vehicles, *others.vehicles), *arrays)

    @property
    def _arrays(self) -> tuple[FloatArray, ...]:
        return self.east_m, self.north_m, self.low_m, self.high_m


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
                max(flight.speed_m_s, LOW_SPEED_M_S),
                flight.course_rad,
                flight.climb_m_s,
                flight.turn_rate_rad_s,
                flight.max_turn_rate_rad_s,
                flight.age_s,
                flight.climb_gradient,
                flight.height_error_m,
                *flight.wind_m_s,
                flight.airspeed_m_s,
                flight.delay_s,
            )
            for flight in flights
        ],
        dtype=np.float64,
    ).reshape(n, 15)
    paths = np.empty((4, steps, n))
    _fly(table, last, state, paths, step_s)
    return FlightPaths(tuple(flight.vehicle for flight in flights), *paths)


_over_ground_in_kernel = spliced(over_ground)
_circle_rate_in_kernel = spliced(l1_circle_rate)


@kernel
def _fly(table: FloatArray, last: IntArray, state: FloatArray, paths: FloatArray, step_s: float) -> None:
    """Fill `paths` (4, k, n) with east, north, lower and upper height.

    `table` (n, m, 6): goals with the fields of `Goal`. `last` (n,): number of the last goal. `state` (n, 15).
    """
    for i in range(len(last)):
        east = state[i, 0]
        north = state[i, 1]
        height = state[i, 2]
        speed = state[i, 3]
        course = state[i, 4]
        climb = state[i, 5]
        turn_rate = state[i, 6]
        max_rate = state[i, 7]
        age = state[i, 8]
        wind_east = state[i, 11]
        wind_north = state[i, 12]
        airspeed = state[i, 13]
        delay = state[i, 14]
        is_windy = wind_east != 0.0 or wind_north != 0.0
        ahead = max(speed - wind_east * math.sin(course) - wind_north * math.cos(course), LOW_SPEED_M_S)
        lateral = turn_rate * speed / ahead  # by airspeed
        low = height - state[i, 10]
        high = height + state[i, 10]
        rising = max(climb, state[i, 9] * speed)
        low_rate = climb
        high_rate = climb
        dt = step_s + age  # the first step makes up for the age of the state
        paths[0, 0, i] = east + speed * age * math.sin(course)
        paths[1, 0, i] = north + speed * age * math.cos(course)
        paths[2, 0, i] = low
        paths[3, 0, i] = high
        goal = 0
        in_air = True
        circled_s = 0.0
        closest = np.inf  # to the goal, since it is the goal
        was_ahead = False
        for k in range(1, paths.shape[1]):
            kind = table[i, goal, 0]
            is_late = (k - 0.5) * step_s < delay
            radius = table[i, goal, 3]
            to_height = table[i, goal, 4]
            is_leg = kind in (_WAYPOINT, _LAND)
            is_circle = kind == _CIRCLE
            is_climb = kind == _CLIMB
            circle = max(abs(radius), 1.0)
            ahead_east = table[i, goal, 1] - east
            ahead_north = table[i, goal, 2] - north
            away = math.hypot(ahead_east, ahead_north)
            closest = min(closest, away)
            error = (math.atan2(ahead_east, ahead_north) - course + math.pi) % (2.0 * math.pi) - math.pi
            circles = is_circle and not is_late
            parts = _CIRCLE_STEPS if circles else 1
            part = dt / parts
            side = -1.0 if radius < 0.0 else 1.0
            moved = 0.0
            for _ in range(parts):
                turned = 0.0
                if circles:
                    wanted = side * _circle_rate_in_kernel(
                        side * (east - table[i, goal, 1]),
                        north - table[i, goal, 2],
                        side * course,
                        speed,
                        airspeed,
                        circle,
                        L1_S,
                        _LOOP_S,
                    )
                    wanted = min(max(wanted, -max_rate), max_rate)
                    lateral += (wanted - lateral) * (1.0 - math.exp(-max(part, 0.0) / _ROLL_S))
                    turn_rate = lateral * ahead / speed
                    turned = turn_rate * part
                elif is_leg and not is_late:
                    turned = min(max(error, -max_rate * dt), max_rate * dt)
                elif is_late or not is_climb:
                    turned = turn_rate * dt
                course += 0.5 * turned
                if is_windy:
                    speed, ahead = _over_ground_in_kernel(course, airspeed, wind_east, wind_north)
                    turn_rate = lateral * ahead / speed
                step_m = speed * part if in_air else 0.0
                east += step_m * math.sin(course)
                north += step_m * math.cos(course)
                moved += step_m
                course += 0.5 * turned
            on_circle = is_circle and away <= _ON_CIRCLE * circle
            if is_late:
                low += min(climb * dt, 0.0)
                high += max(climb * dt, 0.0)
            elif is_leg or is_circle:  # heights change at once, or evenly up to the goal
                left = math.hypot(table[i, goal, 1] - east, table[i, goal, 2] - north)
                share = max(1.0 - left / max(closest, 1e-3), 0.0)
                if on_circle:
                    share = min(moved / max(away, 1e-3), 1.0)
                change = CLIMB_M_S * dt
                most = _MAX_CLIMB_M_S * dt
                up = to_height - low
                up_high = to_height - high
                low_by = min(min(max(up, -change), change), min(max(up * share, -most), most))
                high_by = max(min(max(up_high, -change), change), min(max(up_high * share, -most), most))
                if is_circle and climb < -_SINKS_M_S:
                    high_by = max(high_by, climb * dt)
                gain = dt / (dt + _CLIMB_LAG_S)
                low_rate += gain * (low_by / dt - low_rate)
                high_rate += gain * (high_by / dt - high_rate)
                low += min(low_by, low_rate * dt) if low_by > 0.0 else low_by
                high += max(high_by, high_rate * dt) if high_by < 0.0 else high_by
            elif is_climb:
                low += (1.0 - _CLIMB_SPREAD) * rising * dt
                high = min(high + (1.0 + _CLIMB_SPREAD) * rising * dt, max(to_height, height))
            elif kind == _DRIFT or k * step_s <= _LEVEL_S:
                low += min(climb * dt, 0.0)
                high += max(climb * dt, 0.0)
            is_ahead = abs(error) <= _BEHIND_RAD
            is_passed = not is_ahead and was_ahead and away < 2.0 * speed / max_rate
            was_ahead = was_ahead or is_ahead
            circled_s = circled_s + dt if on_circle else 0.0
            if (
                (is_climb and 0.5 * (low + high) >= to_height)
                or (is_leg and (away <= max(radius, 0.0) + moved or is_passed))
                or (is_circle and circled_s >= table[i, goal, 5])
            ):
                in_air = in_air and kind != _LAND
                circled_s = 0.0
                closest = np.inf
                was_ahead = False
                goal = min(goal + 1, last[i])
            paths[0, k, i] = east
            paths[1, k, i] = north
            paths[2, k, i] = low if in_air else np.nan
            paths[3, k, i] = high if in_air else np.nan
            dt = step_s


def warm_up_calls() -> list[Call]:
    """Return one call of the kernel with the types of a prediction."""
    return [(_fly, np.zeros((1, 1, 6)), np.zeros(1, np.int64), np.ones((1, 15)), np.zeros((4, 2, 1)), 1.0)]
