"""The flight band over terrain: least and greatest height above mean sea level at each place.

The floor at a node is the highest ground within the tracking margin plus the least height above ground. The
ceiling is the lowest ground there plus the greatest height above ground. Both are bilinear between the nodes
of the elevation model. A node nearer than the clearance to a blocked cell, or off the map, has no band: a path
may not enter a square that has such a node as a corner. (Blocked cells are no smaller than these squares, so
no corner of a cell lies in a square whose nodes are all free.)

Searches work in metres from node (0, 0), with angles counter-clockwise from east.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from gcs.jit import spliced
from gcs.model import BoolArray, Float32Array, FloatArray
from gcs.planning.map.grid import Grid, Point
from gcs.terrain.elevation import Elevation

NO_BAND_M = 1e6
"""Floor, and negative ceiling, of a node without a band."""
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
    surfaces_msl_m : ndarray of float32, shape (rows north, cols east, 2)
        Floor and ceiling of each node, above mean sea level. Read-only.
    entry_depth_m : float
        Depth below the floor at which a vehicle may be that enters the band from below.
    """

    origin_m: Point
    spacing_m: float
    surfaces_msl_m: Float32Array
    entry_depth_m: float

    def narrowed(self, slack_m: float) -> FlightBand:
        """Return the band with a floor higher and a ceiling lower by some metres."""
        surfaces = self.surfaces_msl_m + np.array([slack_m, -slack_m], dtype=np.float32)
        surfaces.flags.writeable = False
        return replace(self, surfaces_msl_m=surfaces)

    def limits_at(self, points_m: FloatArray) -> FloatArray:
        """Return floor and ceiling (k, 2) at places (k, 2); no room (floor above ceiling) where no band is."""
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
        limits: FloatArray = np.where(
            is_inside[:, None], (1.0 - v) * south + v * north, (NO_BAND_M, -NO_BAND_M)
        )
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
    surfaces = np.stack((floor, ceiling), axis=2)
    # The ground beyond the edge is unknown.
    edge = math.ceil(margin_m / elevation.spacing_m)
    is_edge = np.ones(ground.shape, dtype=np.bool_)
    is_edge[edge : ground.shape[0] - edge, edge : ground.shape[1] - edge] = False
    surfaces[is_edge] = (NO_BAND_M, -NO_BAND_M)
    if grid is not None:
        surfaces[_is_closed(elevation, grid, clearance_m)] = (NO_BAND_M, -NO_BAND_M)
    surfaces = surfaces.astype(np.float32)
    surfaces.flags.writeable = False
    return FlightBand(elevation.origin_m, elevation.spacing_m, surfaces, _ENTRY_SHARE * min_agl_m)


def disc_footprint(radius: float) -> BoolArray:
    """Return a square array that is True within a distance (in cells) of its centre."""
    reach = math.floor(radius)
    steps = np.arange(-reach, reach + 1)
    within: BoolArray = np.hypot(steps[:, None], steps[None, :]) <= radius
    return within


def _is_closed(elevation: Elevation, grid: Grid, clearance_m: float) -> BoolArray:
    """Return True for the nodes of the elevation that are too near to a blocked cell, or off the map."""
    row, col = _nodes_on(elevation, grid)
    map_rows, map_cols = grid.shape
    is_on_map = ((row >= -0.5) & (row <= map_rows - 0.5))[:, None] & ((col >= -0.5) & (col <= map_cols - 0.5))
    # The square of nodes around a place bulges by the sagitta between two nodes at the clearance.
    reach_m = clearance_m + elevation.spacing_m**2 / (8.0 * max(clearance_m, elevation.spacing_m))
    closed: BoolArray = ~is_on_map | nodes_near(elevation, grid, reach_m)
    return closed


def nodes_near(elevation: Elevation, grid: Grid, reach_m: float) -> BoolArray:
    """Return True for the nodes of the elevation within a distance of a blocked cell."""
    row, col = _nodes_on(elevation, grid)
    near = np.zeros(elevation.heights_msl_m.shape, dtype=np.bool_)
    for r, c in np.argwhere(grid.blocked).tolist():
        rows_near = np.flatnonzero(np.abs(row - r) <= 0.5 + reach_m / grid.spacing_m)
        cols_near = np.flatnonzero(np.abs(col - c) <= 0.5 + reach_m / grid.spacing_m)
        if not rows_near.size or not cols_near.size:
            continue
        block = (slice(rows_near[0], rows_near[-1] + 1), slice(cols_near[0], cols_near[-1] + 1))
        up = np.maximum(np.abs(row[block[0]] - r) - 0.5, 0.0)
        along = np.maximum(np.abs(col[block[1]] - c) - 0.5, 0.0)
        near[block] |= np.hypot(up[:, None], along[None, :]) * grid.spacing_m <= reach_m
    return near


def _nodes_on(elevation: Elevation, grid: Grid) -> tuple[FloatArray, FloatArray]:
    """Return the rows and the columns of the elevation's nodes on a map, as floats."""
    rows, cols = elevation.heights_msl_m.shape
    east_m = elevation.origin_m[0] + elevation.spacing_m * np.arange(cols)
    north_m = elevation.origin_m[1] + elevation.spacing_m * np.arange(rows)
    row = np.asarray((north_m - grid.origin_m[1]) / grid.spacing_m, dtype=np.float64)
    col = np.asarray((east_m - grid.origin_m[0]) / grid.spacing_m, dtype=np.float64)
    return row, col


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
