"""Route joining: how a vehicle turns on to a new route without explicit turn waypoints.

Where a planner cannot prove the direct turn clear for every radius and side, it adds explicit turn waypoints
(`gcs.planning.path.turns`), a detour of up to a circle. The forward simulation of the vehicle
(`gcs.planning.forward_simulation`) knows position, course and turn rate. Where the simulated turn is clear
and shorter, no explicit turn is needed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gcs.geo import bearing_rad, wrap_pi
from gcs.model import FloatArray
from gcs.planning.forward_simulation import Motion, RemainingMission, simulate
from gcs.planning.map.grid import Grid
from gcs.planning.map.line_of_sight import to_cells
from gcs.planning.path.initial_turn import MIN_RADIUS_SHARE, start_clearance
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.planner_inputs import AgentState

_SAME_COURSE_RAD = 1e-3
MIN_CLEARANCE_SHARE = 0.25
"""Share of the clearance that an unplanned path must keep."""


def has_explicit_turn(start: AgentState, points_m: FloatArray) -> bool:
    """Return True if a route begins with an explicit turn: its first waypoint lies on the agent's course."""
    if start.course_rad is None:
        return False
    bearing = bearing_rad(start.east_m, start.north_m, float(points_m[0, 0]), float(points_m[0, 1]))
    return abs(wrap_pi(bearing - start.course_rad)) < _SAME_COURSE_RAD


def total_turn_rad(start: AgentState, points_m: FloatArray, within_m: float) -> float:
    """Return the sum of a route's turns within a distance of its start, that on to it included."""
    places_m = np.vstack(((start.east_m, start.north_m), points_m))
    legs = np.diff(places_m, axis=0)
    courses = np.arctan2(legs[:, 0], legs[:, 1])
    turns = np.diff(courses, prepend=courses[0] if start.course_rad is None else start.course_rad)
    is_near = np.hypot(*(places_m[:-1] - places_m[0]).T) <= within_m
    return math.fsum(abs(wrap_pi(turn)) for turn in turns[is_near].tolist())


def simulate_until_blocked(
    grid: Grid,
    motion: Motion,
    duration_s: float,
    lag_s: float,
    clearance_m: float,
    min_radius_m: float = 0.0,
) -> tuple[bool, Motion]:
    """Simulate a vehicle ahead until it comes too near to an obstacle.

    Too near is less than `MIN_CLEARANCE_SHARE` of the clearance, or than the clearance at its position if
    that is less. Returns True if the vehicle stays clear, and its last simulated motion.
    """
    clearance = clearance_m / grid.spacing_m
    margin_m = start_clearance(grid.blocked, clearance, *to_cells(grid, motion.place_m)) * grid.spacing_m
    clearance_m = min(MIN_CLEARANCE_SHARE * clearance_m, margin_m)
    flight = simulate(grid, motion, duration_s, lag_s, clearance_m, min_radius_m)
    return flight.is_clear, flight.motion_at(-1)


def turn_around_s(motion: Motion, radius_m: float, lag_s: float) -> float:
    """Return the time for a turn of 180 degrees."""
    return math.pi * radius_m / max(motion.speed_m_s, 1.0) + lag_s


def capture_length_m(
    grid: Grid,
    motion: Motion,
    points_m: FloatArray,
    corners: TurnAnticipation,
    horizon_s: float,
    lag_s: float,
    clearance_m: float,
) -> float:
    """Return the distance to the end of a route for a vehicle that turns on to it without explicit turns.

    Infinite if the simulated turn comes too near to obstacles, with the expected turn lag or a shorter one,
    or if the vehicle turns no tighter than it is planned for.

    Parameters
    ----------
    motion : Motion
        Where it turns on to the route.
    points_m : ndarray, shape (k, 2)
        Waypoints, without an explicit turn.
    turns : TurnAnticipation
    horizon_s, lag_s : float
        Simulated duration, and delay until a commanded turn rate is reached.
    clearance_m : float
        Clearance of the route.
    """
    points = [motion.place_m, *map(tuple, points_m.tolist())]
    radii_m = corners.accept_radii_m(np.array(points))
    starting = replace(motion, age_s=0.0, ahead=RemainingMission(tuple(points[1:]), tuple(radii_m.tolist())))
    speed_m_s = max(motion.speed_m_s, 1.0)
    horizon_s = min(horizon_s, _length_m(points) / speed_m_s)
    for lag, min_radius_m in ((MIN_RADIUS_SHARE * lag_s, 0.0), (lag_s, corners.radius_m), (lag_s, 0.0)):
        is_clear, end = simulate_until_blocked(grid, starting, horizon_s, lag, clearance_m, min_radius_m)
        if not is_clear:
            return math.inf
    return horizon_s * speed_m_s + _length_m([end.place_m, *end.ahead.points_m])


def _length_m(points: list[tuple[float, float]]) -> float:
    return math.fsum(math.dist(a, b) for a, b in pairwise(points))
