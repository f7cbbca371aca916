"""How a vehicle takes up a route by itself, flown ahead in thought.

Where a planner cannot be sure that the plain turn on to a route is clear on any radius and to either side, it
spells the turn out as waypoints: a detour of up to a circle (`gcs.planning.path.turns`). But which turn the
vehicle's autopilot will fly is known well enough: from where it is, from its course and from how it turns
already (`gcs.planning.vehicle_model`). Where that turn is clear, and shorter, nothing need be spelt out.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gcs.geo import bearing_rad, wrap_pi
from gcs.model import FloatArray
from gcs.planning.map.grid import Grid
from gcs.planning.map.line_of_sight import to_cells
from gcs.planning.options import AgentState
from gcs.planning.path.initial_turn import TIGHT, start_room
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.vehicle_model import Motion, RemainingMission, simulate

_SAME_RAD = 1e-3
SHARE = 0.25
"""How much of the clearance must be left on a way that was not planned."""


def has_explicit_turn(start: AgentState, points_m: FloatArray) -> bool:
    """Whether a route begins with a turn that is spelt out: its first point lies on the agent's course."""
    if start.course_rad is None:
        return False
    bearing = bearing_rad(start.east_m, start.north_m, float(points_m[0, 0]), float(points_m[0, 1]))
    return abs(wrap_pi(bearing - start.course_rad)) < _SAME_RAD


def simulate_until_blocked(
    grid: Grid, motion: Motion, for_s: float, lag_s: float, clearance_m: float
) -> tuple[bool, Motion]:
    """Whether a vehicle comes near to nothing for a while, and its last moment before it does.

    That is nearer than a share of the clearance, or than it is already.
    """
    reach = clearance_m / grid.spacing_m
    room_m = start_room(grid.blocked, reach, *to_cells(grid, motion.place_m)) * grid.spacing_m
    flight = simulate(grid, motion, for_s, lag_s, min(SHARE * clearance_m, room_m))
    return flight.is_clear, flight.motion_at(-1)


def turn_around_s(motion: Motion, radius_m: float, lag_s: float) -> float:
    """How long a vehicle needs to turn round."""
    return math.pi * radius_m / max(motion.speed_m_s, 1.0) + lag_s


def capture_length_m(
    grid: Grid,
    motion: Motion,
    points_m: FloatArray,
    corners: TurnAnticipation,
    look_s: float,
    lag_s: float,
    clearance_m: float,
) -> float:
    """Metres to the end of a route for a vehicle that turns on to it by itself.

    Infinite where it would come too near to obstacles, if it turns as quickly as expected or more so.

    Parameters
    ----------
    motion : Motion
        When it takes the route up.
    points_m : ndarray, shape (k, 2)
        Of the route, without a turn that is spelt out.
    corners : Corners
        How early the vehicle will be told to turn.
    look_s, lag_s : float
        How long it needs to turn round, and until it takes a turn up.
    clearance_m : float
        That the route keeps.
    """
    points = [motion.place_m, *map(tuple, points_m.tolist())]
    radii_m = corners.accept_radii_m(np.array(points))
    starting = replace(motion, age_s=0.0, ahead=RemainingMission(tuple(points[1:]), tuple(radii_m.tolist())))
    speed_m_s = max(motion.speed_m_s, 1.0)
    look_s = min(look_s, _length_m(points) / speed_m_s)
    for lag in (TIGHT * lag_s, lag_s):
        is_clear, end = simulate_until_blocked(grid, starting, look_s, lag, clearance_m)
        if not is_clear:
            return math.inf
    return look_s * speed_m_s + _length_m([end.place_m, *end.ahead.points_m])


def _length_m(points: list[tuple[float, float]]) -> float:
    return math.fsum(math.dist(a, b) for a, b in pairwise(points))
