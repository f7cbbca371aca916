"""Areas with vertical limits on a map of cells."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from gcs.model import IntArray, VerticalLimits
from gcs.planning.map.grid import Grid


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
