"""The flight band over terrain: least and greatest height above mean sea level at each place.

The floor at a node is the highest ground within the tracking margin plus the least height above ground. The
ceiling is the lowest ground there plus the greatest height above ground. The room at a node is its distance
from blocked cells beyond the clearance, and from the edge of the map. All three are bilinear between the
nodes of the elevation model. Where the room is negative there is no band.

Searches work in metres from node (0, 0), with angles counter-clockwise from east.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gcs.jit import spliced
from gcs.model import BoolArray, Float32Array, FloatArray
from gcs.planning.map.grid import Grid, Point
from gcs.terrain.elevation_grid import Elevation

NO_BAND_M = 1e6
"""Floor, and negative ceiling, of a place without a band."""
_MOST_ROOM_SPACINGS = 4.0
_ROOM_SLACKS = 2.0
"""Room that a narrower band takes away, as a multiple of the slack in height."""
_ENTRY_SHARE = 0.5
"""Share of the least height above ground that a vehicle keeps that enters the band from below."""


@dataclass(frozen=True, slots=True)
class Vertical:
    """Steepest climb and descent over ground: height gained or lost per distance, both positive."""

    climb_gradient: float
    sink_gradient: float


@dataclass(frozen=True, eq=False)
class FlightBand:
    """Floor and ceiling of flight.

    Attributes
    ----------
    origin_m : tuple of float
        East and north of node (0, 0).
    spacing_m : float
        Distance of neighbouring nodes.
    surfaces_msl_m : ndarray of float32, shape (rows north, cols east, 3)
        Floor and ceiling of each node, above mean sea level, and its room. Read-only.
    entry_depth_m : float
        Depth below the floor at which a vehicle may be that enters the band from below.
    """

    origin_m: Point
    spacing_m: float
    surfaces_msl_m: Float32Array
    entry_depth_m: float

    def narrowed(self, slack_m: float) -> FlightBand:
        """Return the band with a floor higher and a ceiling lower by some metres, and with less room."""
        slack = np.array([slack_m, -slack_m, -_ROOM_SLACKS * slack_m], dtype=np.float32)
        surfaces = self.surfaces_msl_m + slack
        surfaces.flags.writeable = False
        return replace(self, surfaces_msl_m=surfaces)

    def limits_at(self, points_m: FloatArray) -> FloatArray:
        """Return floor and ceiling (k, 2) at places (k, 2); floor above ceiling where no band is."""
        rows, cols, _ = self.surfaces_msl_m.shape
        x, y = ((np.asarray(points_m, dtype=np.float64) - self.origin_m) / self.spacing_m).T
        is_inside = (x >= 0.0) & (x <= cols - 1) & (y >= 0.0) & (y <= rows - 1)
        x = np.where(is_inside, x, 0.0)
        y = np.where(is_inside, y, 0.0)
        col = np.minimum(x.astype(np.intp), cols - 2)
        row = np.minimum(y.astype(np.intp), rows - 2)
        u = (x - col)[:, None]
        v = (y - row)[:, None]
        z = self.surfaces_msl_m
        south = (1.0 - u) * z[row, col] + u * z[row, col + 1]
        north = (1.0 - u) * z[row + 1, col] + u * z[row + 1, col + 1]
        read = (1.0 - v) * south + v * north
        is_inside &= read[:, 2] >= 0.0
        limits: FloatArray = np.where(is_inside[:, None], read[:, :2], (NO_BAND_M, -NO_BAND_M))
        return limits


def make_band(
    elevation: Elevation,
    min_agl_m: float,
    max_agl_m: float,
    grid: Grid | None = None,
    clearance_m: float = 0.0,
    margin_m: float = 0.0,
) -> FlightBand:
    """Return the band between two heights above ground.

    Parameters
    ----------
    elevation : Elevation
        Ground. Nothing is flown outside its nodes.
    min_agl_m, max_agl_m : float
        Least and greatest height above ground.
    grid : Grid or None
        Blocked cells. Nothing is flown off this map. None: the nodes of the elevation are the map.
    clearance_m : float
        Distance to keep from blocked cells.
    margin_m : float
        Tracking margin: the band holds above all ground within this distance.
    """
    ground = elevation.heights_msl_m
    disc = disc_footprint(margin_m / elevation.spacing_m)
    floor = ndimage.maximum_filter(ground, footprint=disc, mode="nearest") + min_agl_m
    ceiling = ndimage.minimum_filter(ground, footprint=disc, mode="nearest") + max_agl_m
    surfaces = np.stack((floor, ceiling, _room_m(elevation, grid, clearance_m, margin_m)), axis=2)
    surfaces = surfaces.astype(np.float32)
    surfaces.flags.writeable = False
    return FlightBand(elevation.origin_m, elevation.spacing_m, surfaces, _ENTRY_SHARE * min_agl_m)


def disc_footprint(radius: float) -> BoolArray:
    """Return a square array that is True within a distance (in cells) of its centre."""
    reach = math.floor(radius)
    steps = np.arange(-reach, reach + 1)
    within: BoolArray = np.hypot(steps[:, None], steps[None, :]) <= radius
    return within


def _room_m(elevation: Elevation, grid: Grid | None, clearance_m: float, margin_m: float) -> FloatArray:
    """Return the room of each node of the elevation, at most `_MOST_ROOM_SPACINGS`."""
    rows, cols = elevation.heights_msl_m.shape
    spacing_m = elevation.spacing_m
    east = elevation.origin_m[0] + spacing_m * np.arange(cols)
    north = elevation.origin_m[1] + spacing_m * np.arange(rows)
    # The ground beyond the edge is unknown.
    room = np.minimum(*np.meshgrid(_inside_m(east, east[0], east[-1]), _inside_m(north, north[0], north[-1])))
    room = np.minimum(room - margin_m, _MOST_ROOM_SPACINGS * spacing_m)
    if grid is None:
        return room
    half_m = 0.5 * grid.spacing_m
    map_rows, map_cols = grid.shape
    west, south = grid.point_of((0, 0))
    along = _inside_m(east, west - half_m, west + grid.spacing_m * map_cols - half_m)
    up = _inside_m(north, south - half_m, south + grid.spacing_m * map_rows - half_m)
    room = np.minimum(room, np.minimum(*np.meshgrid(along, up)))
    # Between nodes the distance from a corner is read too great by up to the sagitta.
    kept_m = clearance_m + spacing_m**2 / (8.0 * max(clearance_m, spacing_m))
    reach_m = half_m + kept_m + _MOST_ROOM_SPACINGS * spacing_m
    for node in np.argwhere(grid.blocked).tolist():
        x, y = grid.point_of((node[0], node[1]))
        cols_near = np.flatnonzero(np.abs(east - x) <= reach_m)
        rows_near = np.flatnonzero(np.abs(north - y) <= reach_m)
        if not rows_near.size or not cols_near.size:
            continue
        block = (slice(rows_near[0], rows_near[-1] + 1), slice(cols_near[0], cols_near[-1] + 1))
        dx = np.abs(east[block[1]] - x)[None, :] - half_m
        dy = np.abs(north[block[0]] - y)[:, None] - half_m
        apart = np.hypot(np.maximum(dx, 0.0), np.maximum(dy, 0.0)) + np.minimum(np.maximum(dx, dy), 0.0)
        room[block] = np.minimum(room[block], apart - kept_m)
    return room


def _inside_m(places: NDArray[np.floating[Any]], low: float, high: float) -> FloatArray:
    """Return the distance from the nearer end of an interval, negative outside."""
    inside: FloatArray = np.minimum(places - low, high - places)
    return inside


@spliced
def read_limits(surfaces: Float32Array, x: float, y: float) -> tuple[float, float]:
    """Return floor and ceiling at a place in cells; without a band the floor is above the ceiling."""
    rows, cols, _ = surfaces.shape
    if not (0.0 <= x <= cols - 1 and 0.0 <= y <= rows - 1):
        return NO_BAND_M, -NO_BAND_M
    col = min(int(x), cols - 2)
    row = min(int(y), rows - 2)
    u = x - col
    v = y - row
    a = (1.0 - u) * (1.0 - v)
    b = u * (1.0 - v)
    c = (1.0 - u) * v
    d = u * v
    room = (
        a * surfaces[row, col, 2]
        + b * surfaces[row, col + 1, 2]
        + c * surfaces[row + 1, col, 2]
        + d * surfaces[row + 1, col + 1, 2]
    )
    if room < 0.0:
        return NO_BAND_M, -NO_BAND_M
    floor = (
        a * surfaces[row, col, 0]
        + b * surfaces[row, col + 1, 0]
        + c * surfaces[row + 1, col, 0]
        + d * surfaces[row + 1, col + 1, 0]
    )
    ceiling = (
        a * surfaces[row, col, 1]
        + b * surfaces[row, col + 1, 1]
        + c * surfaces[row + 1, col, 1]
        + d * surfaces[row + 1, col + 1, 1]
    )
    return floor, ceiling
