"""How far along a route a vehicle is.

A vehicle that gets a new route flies on while the mission is on its way to it, for many seconds on a bad
link. It should enter the route where it is by then, not turn back to the route's beginning.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gcs.model import FloatArray

CORRIDOR_M = 40.0
"""A vehicle this near to a leg of its route flies it."""
_SLOW_M_S = 1.0


def next_point(
    points_m: FloatArray, place_m: tuple[float, float], corridor_m: float, most_m: float = math.inf
) -> int:
    """Index of the first point of a route that a vehicle has not passed.

    It has passed a point when it is beside the leg that begins there: beyond the leg's beginning, not
    beyond its end, and within `corridor_m` of it.

    Parameters
    ----------
    points_m : (k, 2) array
        East and north of the route's points, in the order of flight; k >= 1.
    place_m : (float, float)
        Where the vehicle is.
    corridor_m : float
        Greatest distance from a leg that is being flown.
    most_m : float
        How far behind the first point it may have got by now: a route that begins with a loop comes past its
        own beginning.
    """
    return _next_point(points_m.tolist(), *place_m, corridor_m, most_m)


def remaining_length_m(points_m: FloatArray, place_m: tuple[float, float], corridor_m: float) -> float:
    """Length of what is left of a route for a vehicle at `place_m`; parameters as of `next_point`."""
    points = points_m.tolist()
    left = [place_m, *points[_next_point(points, *place_m, corridor_m) :]]
    return sum(math.hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(left))


def _next_point(
    points: Sequence[Sequence[float]],
    east_m: float,
    north_m: float,
    corridor_m: float,
    most_m: float = math.inf,
) -> int:
    """`next_point` on Python's floats: routes have few points, and each vehicle is asked for at each scan."""
    first, before_m = 0, 0.0
    for index, ((x, y), (end_x, end_y)) in enumerate(pairwise(points)):
        leg_x, leg_y, dx, dy = end_x - x, end_y - y, east_m - x, north_m - y
        length_m = math.hypot(leg_x, leg_y)
        if length_m == 0.0:
            continue
        along_m, across_m = (dx * leg_x + dy * leg_y) / length_m, abs(leg_x * dy - leg_y * dx) / length_m
        if 0.0 < along_m <= length_m and across_m <= corridor_m and before_m + along_m <= most_m:
            first = index + 1
        before_m += length_m
    return first


def time_to_point_s(
    points_m: FloatArray, index: int, place_m: tuple[float, float], speed_m_s: float, accept_radius_m: float
) -> float:
    """Seconds until a vehicle that flies to point `index` may count it as reached.

    It does when it is within `accept_radius_m`, or beside the end of the leg: autopilots turn then, however
    far off the leg they are. Behind the last point there is nothing to reach: infinite.

    Parameters
    ----------
    points_m : (k, 2) array
        East and north of the route's points, in the order of flight; k >= 1.
    """
    if index >= len(points_m):
        return math.inf
    end, place = points_m[index], np.asarray(place_m)
    to_go_m = float(np.hypot(*(end - place))) - accept_radius_m
    if index > 0:
        leg = end - points_m[index - 1]
        length_m = float(np.hypot(*leg))
        if length_m > 0.0:
            to_go_m = min(to_go_m, float((end - place) @ leg) / length_m)
    return max(to_go_m, 0.0) / max(speed_m_s, _SLOW_M_S)
