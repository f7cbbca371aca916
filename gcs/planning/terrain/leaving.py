"""The flight band of a vehicle that is inside an area: one that was closed around it, or begins beside it.

The band of others has no place for it. It leaves the area: within a disc around it, which reaches to the next
place that it can fly to and has room for turns, its band is that without the areas there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.limited_area import LimitedArea
from gcs.planning.terrain.band import FlightBand, Vertical
from gcs.planning.terrain.ground import Terrain
from gcs.planning.terrain.terrain_map import BandPose

_TURN_RADII = 3.0
"""Room for turns, beyond the next place outside."""


def is_inside(band: FlightBand, start: BandPose) -> bool:
    """Return True if a vehicle has no band where it is, or is too far below that to climb into it."""
    floor_m, ceiling_m = band.limits_at(np.array([(start.east_m, start.north_m)]))[0].tolist()
    return floor_m >= ceiling_m or start.high_msl_m < floor_m - band.entry_depth_m


def without_areas_at(
    terrain: Terrain, grid: Grid, place_m: Point, near_m: float
) -> tuple[Terrain, Grid] | None:
    """Return ground and map without the areas, and the connected blocked cells, near a place.

    None if there are none within `near_m`.
    """
    areas = tuple(area for area in terrain.areas if _distance_m(grid, area, place_m) > near_m)
    parts, _ = ndimage.label(grid.blocked, np.ones((3, 3), dtype=np.bool_))
    row = (place_m[1] - grid.origin_m[1]) / grid.spacing_m
    col = (place_m[0] - grid.origin_m[0]) / grid.spacing_m
    up = np.maximum(np.abs(np.arange(grid.shape[0]) - row) - 0.5, 0.0)
    along = np.maximum(np.abs(np.arange(grid.shape[1]) - col) - 0.5, 0.0)
    is_near = np.hypot(up[:, None], along[None, :]) * grid.spacing_m <= near_m
    left = np.unique(parts[is_near & grid.blocked])
    if len(areas) == len(terrain.areas) and not left.size:
        return None
    return replace(terrain, areas=areas), replace(grid, blocked=grid.blocked & ~np.isin(parts, left))


def _distance_m(grid: Grid, area: LimitedArea, place_m: Point) -> float:
    """Return the distance of a place from the cells of an area."""
    off_m = np.maximum(np.abs(area.centres_m(grid) - np.array(place_m)) - 0.5 * grid.spacing_m, 0.0)
    return float(np.hypot(*off_m.T).min(initial=np.inf))


def band_to_leave(
    band: FlightBand, free: FlightBand, start: BandPose, vertical: Vertical, turn_radius_m: float
) -> FlightBand:
    """Return the band of a vehicle that leaves an area; `free`: the band without the areas around it."""
    rows, cols, _ = band.surfaces_msl_m.shape
    x_m = band.origin_m[0] + band.spacing_m * np.arange(cols) - start.east_m
    y_m = band.origin_m[1] + band.spacing_m * np.arange(rows) - start.north_m
    away_m = np.hypot(x_m[None, :], y_m[:, None])
    floor_m, ceiling_m, room_m = band.surfaces_msl_m.astype(np.float64).transpose(2, 0, 1)
    is_open = (floor_m < ceiling_m) & (room_m >= 0.0)
    is_open &= floor_m <= start.high_msl_m + vertical.climb_gradient * away_m
    reach_m = float(np.min(away_m, initial=np.inf, where=is_open)) + _TURN_RADII * turn_radius_m
    surfaces = np.where((away_m <= reach_m)[:, :, None], free.surfaces_msl_m, band.surfaces_msl_m)
    surfaces.flags.writeable = False
    return replace(band, surfaces_msl_m=surfaces)
