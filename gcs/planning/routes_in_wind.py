"""Routes in wind: what clearance is enough in it, and wider routes where a flight comes too near obstacles.

A turn radius that allows for the wind is not enough. A vehicle that is blown across a corner leaves the next
leg, or cuts the corner, by an amount that depends on the turns before. So the flights along a route are
simulated in wind from all sides (`gcs.planning.flight_variants`). Without wind a route is not simulated.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gcs.model import FloatArray
from gcs.planning.flight_variants import wind_margin_m, windy_flights
from gcs.planning.forward_simulation import Motion, RemainingMission
from gcs.planning.manoeuvres.loiter import path_length_m
from gcs.planning.map.grid import Grid
from gcs.planning.map.line_of_sight import clearances_along
from gcs.planning.planner_inputs import AgentState, PlanOptions

WIND_SHARES = ((1.25, 1.0), (1.0, 0.7), (1.0, 1.3), (1.25, 0.7), (1.5, 1.0))
"""Clearances and turn radii of other routes, as shares of those asked for."""
_ENOUGH_SHARE = 0.5
"""Share of the clearance that flights in wind keep of a route that needs no other, beside the wind margin."""
COLLISION_M = -1.0
_DETOUR_RADII = 10.0
"""Detour that a clearance is worth where there is none, in turn radii."""
_MIN_DETOUR_RADII = 0.5
"""Detour that is not looked for: about four fifths of what is sufficient are kept."""


def widened(options: PlanOptions, clearance_share: float, radius_share: float) -> PlanOptions:
    """Return options with another clearance and turn radius."""
    return replace(
        options,
        clearance_m=clearance_share * options.clearance_m,
        turn_radius_m=radius_share * options.turn_radius_m,
    )


def enough_clearance_m(options: PlanOptions) -> float:
    """Return the clearance of flights in wind that is sufficient."""
    margin_m = 0.0 if options.turns is None else wind_margin_m(options.turns)
    return min(options.clearance_m, _ENOUGH_SHARE * options.clearance_m + margin_m)


def detour_worth_m(clearance_m: float, options: PlanOptions) -> float:
    """Return how much longer another route may be that keeps what is sufficient."""
    shortfall = 1.0 - clearance_m / enough_clearance_m(options)
    worth_m = _DETOUR_RADII * options.turn_radius_m * shortfall**2
    return worth_m if clearance_m >= 0.0 else 3.0 * worth_m


def keeps_enough(clearance_m: float, options: PlanOptions) -> bool:
    """Return True if no other route is looked for."""
    return detour_worth_m(clearance_m, options) < _MIN_DETOUR_RADII * options.turn_radius_m


def needed_clearance_m(detour_m: float, options: PlanOptions) -> float:
    """Return the clearance from which on a missing one is worth no more than a detour."""
    share = math.sqrt(max(detour_m, 0.0) / (_DETOUR_RADII * options.turn_radius_m))
    return enough_clearance_m(options) * (1.0 - min(share, 1.0))


def clearance_in_wind_m(
    grid: Grid, start: AgentState, points_m: FloatArray, options: PlanOptions, give_up_m: float = 0.0
) -> float:
    """Return the least clearance of flights along a route in wind; `COLLISION_M` if one hits an obstacle.

    At most what is sufficient. Below `give_up_m` no other flights are simulated.
    """
    turns = options.turns
    enough_m = enough_clearance_m(options)
    if turns is None:
        return enough_m
    path_m = np.vstack(((start.east_m, start.north_m), points_m))
    begin = Motion(start.east_m, start.north_m, 0.0, start.course_rad or 0.0)
    if start.motion is not None:
        begin = start.motion
    elif start.course_rad is None and len(path_m) > 1:
        begin = replace(begin, course_rad=float(np.arctan2(*(path_m[1] - path_m[0]))))
    points = tuple((east_m, north_m) for east_m, north_m in points_m.tolist())
    speed_m_s = max(start.speed_m_s, 1.0)
    ahead = RemainingMission(points, tuple(turns.accept_radii_m(path_m).tolist()))
    motion = replace(begin, speed_m_s=speed_m_s, age_s=0.0, ahead=ahead)
    least_m = enough_m
    for_s = path_length_m(path_m) / (speed_m_s - min(turns.wind_m_s, 0.7 * speed_m_s))
    for flight in windy_flights(grid, motion, for_s, turns, options.turn_lag_s, 0.0):
        flown = flight.states[flight.states[:, 4] < len(points)]
        if not flight.is_clear and len(flown) == len(flight.states):
            return COLLISION_M
        least_m = _least_m(grid, flown, least_m)
        if least_m < give_up_m:
            break
    return least_m


def _least_m(grid: Grid, flown: FloatArray, most_m: float) -> float:
    """Return the clearance of a flight, at most `most_m`.

    Where a vehicle begins nearer to an obstacle, the share of that distance counts until it is clear of it.
    """
    frame = np.array([*grid.origin_m, grid.spacing_m])
    gaps_m = grid.spacing_m * clearances_along(grid.blocked, frame, flown, most_m / grid.spacing_m)
    away = np.flatnonzero(gaps_m >= most_m)
    first = int(away[0]) if len(away) else len(gaps_m)
    begins_m = max(float(gaps_m[0]), 1.0) if first else 1.0
    shares = gaps_m[:first] / begins_m
    return float(min(most_m, (most_m * shares).min(initial=most_m), gaps_m[first:].min(initial=most_m)))
