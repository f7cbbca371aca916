"""Areas with vertical limits on a map of cells."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from gcs.model import FloatArray, IntArray, VerticalLimits
from gcs.planning.map.grid import Grid


@dataclass(frozen=True, eq=False)
class LimitedArea:
    """Cells of a map that an area with vertical limits covers."""

    cells: IntArray
    """Flat indices."""
    limits: VerticalLimits

    def centres_m(self, grid: Grid) -> FloatArray:
        """Return the centres of the cells on their map, shape (k, 2): east and north."""
        rows, cols = np.unravel_index(self.cells, grid.shape)
        return np.column_stack((cols, rows)) * grid.spacing_m + np.array(grid.origin_m)


def blocked_by(grid: Grid, areas: Iterable[LimitedArea]) -> Grid:
    """Return a map with the cells of areas blocked; the same one without areas."""
    areas = list(areas)
    if not areas:
        return grid
    blocked = grid.blocked.copy()
    for area in areas:
        blocked.flat[area.cells] = True
    return replace(grid, blocked=blocked)
