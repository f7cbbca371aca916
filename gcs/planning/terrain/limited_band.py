"""The flight band over and under areas with vertical limits.

An area raises the floor of the band, or lowers its ceiling, on the same side everywhere: a path that changed
the side between two nodes would lead through it. All nodes around a square that the area touches count as
part of it, since floor and ceiling are bilinear between nodes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy import ndimage

from gcs.model import BoolArray, FloatArray
from gcs.planning.map.grid import Grid, free_grid_like
from gcs.planning.map.limited_area import LimitedArea, blocked_by
from gcs.planning.terrain.band import NO_BAND_M, FlightBand
from gcs.terrain.elevation_grid import Elevation

_AROUND_SPACINGS = 1.5


def split_closed(
    band: FlightBand,
    elevation: Elevation,
    grid: Grid,
    areas: Iterable[LimitedArea],
    home_msl_m: float,
    clearances_m: tuple[float, float],
) -> tuple[list[LimitedArea], list[LimitedArea]]:
    """Return the areas that a band can pass neither over nor under anywhere, and the others.

    The closed ones are obstacles: a way leads round them. Parameters as of `limit_band`.
    """
    closed: list[LimitedArea] = []
    passed: list[LimitedArea] = []
    before = band.surfaces_msl_m[:, :, :2]
    for area in areas:
        limited = limit_band(band, elevation, grid, [area], home_msl_m, clearances_m)
        after = limited.surfaces_msl_m[:, :, :2][(limited.surfaces_msl_m[:, :, :2] != before).any(axis=2)]
        is_closed = bool(len(after)) and bool((after[:, 0] >= after[:, 1]).all())
        (closed if is_closed else passed).append(area)
    return closed, passed


def limit_band(
    band: FlightBand,
    elevation: Elevation,
    grid: Grid,
    areas: Iterable[LimitedArea],
    home_msl_m: float,
    clearances_m: tuple[float, float],
) -> FlightBand:
    """Return a flight band that passes over or under areas; the same one without areas.

    An area is passed over if that leaves at least as many nodes open as to pass under it.

    Parameters
    ----------
    band : FlightBand
        Band of `elevation`.
    grid : Grid
        Map that the cells of the areas belong to.
    home_msl_m : float
        Height that limits above home refer to.
    clearances_m : (float, float)
        Horizontal and vertical distance to keep from the areas.
    """
    areas = list(areas)
    if not areas:
        return band
    floor_m, ceiling_m, room_m = band.surfaces_msl_m.astype(np.float64).transpose(2, 0, 1)
    lowest_m = ndimage.minimum_filter(elevation.heights_msl_m, size=3, mode="nearest")
    highest_m = ndimage.maximum_filter(elevation.heights_msl_m, size=3, mode="nearest")
    beside_m, above_m = clearances_m
    reach_m = beside_m + _AROUND_SPACINGS * elevation.spacing_m
    for area in areas:
        near = _nodes_near(elevation, blocked_by(free_grid_like(grid), [area]), reach_m)
        low_m, high_m = area.limits.bounds_m
        zero_m = home_msl_m if area.limits.reference == "home" else 0.0
        is_agl = area.limits.reference == "ground"
        bottom_m = low_m - above_m + (lowest_m[near] if is_agl else zero_m)
        top_m = high_m + above_m + (highest_m[near] if is_agl else zero_m)
        over_m = np.maximum(floor_m[near], top_m)
        under_m = np.minimum(ceiling_m[near], bottom_m)
        if np.count_nonzero(over_m < ceiling_m[near]) >= np.count_nonzero(under_m > floor_m[near]):
            floor_m[near] = over_m
        else:
            ceiling_m[near] = under_m
    surfaces = np.stack((floor_m, ceiling_m, room_m), axis=2)
    surfaces[floor_m >= ceiling_m, :2] = (NO_BAND_M, -NO_BAND_M)
    limited = surfaces.astype(np.float32)
    limited.flags.writeable = False
    return replace(band, surfaces_msl_m=limited)


def _nodes_near(elevation: Elevation, grid: Grid, reach_m: float) -> BoolArray:
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
