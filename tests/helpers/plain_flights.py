"""Plain form of the kernel of `gcs.core.separation.forward_flight`: all vehicles at once, as arrays."""

from __future__ import annotations

from functools import partial

import numpy as np

from gcs.core.separation import forward_flight as f
from gcs.model import FloatArray, IntArray


def fly(table: FloatArray, last: IntArray, state: FloatArray, paths: FloatArray, step_s: float) -> None:
    """Fill (4, k, n) with east, north, lower and upper height: arguments of `forward_flight._fly`."""
    rows = np.arange(len(last))
    goal = np.zeros_like(last)
    columns = state.T.copy()
    east, north, height, speed, course, climb, turn_rate, max_rate, age, gradient, error_m = columns[:11]
    wind_east, wind_north, airspeed, delay = columns[11:]
    is_windy = bool(wind_east.any() or wind_north.any())
    ahead = np.maximum(speed - wind_east * np.sin(course) - wind_north * np.cos(course), f.LOW_SPEED_M_S)
    lateral = turn_rate * speed / ahead  # by airspeed
    low = height - error_m
    high = height + error_m
    in_air = np.ones(len(last), dtype=bool)
    circled_s = np.zeros(len(last))
    rising = np.maximum(climb, gradient * speed)
    low_rate = high_rate = climb
    dt = step_s + age  # the first step makes up for the age of the state
    paths[:, 0] = east + speed * age * np.sin(course), north + speed * age * np.cos(course), low, high
    closest = np.full(len(last), np.inf)  # to the goal, since it is the goal
    was_ahead = np.zeros(len(last), dtype=bool)
    is_new = True
    is_any_done = False
    for k in range(1, paths.shape[1]):
        if is_new or is_any_done:
            kind, to_east, to_north, radius, to_height, for_s = table[rows, goal].T
            is_leg = (kind == f._WAYPOINT) | (kind == f._LAND)
            is_circle = kind == f._CIRCLE
            is_climb = kind == f._CLIMB
            keeps = (kind == f._KEEP) | (kind == f._DRIFT)
            circle = np.maximum(np.abs(radius), 1.0)
            side = np.where(radius < 0.0, -1.0, 1.0)
            accept = np.maximum(radius, 0.0)
            is_new = False
        ahead_east = to_east - east
        ahead_north = to_north - north
        away = np.hypot(ahead_east, ahead_north)
        closest = np.minimum(closest, away)
        error = (np.arctan2(ahead_east, ahead_north) - course + np.pi) % (2.0 * np.pi) - np.pi
        by_goal = np.minimum(np.maximum(error, -max_rate * dt), max_rate * dt)
        is_late = (k - 0.5) * step_s < delay
        circles = is_circle & ~is_late
        straight = np.where(keeps | is_late, turn_rate * dt, by_goal * ~is_climb)
        moved = np.zeros(len(last))
        for number in range(f._CIRCLE_STEPS):  # all others fly the first as a whole step, and then wait
            part = np.where(circles, dt / f._CIRCLE_STEPS, dt if number == 0 else 0.0)
            wanted = side * _circle_rate(
                side * (east - to_east), north - to_north, side * course, speed, airspeed, circle
            )
            wanted = np.minimum(np.maximum(wanted, -max_rate), max_rate)
            follows = circles * (1.0 - np.exp(-np.maximum(part, 0.0) / f._ROLL_S))
            lateral = lateral + follows * (wanted - lateral)
            turn_rate = np.where(circles, lateral * ahead / speed, turn_rate)
            turned = np.where(circles, turn_rate * part, straight if number == 0 else 0.0)
            course += 0.5 * turned
            if is_windy:
                over, along = _over_ground(course, airspeed, wind_east, wind_north)
                flies = circles | (number == 0)
                speed = np.where(flies, over, speed)
                ahead = np.where(flies, along, ahead)
                turn_rate = lateral * ahead / speed
            step_m = speed * part * in_air
            east += step_m * np.sin(course)
            north += step_m * np.cos(course)
            moved += step_m
            course += 0.5 * turned
        # Heights change at once, or evenly up to the goal.
        change = f.CLIMB_M_S * dt
        most = f._MAX_CLIMB_M_S * dt
        on_circle = is_circle & (away <= f._ON_CIRCLE * circle)
        left = np.hypot(to_east - east, to_north - north)
        share = np.maximum(1.0 - left / np.maximum(closest, 1e-3), 0.0)
        share = np.where(on_circle, np.minimum(moved / np.maximum(away, 1e-3), 1.0), share)
        up = to_height - low
        up_high = to_height - high
        at_once = np.minimum(np.maximum(up, -change), change)
        at_once_high = np.minimum(np.maximum(up_high, -change), change)
        evenly = np.minimum(np.maximum(up * share, -most), most)
        evenly_high = np.minimum(np.maximum(up_high * share, -most), most)
        drift = climb * dt * ((k * step_s <= f._LEVEL_S) | (kind == f._DRIFT) | is_late)
        rises = is_climb & ~is_late
        to_goal = (is_leg | is_circle) & ~is_late
        low_by = np.minimum(at_once, evenly)
        high_by = np.maximum(at_once_high, evenly_high)
        goes_on = is_circle & (climb < -f._SINKS_M_S)
        high_by = np.where(goes_on, np.maximum(high_by, climb * dt), high_by)
        gain = to_goal * dt / (dt + f._CLIMB_LAG_S)
        low_rate = low_rate + gain * (low_by / dt - low_rate)
        high_rate = high_rate + gain * (high_by / dt - high_rate)
        low_by = np.where(low_by > 0.0, np.minimum(low_by, low_rate * dt), low_by)
        high_by = np.where(high_by < 0.0, np.maximum(high_by, high_rate * dt), high_by)
        low += np.where(to_goal, low_by, np.minimum(drift, 0.0) * ~rises)
        high += np.where(to_goal, high_by, np.maximum(drift, 0.0) * ~rises)
        low += rises * (1.0 - f._CLIMB_SPREAD) * rising * dt
        high += rises * (1.0 + f._CLIMB_SPREAD) * rising * dt
        high = np.where(rises, np.minimum(high, np.maximum(to_height, height)), high)
        is_done = is_climb & (0.5 * (low + high) >= to_height)
        is_behind = np.abs(error) > f._BEHIND_RAD
        is_passed = is_behind & was_ahead & (away < 2.0 * speed / max_rate)
        was_ahead |= ~is_behind
        is_done |= is_leg & ((away <= accept + moved) | is_passed)
        circled_s = (circled_s + dt) * on_circle
        is_done |= is_circle & (circled_s >= for_s)
        is_any_done = bool(is_done.any())
        if is_any_done:
            in_air &= ~(is_done & (kind == f._LAND))
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


_circle_rate = np.vectorize(partial(f.l1_circle_rate, l1_s=f.L1_S, loop_s=f._LOOP_S), otypes=[float])


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
    return np.maximum(along + ahead, f.LOW_SPEED_M_S), ahead
