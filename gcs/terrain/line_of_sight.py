"""Line of sight from a sensor over the terrain: which places it sees.

Along each bearing a ray runs outwards from a height h. The ground at range r has the slope (ground(r) - h)
/ r. The greatest slope nearer than r is the horizon, and an object at r is in sight above the line h +
horizon r. The height of that line above the ground at r is the shadow: 0 where the ground itself is in sight.
This is the viewshed of a geographic information system, kept as heights, for objects of every height.

The ground is read as often as its nodes are apart. Beyond the elevation model nothing is in the way. The
Earth's curvature is left out, as in `gcs.terrain.elevation_grid`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.jit import Call, kernel
from gcs.model import Float32Array, FloatArray, Visibility, read_only
from gcs.terrain.elevation_grid import Elevation

_MAX_BEARINGS: Final = 1024
_MAX_RANGES: Final = 512
"""Together 2 MB of shadows for a place."""
_EDGE_SHARE: Final = np.float32(0.01)
"""What is seen at least in a cell at the edge of a shadow."""


@dataclass(frozen=True, eq=False)
class LineOfSight:
    """Shadows around a place.

    Attributes
    ----------
    east_m, north_m : float
        The place.
    range_step_m : float
        Distance of neighbouring ranges; the first is 0.
    shadow_agl_m : ndarray, shape (bearings, ranges), float32
        Height above the ground from which an object is in sight. Bearings begin at north, clockwise.
    """

    east_m: float
    north_m: float
    range_step_m: float
    shadow_agl_m: Float32Array

    def shadows_at(self, points_m: FloatArray) -> FloatArray:
        """Return the shadow (k,) at places (k, 2)."""
        return _nearest(self.east_m, self.north_m, self.range_step_m, self.shadow_agl_m, points_m)

    def visibility(self, low_agl_m: float, high_agl_m: float, min_share: float = 0.0) -> Visibility:
        """Return what is seen of objects whose heights above the ground are uniform between two.

        A share below `min_share` counts as that: objects may be higher than supposed. At the edge of a shadow
        the least share of the neighbouring cells counts, but not none: the elevation model is not exact.
        """
        above_m = high_agl_m - self.shadow_agl_m
        share = above_m >= 0.0 if high_agl_m <= low_agl_m else above_m / (high_agl_m - low_agl_m)
        share = np.clip(share, 0.0, 1.0).astype(np.float32)
        values = np.minimum(share, np.maximum(_least_of_neighbours(share), _EDGE_SHARE))
        values = np.maximum(values, np.float32(min_share))
        return Visibility(self.east_m, self.north_m, self.range_step_m, values)


def _least_of_neighbours(share: Float32Array) -> Float32Array:
    """Return the least of each cell and its eight neighbours."""
    along = np.minimum(share, np.minimum(np.roll(share, 1, axis=0), np.roll(share, -1, axis=0)))
    least = along.copy()
    np.minimum(least[:, 1:], along[:, :-1], out=least[:, 1:])
    np.minimum(least[:, :-1], along[:, 1:], out=least[:, :-1])
    return least


def visible_share(visibility: Visibility, points_m: FloatArray) -> FloatArray:
    """Return the share (k,) of an object's heights that is in sight at places (k, 2)."""
    return _nearest(
        visibility.east_m, visibility.north_m, visibility.range_step_m, visibility.share, points_m
    )


def line_of_sight(
    elevation: Elevation, place_m: tuple[float, float], alt_msl_m: float, reach_m: float
) -> LineOfSight:
    """Return the shadows within `reach_m` of a place at a height."""
    step_m = max(elevation.spacing_m, reach_m / (_MAX_RANGES - 1))
    n_ranges = min(math.ceil(reach_m / step_m) + 1, _MAX_RANGES)
    n_bearings = min(max(math.ceil(2.0 * math.pi * reach_m / step_m), 8), _MAX_BEARINGS)
    shadow = np.zeros((n_bearings, n_ranges), np.float32)
    _fill_shadows(
        elevation.heights_msl_m,
        np.array([(place_m[i] - elevation.origin_m[i]) / elevation.spacing_m for i in range(2)]),
        float(alt_msl_m),
        float(elevation.spacing_m),
        float(step_m),
        math.ceil(step_m / elevation.spacing_m - 1e-9),
        shadow,
    )
    shadow.flags.writeable = False
    return LineOfSight(*place_m, step_m, shadow)


def _nearest(
    east_m: float, north_m: float, step_m: float, values: Float32Array, points_m: FloatArray
) -> FloatArray:
    """Return the values (k,) of a table of bearings and ranges that are nearest to places (k, 2)."""
    n_bearings, n_ranges = values.shape
    x, y = (np.asarray(points_m, dtype=np.float64) - (east_m, north_m)).T
    ranges = np.minimum(np.rint(np.hypot(x, y) / step_m), n_ranges - 1).astype(np.intp)
    bearings = np.rint(np.arctan2(x, y) * (n_bearings / (2.0 * math.pi))).astype(np.intp) % n_bearings
    return np.asarray(values[bearings, ranges], dtype=np.float64)


@kernel
def _fill_shadows(
    heights: FloatArray,
    place: FloatArray,
    alt_msl_m: float,
    spacing_m: float,
    step_m: float,
    reads: int,
    shadow: Float32Array,
) -> None:
    """Fill `shadow`; `place` is in nodes, and the ground is read `reads` times in each step."""
    rows, cols = heights.shape
    n_bearings, n_ranges = shadow.shape
    for b in range(n_bearings):
        bearing = 2.0 * math.pi * b / n_bearings
        east = math.sin(bearing) / spacing_m
        north = math.cos(bearing) / spacing_m
        horizon = -np.inf
        for k in range(1, (n_ranges - 1) * reads + 1):
            r = k * step_m / reads
            x = place[0] + r * east
            y = place[1] + r * north
            if not (x >= 0.0 and x <= cols - 1 and y >= 0.0 and y <= rows - 1):
                continue
            col = min(int(x), cols - 2)
            row = min(int(y), rows - 2)
            along = x - col
            up = y - row
            south = (1.0 - along) * heights[row, col] + along * heights[row, col + 1]
            ahead = (1.0 - along) * heights[row + 1, col] + along * heights[row + 1, col + 1]
            ground = (1.0 - up) * south + up * ahead
            if k % reads == 0:
                shadow[b, k // reads] = max(alt_msl_m + horizon * r - ground, 0.0)
            horizon = max(horizon, (ground - alt_msl_m) / r)


def warm_up_calls() -> list[Call]:
    """Return one call of the kernel."""
    shadow = np.zeros((8, 2), np.float32)
    return [(_fill_shadows, read_only(np.zeros((2, 2))), np.zeros(2), 1.0, 1.0, 1.0, 1, shadow)]
