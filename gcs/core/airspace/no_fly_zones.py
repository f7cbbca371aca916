"""No-fly zones: discs and polygons that an operator closes in flight.

A zone blocks every grid cell that it overlaps, like an obstacle of the map.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gcs.model import NoFlyZone
from gcs.planning.map.grid import Grid

_MAX_ZONES = 100


class NoFlyZones:
    """Closed zones, and the map with them.

    Attributes
    ----------
    areas : dict of str to NoFlyZone
        Closed zones by name.
    closed : dict of str to Grid
        Cells that each zone blocks.
    grid : Grid
        The current map.
    """

    def __init__(self, grid: Grid) -> None:
        self.areas: dict[str, NoFlyZone] = {}
        self.closed: dict[str, Grid] = {}
        self.grid = grid
        self._open = grid

    def refusal(self, zone: NoFlyZone) -> str:
        """Return why a zone cannot be closed or opened; empty if it can."""
        if zone.disc_m is None and not zone.polygon_m:
            if zone.name in self.areas:
                return ""
            return f"no no-fly zone is called {zone.name}; there are: {', '.join(self.areas) or 'none'}"
        if zone.name not in self.areas and len(self.areas) >= _MAX_ZONES:
            return f"there are {_MAX_ZONES} no-fly zones already; open some first"
        return "" if closed_cells(self._open, zone).any() else "it lies outside the map"

    def change(self, zone: NoFlyZone) -> Grid:
        """Close or open a zone; return the cells that are newly blocked."""
        before = self.grid
        self.areas.pop(zone.name, None)
        self.closed.pop(zone.name, None)
        if zone.disc_m is not None or zone.polygon_m:
            self.areas[zone.name] = zone
            cells = closed_cells(self._open, zone)
            self.closed[zone.name] = Grid(before.origin_m, before.spacing_m, cells)
        blocked = self._open.blocked
        for one in self.closed.values():
            blocked = blocked | one.blocked
        self.grid = Grid(before.origin_m, before.spacing_m, blocked)
        return Grid(before.origin_m, before.spacing_m, blocked & ~before.blocked)


def closed_cells(grid: Grid, zone: NoFlyZone) -> npt.NDArray[np.bool_]:
    """Return a mask of the cells that a zone overlaps, (rows, cols)."""
    free = Grid(grid.origin_m, grid.spacing_m, np.zeros(grid.shape, dtype=np.bool_))
    if zone.disc_m is not None:
        return free.with_obstacles(discs_m=[zone.disc_m]).blocked
    return free.with_obstacles(polygons_m=[[zone.polygon_m]]).blocked
