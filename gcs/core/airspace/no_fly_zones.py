"""No-fly zones: discs and polygons that an operator closes in flight.

A zone blocks every grid cell that it overlaps, like an obstacle of the map.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs.core.airspace.records import AirspaceState
from gcs.model import BoolArray, NoFlyZone
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight


class NoFlyZones:
    """The map of the mission, `grid`, with the closed zones.

    Attributes
    ----------
    closed : dict of str to Grid
        Cells that each zone blocks.
    grid : Grid
        The current map.
    """

    def __init__(self, state: AirspaceState, grid: Grid) -> None:
        self._state = state
        self._open = grid
        self._draw()

    def _draw(self) -> None:
        grid = self._open
        self.closed = {
            name: replace(grid, blocked=closed_cells(grid, zone)) for name, zone in self._state.zones.items()
        }
        closed = [one.blocked for one in self.closed.values()]
        self.grid = replace(grid, blocked=np.logical_or.reduce([grid.blocked, *closed]))

    def contain(self, place: Point) -> bool:
        """Return True if a position is in a closed zone."""
        return not all(line_of_sight(closed, place, place) for closed in self.closed.values())

    def change(self, zone: NoFlyZone) -> Grid:
        """Close or open a zone; return the cells that are newly blocked."""
        before = self.grid
        self._state.zones.pop(zone.name, None)
        if zone.disc_m is not None or zone.polygon_m:
            self._state.zones[zone.name] = zone
        self._draw()
        return replace(before, blocked=self.grid.blocked & ~before.blocked)


def closed_cells(grid: Grid, zone: NoFlyZone) -> BoolArray:
    """Return a mask of the cells that a zone overlaps, (rows, cols)."""
    free = replace(grid, blocked=np.zeros(grid.shape, dtype=np.bool_))
    if zone.disc_m is not None:
        return free.with_obstacles(discs_m=[zone.disc_m]).blocked
    return free.with_obstacles(polygons_m=[[zone.polygon_m]]).blocked
