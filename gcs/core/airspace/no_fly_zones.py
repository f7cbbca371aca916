"""Areas that an operator closes while the mission flies: discs and polygons on top of the mission's map.

An area blocks every cell of the grid that it overlaps, as the map's own obstacles do.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gcs.model import NoFlyZone
from gcs.planning.map.grid import Grid

_MAX_AREAS = 100


class NoFlyZones:
    """The closed areas and the grid with them.

    Parameters
    ----------
    grid : Grid
        The mission's own map.
    """

    def __init__(self, grid: Grid) -> None:
        self.areas: dict[str, NoFlyZone] = {}
        self.closed: dict[str, Grid] = {}
        """What each area blocks."""
        self.grid = grid
        self._open = grid

    def refusal(self, area: NoFlyZone) -> str:
        """Say why an area cannot be taken; empty when it can."""
        if area.disc_m is None and not area.polygon_m:
            if area.name in self.areas:
                return ""
            return f"no no-fly zone is called {area.name}; there are: {', '.join(self.areas) or 'none'}"
        if area.name not in self.areas and len(self.areas) >= _MAX_AREAS:
            return f"there are {_MAX_AREAS} no-fly zones already; open some first"
        return "" if closed_cells(self._open, area).any() else "it lies outside the map"

    def take(self, area: NoFlyZone) -> Grid:
        """Close or open an area; return the grid of what is newly blocked."""
        before = self.grid
        self.areas.pop(area.name, None)
        self.closed.pop(area.name, None)
        if area.disc_m is not None or area.polygon_m:
            self.areas[area.name] = area
            cells = closed_cells(self._open, area)
            self.closed[area.name] = Grid(before.origin_m, before.spacing_m, cells)
        blocked = self._open.blocked
        for one in self.closed.values():
            blocked = blocked | one.blocked
        self.grid = Grid(before.origin_m, before.spacing_m, blocked)
        return Grid(before.origin_m, before.spacing_m, blocked & ~before.blocked)


def closed_cells(grid: Grid, area: NoFlyZone) -> npt.NDArray[np.bool_]:
    """Cells of a grid that an area overlaps, (rows, cols)."""
    free = Grid(grid.origin_m, grid.spacing_m, np.zeros(grid.shape, dtype=np.bool_))
    if area.disc_m is not None:
        return free.with_obstacles(discs_m=[area.disc_m]).blocked
    return free.with_obstacles(polygons_m=[[area.polygon_m]]).blocked
