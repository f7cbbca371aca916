"""Forward flight: where many vehicles will be in the next seconds, with their climbs.

Each vehicle flies from goal to goal: it turns towards a waypoint with its planned turn rate and flies on
straight, or follows a vector field round a circle. At distance d from the centre of a circle of radius R the
desired course is the tangent, turned inwards by ``atan((d - R) / (v tau))``. A vehicle without a goal
keeps its turn rate. The steps are a kernel, with their constants (`gcs.core.separation.flight_steps`).

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

from gcs.core.separation.flight_steps import LOW_SPEED_M_S, fill_paths
from gcs.model import FloatArray

STEP_S: Final = 1.0
_LEAST_AIRSPEED: Final = 0.5
_GREATEST_AIRSPEED: Final = 2.0
"""Airspeeds, by the cruising speed, between which an estimate of the wind is plausible."""
_ROUNDING_M: Final = 1e-3
"""More than rounding adds to a simulated way."""


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
        around = max(airspeed - wind_m_s * wind_m_s / airspeed, LOW_SPEED_M_S)
        return leg_time_s(leg_m, airspeed, self.wind_m_s) + circle_m / around

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


def airspeed_m_s(speed_m_s: float, course_rad: float, wind_m_s: tuple[float, float]) -> float:
    """Return the airspeed of a vehicle with a speed and a course over ground."""
    east, north = wind_m_s
    along = east * math.sin(course_rad) + north * math.cos(course_rad)
    squared = speed_m_s * (speed_m_s - 2.0 * along) + east * east + north * north
    return max(math.sqrt(max(squared, 0.0)), LOW_SPEED_M_S)


def plausible_wind_m_s(
    reported_m_s: tuple[float, float] | None, speed_m_s: float, course_rad: float, cruise_m_s: float
) -> tuple[float, float]:
    """Return the wind that a vehicle reports; none where its airspeed would be no such aeroplane's.

    Parameters
    ----------
    speed_m_s, course_rad : float
        Speed over ground and course.
    cruise_m_s : float
        Airspeed at which it cruises.
    """
    wind_m_s = reported_m_s or (0.0, 0.0)
    share = airspeed_m_s(speed_m_s, course_rad, wind_m_s) / cruise_m_s
    return wind_m_s if _LEAST_AIRSPEED < share < _GREATEST_AIRSPEED else (0.0, 0.0)


def leg_time_s(leg_m: tuple[float, float], airspeed: float, wind_m_s: tuple[float, float]) -> float:
    """Return the time of a straight leg, east and north."""
    along, _ = _over_ground(math.atan2(*leg_m), airspeed, *wind_m_s)
    return math.hypot(*leg_m) / float(along)


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
            )
            for flight in flights
        ],
        dtype=np.float64,
    ).reshape(n, 14)
    paths = np.empty((4, steps, n))
    fill_paths(table, last, state, paths, float(step_s))
    return FlightPaths(tuple(flight.vehicle for flight in flights), *paths)


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
    return np.maximum(along + ahead, LOW_SPEED_M_S), ahead
