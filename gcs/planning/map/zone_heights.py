"""Areas with vertical limits on a map.

Over terrain they raise the floor of the flight band, or lower its ceiling. Over level ground
`gcs.model.LayerHeights` says which of them missions meet.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from gcs.model import FloatArray, IntArray, VerticalLimits
from gcs.planning.map.grid import Grid, free_grid_like
from gcs.terrain.elevation import Elevation


@dataclass(frozen=True, eq=False)
class LimitedArea:
    """Cells of a map that an area with vertical limits covers."""

    cells: IntArray
    """Flat indices."""
    limits: VerticalLimits


def blocked_by(grid: Grid, areas: Iterable[LimitedArea]) -> Grid:
    """Return a map with the cells of areas blocked; the same one without areas."""
    areas = list(areas)
    if not areas:
        return grid
    blocked = grid.blocked.copy()
    for area in areas:
        blocked.flat[area.cells] = True
    return replace(grid, blocked=blocked)


def limit_band(
    grid: Grid,
    elevation: Elevation,
    band_msl_m: tuple[FloatArray, FloatArray],
    areas: Iterable[LimitedArea],
    home_msl_m: float,
    clearances_m: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return floor and ceiling of a flight band that passes over or under areas with vertical limits.

    An area is passed on the same side everywhere: over it if that leaves at least as many cells open. A cell
    whose floor is not below its ceiling has no room, nor has one without a height of the ground.

    Parameters
    ----------
    band_msl_m : (ndarray, ndarray), shapes (rows, cols)
        Floor and ceiling of the band above mean sea level, at the nodes of `grid`.
    areas : iterable of LimitedArea
        Cells of `grid`.
    home_msl_m : float
        Height that limits above home refer to.
    clearances_m : (float, float)
        Horizontal and vertical distance to keep from the areas.

    Returns
    -------
    (ndarray, ndarray), shapes (rows, cols)
    """
    floor_m, ceiling_m = (surface.copy() for surface in band_msl_m)
    lowest_m, highest_m = _ground(grid, elevation)
    beside_m, above_m = clearances_m
    free = free_grid_like(grid)
    for area in areas:
        near = blocked_by(free, [area]).inflate(beside_m).blocked
        low_m, high_m = area.limits.bounds_m
        zero_m = {"home": home_msl_m, "msl": 0.0, "ground": 0.0}[area.limits.reference]
        is_agl = area.limits.reference == "ground"
        bottom_m = low_m - above_m + (lowest_m[near] if is_agl else zero_m)
        top_m = high_m + above_m + (highest_m[near] if is_agl else zero_m)
        over_m = np.maximum(floor_m[near], top_m)
        under_m = np.minimum(ceiling_m[near], bottom_m)
        if np.count_nonzero(over_m < ceiling_m[near]) >= np.count_nonzero(under_m > floor_m[near]):
            floor_m[near] = over_m
        else:
            ceiling_m[near] = under_m
    unknown = np.isnan(lowest_m) | np.isnan(floor_m) | np.isnan(ceiling_m)
    floor_m[unknown] = np.inf
    return floor_m, ceiling_m


def _ground(grid: Grid, elevation: Elevation) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest ground at the corners and the middle of each cell; NaN if unknown."""
    rows, cols = grid.shape
    half_m = 0.5 * grid.spacing_m
    east_m, north_m = (
        origin_m + grid.spacing_m * np.arange(count)
        for origin_m, count in zip(grid.origin_m, (cols, rows), strict=True)
    )
    at_m = np.stack(np.broadcast_arrays(east_m[np.newaxis, :], north_m[:, np.newaxis]), axis=-1).reshape(
        -1, 2
    )
    offsets_m = half_m * np.array([(0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)])
    heights_m = [elevation.heights_at(at_m + offset_m).reshape(rows, cols) for offset_m in offsets_m]
    return np.min(heights_m, axis=0), np.max(heights_m, axis=0)
