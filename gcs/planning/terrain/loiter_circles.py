"""Loiter circles inside the flight band: at one height all the way round.

A circle keeps the floor of its whole disc, since vehicles enter and fly it tighter, and the ceiling of its
ring. Nodes whose squares touch it count, so the bilinear surfaces between them are kept everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.jit import kernel
from gcs.model import Float32Array
from gcs.planning.map.grid import Point
from gcs.planning.terrain.band import FlightBand
from gcs.planning.terrain.goal import goal_at
from gcs.planning.terrain.terrain_map import BandCircle, Goal, TerrainMap

_MIN_ROOM_M = 5.0
"""Room in height that a circle needs."""
_TOUCHED = math.sqrt(2.0)
"""Distance in cells of a node from a place in a square that it is a corner of, at most."""
_MOST_CIRCLES = 3
"""Loiter circles that a route may go on to behind its target."""
_APART_RADII = 1.0
"""Distance between their centres."""
_PASS_SHARE = 0.75
"""Share of the reach radius within which a target is passed."""
_MAX_BEHIND_RADII = 15.0
"""Distance of their centres from the target."""


@dataclass(frozen=True, eq=False)
class CircleMap:
    """Heights of loiter circles by their centre.

    Attributes
    ----------
    band : FlightBand
    radius_m : float
    heights_msl_m : ndarray of float32, shape (rows, cols, 2)
        Least and greatest height of the circle around each node of the band; least above greatest for none.
    """

    band: FlightBand
    radius_m: float
    heights_msl_m: Float32Array


def make_circle_map(band: FlightBand, radius_m: float) -> CircleMap:
    """Return the heights of the circles around all nodes; about 0.2 s for a radius of seven nodes."""
    rows, cols, _ = band.surfaces_msl_m.shape
    reach = radius_m / band.spacing_m
    return CircleMap(band, radius_m, circle_heights(band.surfaces_msl_m, reach, 0, rows, 0, cols))


@kernel
def circle_heights(
    surfaces: Float32Array, radius: float, first_row: int, end_row: int, first_col: int, end_col: int
) -> Float32Array:
    """Return least and greatest height of circles around some nodes; `radius` in cells."""
    rows, cols, _ = surfaces.shape
    heights = np.empty((end_row - first_row, end_col - first_col, 2), np.float32)
    outer = radius + _TOUCHED
    inner = max(radius - _TOUCHED, 0.0)
    reach = int(outer)
    for row in range(first_row, end_row):
        for col in range(first_col, end_col):
            low = -np.inf
            high = np.inf
            if row < reach or col < reach or row + reach >= rows or col + reach >= cols:
                low = np.inf
                high = -np.inf
            else:
                for up in range(-reach, reach + 1):
                    wide = int(math.sqrt(outer * outer - up * up))
                    for along in range(-wide, wide + 1):
                        low = max(low, surfaces[row + up, col + along, 0])
                        if surfaces[row + up, col + along, 2] < 0.0:
                            low = np.inf
                        if up * up + along * along >= inner * inner:
                            high = min(high, surfaces[row + up, col + along, 1])
            heights[row - first_row, col - first_col, 0] = low
            heights[row - first_row, col - first_col, 1] = high
    return heights


def circle_at(circles: CircleMap, centre_m: Point, *, is_clockwise: bool | None = True) -> BandCircle | None:
    """Return the circle around a place; None without room in height for it.

    Heights are those of the circles around the nodes next to the place, all of them.
    """
    band = circles.band
    rows, cols, _ = circles.heights_msl_m.shape
    x = (centre_m[0] - band.origin_m[0]) / band.spacing_m
    y = (centre_m[1] - band.origin_m[1]) / band.spacing_m
    if not (0.0 <= x <= cols - 1 and 0.0 <= y <= rows - 1):
        return None
    near = circles.heights_msl_m[math.floor(y) : math.ceil(y) + 1, math.floor(x) : math.ceil(x) + 1]
    low = float(near[:, :, 0].max())
    high = float(near[:, :, 1].min())
    if high - low < _MIN_ROOM_M:
        return None
    return BandCircle(centre_m[0], centre_m[1], circles.radius_m, low, high, is_clockwise)


def nearest_circles(
    circles: CircleMap, place_m: Point, *, is_clockwise: bool | None = True
) -> tuple[BandCircle, ...]:
    """Return a few circles near a place, the nearest first, a radius or more apart."""
    band = circles.band
    reach_m = _MAX_BEHIND_RADII * circles.radius_m
    corner = (np.array(place_m) - reach_m - band.origin_m) / band.spacing_m
    col, row = np.maximum(np.ceil(corner), 0.0).astype(np.int64).tolist()
    size = math.ceil(2.0 * reach_m / band.spacing_m)
    heights = circles.heights_msl_m[row : row + size, col : col + size]
    at = np.argwhere(heights[:, :, 1] - heights[:, :, 0] >= _MIN_ROOM_M)
    centres = (at[:, ::-1] + (col, row)) * band.spacing_m + np.array(band.origin_m)
    apart_m = np.hypot(*(centres - np.array(place_m)).T)
    found: list[BandCircle] = []
    for k in np.argsort(apart_m, kind="stable").tolist():
        if apart_m[k] > reach_m or len(found) == _MOST_CIRCLES:
            break
        east, north = centres[k].tolist()
        least_m = _APART_RADII * circles.radius_m
        if all(math.hypot(east - one.east_m, north - one.north_m) >= least_m for one in found):
            low, high = heights[tuple(at[k])].tolist()
            found.append(BandCircle(east, north, circles.radius_m, low, high, is_clockwise))
    return tuple(found)


def goal_at_target(
    terrain: TerrainMap,
    circles: CircleMap,
    target_m: Point,
    reach_radius_m: float,
    *,
    is_clockwise: bool | None = True,
) -> Goal | None:
    """Return the goal of routes to a target: a small circle around it, or a point and the circles near it.

    Where the band has no place within `reach_radius_m` of the target, or no circle near it, return None.
    """
    circle = circle_at(circles, target_m, is_clockwise=is_clockwise)
    if circle is not None and circle.radius_m <= _PASS_SHARE * reach_radius_m:
        return goal_at(terrain, [circle])
    near = nearest_circles(circles, target_m, is_clockwise=is_clockwise)
    place = _place_near(terrain.search_band, target_m, _PASS_SHARE * reach_radius_m)
    if not near or place is None:
        return None
    reach_m = min(_PASS_SHARE * reach_radius_m, reach_radius_m - math.dist(place, target_m))
    return goal_at(terrain, near, place, reach_m)


def _place_near(band: FlightBand, target_m: Point, reach_radius_m: float) -> Point | None:
    """Return the target, or the nearest node within reach, that has a band; None without one."""
    rows, cols, _ = band.surfaces_msl_m.shape
    east = band.origin_m[0] + band.spacing_m * np.arange(cols)
    north = band.origin_m[1] + band.spacing_m * np.arange(rows)
    cols_near = np.flatnonzero(np.abs(east - target_m[0]) <= reach_radius_m)
    rows_near = np.flatnonzero(np.abs(north - target_m[1]) <= reach_radius_m)
    nodes = [(east[col], north[row]) for row in rows_near for col in cols_near]
    places = np.array([target_m, *nodes])
    apart_m = np.hypot(*(places - np.array(target_m)).T)
    limits = band.limits_at(places)
    is_open = (limits[:, 0] < limits[:, 1]) & (apart_m <= reach_radius_m)
    if not is_open.any():
        return None
    k = int(np.argmin(np.where(is_open, apart_m, np.inf)))
    return float(places[k, 0]), float(places[k, 1])
