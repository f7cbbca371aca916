"""Which routes lead through areas that were closed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gcs.core.airspace.no_fly_zones import MapChange
from gcs.model import FloatArray, Route, VehicleState
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight


def is_crossed(closed: Grid, route_m: FloatArray, place: Point | None, passed: int = 0) -> bool:
    """Return True if the rest of a route leads through closed cells.

    Parameters
    ----------
    route_m : ndarray, shape (k, 2)
        East and north of the route.
    place : tuple of float or None
        Position of its vehicle; None: the whole route is left.
    passed : int
        Number of points that the vehicle has passed.
    """
    points = [(east_m, north_m) for east_m, north_m in rest_of(route_m, place, passed).tolist()]
    if len(points) == 1:
        points *= 2
    return not all(line_of_sight(closed, a, b) for a, b in pairwise(points))


def leads_through(change: MapChange, route: Route, state: VehicleState | None, passed: int) -> bool:
    """Return True if the rest of a route leads through what is newly blocked."""
    place = None if state is None else (state.east_m, state.north_m)
    if is_crossed(change.layers, route.flown_m, place, passed):
        return True
    if route.heights_msl_m is None:
        return False
    path_m = np.column_stack((route.flown_m, route.heights_msl_m))
    begin = None if state is None else (state.east_m, state.north_m, state.alt_msl_m)
    return change.is_crossed(rest_of(path_m, begin, passed))


def rest_of(path_m: FloatArray, begin: Sequence[float] | None, passed: int) -> FloatArray:
    """Return a path from where its vehicle is, without the points that it has passed."""
    return path_m if begin is None else np.vstack((begin, path_m[min(passed, len(path_m) - 1) :]))
