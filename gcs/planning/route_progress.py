"""Progress of a vehicle along a route: which points it has passed.

A vehicle flies on while a new mission is uploaded. It joins the route at its current position, not at the
first waypoint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gcs.model import FloatArray

CORRIDOR_M = 40.0
"""A vehicle within this distance of a leg follows it."""
_SLOW_M_S = 1.0


def next_point(
    points_m: FloatArray, position_m: tuple[float, float], corridor_m: float, max_along_m: float = math.inf
) -> int:
    """Return the index of the first waypoint that a vehicle has not passed, by its position alone.

    A waypoint is passed if the vehicle is alongside the leg that begins there, within `corridor_m` of it.
    Behind the last leg, or beside a route, a position does not tell what was passed: then the first one is
    returned. Where a vehicle counts the items of a route, their number is better.

    Parameters
    ----------
    points_m : (k, 2) array
        East and north of the waypoints in order of flight; k >= 1.
    position_m : (float, float)
        East and north of the vehicle.
    corridor_m : float
        Greatest distance from the leg.
    max_along_m : float
        Greatest progress along the route that is possible by now. A route that begins with a loop crosses
        itself.
    """
    return _next_point(points_m.tolist(), *position_m, corridor_m, max_along_m)


def remaining_m(points_m: FloatArray, passed: int) -> FloatArray:
    """Return the waypoints that a vehicle has not passed; behind the route its last one."""
    return points_m[min(passed, len(points_m) - 1) :]


def points_within(points_m: FloatArray, position_m: tuple[float, float], length_m: float) -> int:
    """Return the number of waypoints up to the first one that is farther along a route than a length."""
    left = np.vstack((position_m, points_m))
    along_m = np.hypot(*np.diff(left, axis=0).T).cumsum()
    return min(int(np.searchsorted(along_m, length_m)) + 1, len(points_m))


def remaining_length_m(points_m: FloatArray, position_m: tuple[float, float], passed: int) -> float:
    """Return the length of the rest of a route for a vehicle that has passed some of its waypoints."""
    left = [position_m, *remaining_m(points_m, passed).tolist()]
    return sum(math.hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(left))


def _next_point(
    points: Sequence[Sequence[float]],
    east_m: float,
    north_m: float,
    corridor_m: float,
    max_along_m: float = math.inf,
) -> int:
    """Return `next_point` with Python floats: faster for the few waypoints of a route."""
    first = 0
    before_m = 0.0
    for index, ((x, y), (end_x, end_y)) in enumerate(pairwise(points)):
        leg_x = end_x - x
        leg_y = end_y - y
        dx = east_m - x
        dy = north_m - y
        length_m = math.hypot(leg_x, leg_y)
        if length_m == 0.0:
            continue
        along_m = (dx * leg_x + dy * leg_y) / length_m
        across_m = abs(leg_x * dy - leg_y * dx) / length_m
        if 0.0 < along_m <= length_m and across_m <= corridor_m and before_m + along_m <= max_along_m:
            first = index + 1
        before_m += length_m
    return first


def time_to_point_s(
    points_m: FloatArray,
    index: int,
    position_m: tuple[float, float],
    speed_m_s: float,
    accept_radius_m: float,
) -> float:
    """Return the seconds until a vehicle may count waypoint `index` as reached; inf behind the last one.

    A waypoint is reached within `accept_radius_m`, or where the vehicle passes the end of the leg: autopilots
    turn there at any distance from the leg.

    Parameters
    ----------
    points_m : (k, 2) array
        East and north of the waypoints in order of flight; k >= 1.
    """
    if index >= len(points_m):
        return math.inf
    end = points_m[index]
    place = np.asarray(position_m)
    to_go_m = float(np.hypot(*(end - place))) - accept_radius_m
    if index > 0:
        leg = end - points_m[index - 1]
        length_m = float(np.hypot(*leg))
        if length_m > 0.0:
            to_go_m = min(to_go_m, float((end - place) @ leg) / length_m)
    return max(to_go_m, 0.0) / max(speed_m_s, _SLOW_M_S)
