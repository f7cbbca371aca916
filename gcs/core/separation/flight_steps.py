"""Kernel of forward flight: the steps of vehicles from goal to goal (`gcs.core.separation.forward_flight`).

Vehicles are independent of each other. `tests/helpers/plain_flight_steps.py` is the plain form.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gcs.jit import Call, kernel
from gcs.model import FloatArray, IntArray

CONVERGENCE_S: Final = 1.5
"""Time constant tau of the approach to a circle: that of L1 guidance with NAVL1_PERIOD 15 to 17 s."""
CLIMB_M_S: Final = 5.0
"""Vertical speed of a change of height."""
MAX_CLIMB_M_S: Final = 7.5
"""Greatest vertical speed of a change of height."""
LOW_SPEED_M_S: Final = 1.0
CLIMB_SPREAD: Final = 0.4
"""Relative uncertainty of the vertical speed after a take-off."""
BEHIND_RAD: Final = 1.8
"""A near waypoint at this angle from the course has been passed, if it was ahead before."""
AT_CENTRE_M: Final = 1.0
"""Distance from a centre within which a vehicle counts as flying straight away from it (AP_L1_Control)."""
ON_CIRCLE: Final = 1.3
"""Distance from the centre of a circle, in radii, within which a vehicle flies on it."""
LEVEL_S: Final = 2.0
"""Time in which a vehicle with another height to keep stops its climb."""
WAYPOINT: Final = 1.0
CIRCLE: Final = 2.0
CLIMB: Final = 3.0
LAND: Final = 4.0
DRIFT: Final = 5.0
"""Kinds of goals (`GoalKind`) as numbers of the table; 0 keeps turn rate and height."""


@kernel
def fill_paths(
    table: FloatArray, last: IntArray, state: FloatArray, paths: FloatArray, step_s: float
) -> None:
    """Fill the paths of vehicles.

    Parameters
    ----------
    table : FloatArray
        (n, m, 6): kind, east, north, radius, height and time of each goal (`Goal`).
    last : IntArray
        (n,): index of the last goal.
    state : FloatArray
        (n, 14): the fields of `Flight` from `east_m` to `wind_m_s` without goals, and the airspeed.
    paths : FloatArray
        (4, k, n), filled with east, north, lower and upper height.
    step_s : float
        Time step.
    """
    is_windy = False
    for n in range(len(last)):
        is_windy = is_windy or state[n, 11] != 0.0 or state[n, 12] != 0.0
    for n in range(len(last)):
        east = state[n, 0]
        north = state[n, 1]
        height = state[n, 2]
        speed = state[n, 3]
        course = state[n, 4]
        climb = state[n, 5]
        turn_rate = state[n, 6]
        max_rate = state[n, 7]
        age = state[n, 8]
        wind_east = state[n, 11]
        wind_north = state[n, 12]
        airspeed = state[n, 13]
        along = speed - wind_east * math.sin(course) - wind_north * math.cos(course)
        lateral = turn_rate * speed / max(along, LOW_SPEED_M_S)  # by airspeed
        low = height - state[n, 10]
        high = height + state[n, 10]
        rising = max(climb, state[n, 9] * speed)
        dt = step_s + age  # the first step makes up for the age of the state
        paths[0, 0, n] = east + speed * age * math.sin(course)
        paths[1, 0, n] = north + speed * age * math.cos(course)
        paths[2, 0, n] = low
        paths[3, 0, n] = high
        goal = 0
        closest = np.inf  # to the goal, since it is the goal
        circled_s = 0.0
        was_ahead = False
        is_in_air = True
        for k in range(1, paths.shape[1]):
            kind = table[n, goal, 0]
            to_east = table[n, goal, 1]
            to_north = table[n, goal, 2]
            radius = table[n, goal, 3]
            to_height = table[n, goal, 4]
            for_s = table[n, goal, 5]
            is_leg = kind in (WAYPOINT, LAND)
            is_circle = kind == CIRCLE
            is_climb = kind == CLIMB
            away = math.hypot(to_east - east, to_north - north)
            closest = min(closest, away)
            bearing = math.atan2(to_east - east, to_north - north) if away > AT_CENTRE_M else course + math.pi
            circle = max(abs(radius), 1.0)
            if is_circle:  # the tangent, half a step ahead
                side = -1.0 if radius < 0.0 else 1.0
                inwards = math.atan((away - circle) / (speed * CONVERGENCE_S))
                lead = 0.5 * speed * dt / max(away, 0.5 * circle)
                bearing += math.pi + side * (0.5 * math.pi + inwards + lead)
            error = (bearing - course + math.pi) % (2.0 * math.pi) - math.pi
            turned = turn_rate * dt
            if is_leg or is_circle:
                turned = min(max(error, -max_rate * dt), max_rate * dt)
            elif is_climb:
                turned = 0.0
            course += 0.5 * turned
            if is_windy:
                sine = math.sin(course)
                cosine = math.cos(course)
                across = wind_east * cosine - wind_north * sine
                ahead = math.sqrt(max(airspeed * airspeed - across * across, 0.0))
                speed = max(wind_east * sine + wind_north * cosine + ahead, LOW_SPEED_M_S)
                turn_rate = lateral * ahead / speed
            moved = speed * dt if is_in_air else 0.0
            east += moved * math.sin(course)
            north += moved * math.cos(course)
            course += 0.5 * turned
            is_on_circle = is_circle and away <= ON_CIRCLE * circle
            if is_leg or is_circle:  # heights change at once, or evenly up to the goal
                left = math.hypot(to_east - east, to_north - north)
                share = max(1.0 - left / max(closest, 1e-3), 0.0)
                if is_on_circle:
                    share = min(moved / max(away, 1e-3), 1.0)
                change = CLIMB_M_S * dt
                most = MAX_CLIMB_M_S * dt
                up = to_height - low
                low += min(min(max(up, -change), change), min(max(up * share, -most), most))
                up = to_height - high
                high += max(min(max(up, -change), change), min(max(up * share, -most), most))
            elif is_climb:
                low += (1.0 - CLIMB_SPREAD) * rising * dt
                high = min(high + (1.0 + CLIMB_SPREAD) * rising * dt, max(to_height, height))
            elif k * step_s <= LEVEL_S or kind == DRIFT:
                low += min(climb * dt, 0.0)
                high += max(climb * dt, 0.0)
            is_behind = abs(error) > BEHIND_RAD
            is_passed = is_behind and was_ahead and away < 2.0 * speed / max_rate
            was_ahead = was_ahead or not is_behind
            circled_s = circled_s + dt if is_on_circle else 0.0
            is_done = is_climb and 0.5 * (low + high) >= to_height
            is_done = is_done or (is_leg and (away <= max(radius, 0.0) + moved or is_passed))
            is_done = is_done or (is_circle and circled_s >= for_s)
            if is_done:
                is_in_air = is_in_air and kind != LAND
                circled_s = 0.0
                closest = np.inf
                was_ahead = False
                goal = min(goal + 1, last[n])
            paths[0, k, n] = east
            paths[1, k, n] = north
            paths[2, k, n] = low if is_in_air else np.nan
            paths[3, k, n] = high if is_in_air else np.nan
            dt = step_s


def warm_up_calls() -> list[Call]:
    """Return a call of the kernel, as it is made in flight."""
    goals = np.zeros((1, 1, 6))
    return [(fill_paths, goals, np.zeros(1, np.int64), np.ones((1, 14)), np.empty((4, 2, 1)), 1.0)]
