"""Routes in wind: planned with more clearance or wider turns where their flights come too near to obstacles.

A turn radius that allows for the wind is not enough. A vehicle that is blown across a corner leaves the next
leg, or cuts the corner, by an amount that depends on the turns before. So the flights along a route are
simulated in wind from all sides (`gcs.planning.flight_variants`). Without wind a route is not simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from gcs.model import FloatArray
from gcs.planning.flight_variants import wind_margin_m, windy_flights
from gcs.planning.forward_simulation import Motion, RemainingMission
from gcs.planning.manoeuvres.loiter import path_length_m
from gcs.planning.map.grid import Grid
from gcs.planning.map.line_of_sight import path_clearance, to_cells
from gcs.planning.path.initial_turn import start_clearance
from gcs.planning.planner_inputs import AgentState, PlanOptions
from gcs.planning.route_joining import MIN_CLEARANCE_SHARE

WIND_SHARES = ((1.5, 1.0), (1.0, 1.3), (1.5, 1.3), (2.0, 1.0))
"""Clearances and turn radii of other routes, as shares of those asked for."""
_ENOUGH_SHARE = 0.5
"""Share of the clearance that flights in wind keep of a route that needs no other, beside the wind margin."""
COLLISION_M = -1.0


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


def clearance_in_wind_m(
    grid: Grid, start: AgentState, points_m: FloatArray, options: PlanOptions, floor_m: float
) -> float:
    """Return the least clearance of flights along a route in wind; `COLLISION_M` if below `floor_m`.

    At most what is sufficient. A vehicle that begins nearer to an obstacle keeps the distance that it has.
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
    frame = np.array([*grid.origin_m, grid.spacing_m])
    spacing_m = grid.spacing_m
    begins = start_clearance(grid.blocked, 2.0 * enough_m / spacing_m, *to_cells(grid, motion.place_m))
    least_m = enough_m
    for_s = path_length_m(path_m) / (speed_m_s - min(turns.wind_m_s, 0.7 * speed_m_s))
    for flight in windy_flights(
        grid, motion, for_s, turns, options.turn_lag_s, min(floor_m, begins * spacing_m)
    ):
        flown = flight.states[flight.states[:, 4] < len(points)]
        is_blocked = not flight.is_clear and len(flown) == len(flight.states)
        if is_blocked:
            return COLLISION_M
        if len(flown) > 1:
            least_m = spacing_m * path_clearance(grid.blocked, frame, flown, least_m / spacing_m)
    return least_m
