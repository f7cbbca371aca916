"""Forward simulation of many vehicles at once.

Each vehicle flies from goal to goal: it turns towards a waypoint with its planned turn rate and flies on
straight, or follows a vector field round a circle. At distance d from the centre of a circle of radius R the
desired course is the tangent, turned inwards by ``atan((d - R) / (v tau))`` (`CONVERGENCE_S`). A vehicle
without a goal keeps its turn rate.

A height is a band. Autopilots change heights at once or evenly along a leg, and the band has both.

Shapes: n vehicles, m goals of each, k time steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from gcs.model import FloatArray, IntArray

STEP_S: Final = 0.5
CONVERGENCE_S: Final = 2.0
"""Time constant tau of the approach to a circle."""
CLIMB_M_S: Final = 5.0
"""Vertical speed of a change of height."""
_LOW_SPEED_M_S: Final = 1.0
_CLIMB_SPREAD: Final = 0.35
"""Relative uncertainty of the vertical speed after a take-off."""
_BEHIND_RAD: Final = 1.8
"""A near waypoint at this angle from the course has been passed."""
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


def simulate_flights(flights: Sequence[Flight], for_s: float, step_s: float = STEP_S) -> FlightPaths:
    """Return the positions of vehicles for some time ahead; now is the first."""
    n, steps = len(flights), round(for_s / step_s) + 1
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
            )
            for flight in flights
        ],
        dtype=np.float64,
    ).reshape(n, 10)
    paths = np.empty((4, steps, n))
    _fly(table, last, state, paths, step_s)
    return FlightPaths(tuple(flight.vehicle for flight in flights), *paths)


def _fly(table: FloatArray, last: IntArray, state: FloatArray, paths: FloatArray, step_s: float) -> None:
    """Fill (4, k, n) with east, north, lower and upper height."""
    rows, goal = np.arange(len(last)), np.zeros_like(last)
    east, north, height, speed, course, climb, turn_rate, max_rate, age, gradient = state.T.copy()
    low, high, in_air = height.copy(), height.copy(), np.ones(len(last), dtype=bool)
    circled_s = np.zeros(len(last))
    dt = step_s + age  # the first step makes up for the age of the state
    paths[:, 0] = east + speed * age * np.sin(course), north + speed * age * np.cos(course), low, high
    for k in range(1, paths.shape[1]):
        kind, to_east, to_north, radius, to_height, for_s = table[rows, goal].T
        is_leg = (kind == GoalKind.WAYPOINT) | (kind == GoalKind.LAND)
        is_circle, is_climb = kind == GoalKind.CIRCLE, kind == GoalKind.CLIMB
        keeps = (kind == GoalKind.KEEP) | (kind == GoalKind.DRIFT)
        ahead_east, ahead_north = to_east - east, to_north - north
        away = np.hypot(ahead_east, ahead_north)
        bearing = np.arctan2(ahead_east, ahead_north)
        circle, side = np.maximum(np.abs(radius), 1.0), np.where(radius < 0.0, -1.0, 1.0)
        inwards = np.arctan((away - circle) / (speed * CONVERGENCE_S))
        # On the circle, the tangent half a step ahead.
        lead = 0.5 * speed * dt / np.maximum(away, 0.5 * circle)
        tangent = bearing + np.pi + side * (0.5 * np.pi + inwards + lead)
        error = (np.where(is_circle, tangent, bearing) - course + np.pi) % (2.0 * np.pi) - np.pi
        turned = np.clip(error, -max_rate * dt, max_rate * dt)
        turned = np.where(keeps, turn_rate * dt, np.where(is_climb, 0.0, turned))
        middle = course + 0.5 * turned
        moved = speed * dt * in_air
        east += moved * np.sin(middle)
        north += moved * np.cos(middle)
        course += turned
        change = CLIMB_M_S * dt
        share = np.minimum(moved / np.maximum(away, 1e-3), 1.0)
        by_leg = is_leg | is_circle
        one = np.clip(to_height - low, -change, change)
        other = np.clip(to_height - high, -change, change)
        even_low, even_high = (to_height - low) * share, (to_height - high) * share
        # Below its goal the slow change is the lower bound, above it the upper one.
        low_step = np.where(to_height >= low, np.minimum(even_low, one), np.minimum(one, even_low))
        high_step = np.where(to_height >= high, np.maximum(other, even_high), np.maximum(even_high, other))
        rising = np.maximum(climb, gradient * speed) * dt
        drift = np.where(kind == GoalKind.DRIFT, climb, climb * (k * step_s <= _LEVEL_S)) * dt
        low += np.select([is_climb, by_leg], [(1.0 - _CLIMB_SPREAD) * rising, low_step], np.minimum(drift, 0.0))
        high += np.select(
            [is_climb, by_leg], [(1.0 + _CLIMB_SPREAD) * rising, high_step], np.maximum(drift, 0.0)
        )
        has_climbed = is_climb & (0.5 * (low + high) >= to_height)
        high = np.where(is_climb, np.minimum(high, np.maximum(to_height, height)), high)
        on_circle = is_circle & (away <= 1.3 * circle)
        circled_s += on_circle * dt
        is_behind = (np.abs(error) > _BEHIND_RAD) & (away < 2.0 * speed / max_rate)
        has_passed = is_leg & ((away <= np.maximum(radius, 0.0) + moved) | is_behind)
        is_done = has_passed | has_climbed | (is_circle & (circled_s >= for_s))
        in_air &= ~(is_done & (kind == GoalKind.LAND))
        circled_s[is_done] = 0.0
        goal = np.where(is_done, np.minimum(goal + 1, last), goal)
        paths[:, k] = east, north, np.where(in_air, low, np.nan), np.where(in_air, high, np.nan)
        dt = np.full_like(dt, step_s)
