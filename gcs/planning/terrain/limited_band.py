"""The flight band over and under areas with vertical limits.

An area raises the floor of the band, or lowers its ceiling, on the same side everywhere: a path that changed
the side between two nodes would lead through it. All nodes around a square that the area touches count as
part of it, since floor and ceiling are bilinear between nodes. Where that closes the band, the cells of the
area are blocked.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from scipy import ndimage

from gcs.model import BoolArray, FloatArray, IntArray
from gcs.planning.map.grid import Grid
from gcs.planning.map.limited_area import LimitedArea, blocked_by
from gcs.planning.terrain.band import NO_BAND_M, FlightBand
from gcs.terrain.elevation_grid import Elevation

_AROUND_SPACINGS = 1.5


def block_closed(
    band: FlightBand,
    elevation: Elevation,
    grid: Grid,
    areas: Iterable[LimitedArea],
    home_msl_m: float,
    clearances_m: tuple[float, float],
) -> tuple[Grid, list[LimitedArea]]:
    """Return a map with the cells blocked that the band can pass neither over nor under, and the other cells.

    A way leads round blocked cells with the clearance. A cell is blocked if the band is closed at a node near
    it: floor and ceiling would be a cliff there, whose corner a path cuts between two of its samples.
    Parameters as of `limit_band`.
    """
    areas = list(areas)
    limited = limit_band(band, elevation, grid, areas, home_msl_m, clearances_m)
    is_closed = _is_open(band) & ~_is_open(limited)
    if not is_closed.any():
        return grid, areas
    reach_m = _reach_m(elevation, clearances_m)
    closed: list[LimitedArea] = []
    passed: list[LimitedArea] = []
    for area in areas:
        near = _near_cells(elevation, grid, area.cells, reach_m)
        is_blocked = np.fromiter(((is_closed[block] & mask).any() for block, mask in near), np.bool_)
        closed.append(replace(area, cells=area.cells[is_blocked]))
        passed.append(replace(area, cells=area.cells[~is_blocked]))
    return blocked_by(grid, closed), passed


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
    above_m = clearances_m[1]
    reach_m = _reach_m(elevation, clearances_m)
    for area in areas:
        near = np.zeros(floor_m.shape, dtype=np.bool_)
        for block, mask in _near_cells(elevation, grid, area.cells, reach_m):
            near[block] |= mask
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


def _is_open(band: FlightBand) -> BoolArray:
    """Return True for the nodes whose floor is below the ceiling."""
    is_open: BoolArray = band.surfaces_msl_m[:, :, 0] < band.surfaces_msl_m[:, :, 1]
    return is_open


def _reach_m(elevation: Elevation, clearances_m: tuple[float, float]) -> float:
    """Return the distance from an area within which nodes count as part of it."""
    return clearances_m[0] + _AROUND_SPACINGS * elevation.spacing_m


def _near_cells(
    elevation: Elevation, grid: Grid, cells: IntArray, reach_m: float
) -> Iterator[tuple[tuple[slice, slice], BoolArray]]:
    """Yield, for each cell, a block of the elevation's nodes, and True for those within a distance of it."""
    row, col = _nodes_on(elevation, grid)
    reach = reach_m / grid.spacing_m
    for r, c in zip(*np.unravel_index(cells, grid.shape), strict=True):
        up = np.maximum(np.abs(row - r) - 0.5, 0.0)
        along = np.maximum(np.abs(col - c) - 0.5, 0.0)
        rows_near = np.flatnonzero(up <= reach)
        cols_near = np.flatnonzero(along <= reach)
        block = _span(rows_near), _span(cols_near)
        yield block, np.hypot(up[block[0], None], along[None, block[1]]) <= reach


def _span(indices: IntArray) -> slice:
    """Return the slice of consecutive indices."""
    return slice(int(indices[0]), int(indices[-1]) + 1) if len(indices) else slice(0)


def _nodes_on(elevation: Elevation, grid: Grid) -> tuple[FloatArray, FloatArray]:
    """Return the rows and the columns of the elevation's nodes on a map, as floats."""
    rows, cols = elevation.heights_msl_m.shape
    east_m = elevation.origin_m[0] + elevation.spacing_m * np.arange(cols)
    north_m = elevation.origin_m[1] + elevation.spacing_m * np.arange(rows)
    row = np.asarray((north_m - grid.origin_m[1]) / grid.spacing_m, dtype=np.float64)
    col = np.asarray((east_m - grid.origin_m[0]) / grid.spacing_m, dtype=np.float64)
    return row, col
