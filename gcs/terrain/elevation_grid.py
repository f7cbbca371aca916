"""Elevation of the ground as a grid of the local frame, read bilinearly.

Node (row, col) counts rows north and columns east, as in `gcs.planning.map.grid`. Heights are above mean sea
level: of the geoid, as autopilots report and fly them. The Earth's curvature is left out: the local frame is
a plane, and heights are not measured from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.model import FloatArray


@dataclass(frozen=True, eq=False)
class Elevation:
    """Elevation of the ground.

    Attributes
    ----------
    origin_m : tuple of float
        East and north of node (0, 0).
    spacing_m : float
        Distance of neighbouring nodes, east and north alike.
    heights_msl_m : ndarray, shape (rows north, cols east)
        Height above mean sea level of each node. Read-only, finite.

    Raises
    ------
    ValueError
        For fewer than two rows or columns, a spacing that is not a positive number, or a height that is not
        finite.
    """

    origin_m: tuple[float, float]
    spacing_m: float
    heights_msl_m: FloatArray

    def __post_init__(self) -> None:
        heights = np.array(self.heights_msl_m, dtype=np.float64, order="C")
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise ValueError(
                f"heights_msl_m must be a (rows, cols) array of at least 2 x 2 nodes, not {heights.shape}"
            )
        if not np.isfinite(heights).all():
            raise ValueError("heights_msl_m must be finite")
        if not (math.isfinite(self.spacing_m) and self.spacing_m > 0.0):
            raise ValueError(f"spacing_m must be a positive number, not {self.spacing_m}")
        heights.flags.writeable = False
        object.__setattr__(self, "heights_msl_m", heights)

    def height_msl_m(self, east_m: float, north_m: float) -> float:
        """Return the height of the ground at a place; NaN outside the nodes."""
        return float(self.heights_at(np.array([[east_m, north_m]]))[0])

    def coarser(self, max_nodes: int) -> Elevation:
        """Return the same ground with at most so many nodes, for pictures; itself if it has no more."""
        rows, cols = self.heights_msl_m.shape
        if rows * cols <= max_nodes:
            return self
        every = math.sqrt((rows - 1) * (cols - 1) / max_nodes) * 1.01
        ups, alongs = (np.arange(0.0, count - 1, every) * self.spacing_m for count in (rows, cols))
        east_m, north_m = np.meshgrid(self.origin_m[0] + alongs, self.origin_m[1] + ups)
        heights_msl_m = self.heights_at(np.column_stack((east_m.ravel(), north_m.ravel())))
        return Elevation(self.origin_m, every * self.spacing_m, heights_msl_m.reshape(east_m.shape))

    def heights_at(self, points_m: FloatArray) -> FloatArray:
        """Return the height of the ground at places, bilinear between the four nodes around each.

        Parameters
        ----------
        points_m : ndarray, shape (k, 2)
            East and north.

        Returns
        -------
        ndarray, shape (k,)
            Above mean sea level; NaN outside the nodes.
        """
        rows, cols = self.heights_msl_m.shape
        x, y = ((np.asarray(points_m, dtype=np.float64) - self.origin_m) / self.spacing_m).T
        is_inside = (x >= 0.0) & (x <= cols - 1) & (y >= 0.0) & (y <= rows - 1)
        x = np.where(is_inside, x, 0.0)
        y = np.where(is_inside, y, 0.0)
        col = np.minimum(x.astype(np.intp), cols - 2)
        row = np.minimum(y.astype(np.intp), rows - 2)
        along = x - col
        up = y - row
        z = self.heights_msl_m
        south = (1.0 - along) * z[row, col] + along * z[row, col + 1]
        north = (1.0 - along) * z[row + 1, col] + along * z[row + 1, col + 1]
        return np.where(is_inside, (1.0 - up) * south + up * north, np.nan)
