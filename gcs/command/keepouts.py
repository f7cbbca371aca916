"""Areas that an operator closes while the mission flies: discs and polygons on top of the mission's map.

An area blocks every cell of the grid that it overlaps, as the map's own obstacles do.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from gcs.model import KeepOut
from gcs.planning.grid import Grid, Point

_MAX_AREAS = 100


class KeepOuts:
    """The closed areas and the grid with them.

    Parameters
    ----------
    grid : Grid
        The mission's own map.
    """

    def __init__(self, grid: Grid) -> None:
        self.areas: dict[str, KeepOut] = {}
        self.grid = grid
        self._open = grid

    def refusal(self, area: KeepOut) -> str:
        """Say why an area cannot be taken; empty when it can."""
        if area.disc_m is None and not area.polygon_m:
            known = ", ".join(self.areas) or "none"
            return "" if area.name in self.areas else f"no keep-out is called {area.name}; there are: {known}"
        if area.name not in self.areas and len(self.areas) >= _MAX_AREAS:
            return f"there are {_MAX_AREAS} keep-outs already; open some first"
        return "" if closed_cells(self._open, area).any() else "it lies outside the map"

    def take(self, area: KeepOut) -> Grid:
        """Close or open an area; return the grid of what is newly blocked."""
        before = self.grid
        self.areas.pop(area.name, None)
        if area.disc_m is not None or area.polygon_m:
            self.areas[area.name] = area
        blocked = self._open.blocked
        for one in self.areas.values():
            blocked = blocked | closed_cells(self._open, one)
        self.grid = Grid(before.origin_m, before.spacing_m, blocked)
        return Grid(before.origin_m, before.spacing_m, blocked & ~before.blocked)


def closed_cells(grid: Grid, area: KeepOut) -> npt.NDArray[np.bool_]:
    """Cells of a grid that an area overlaps, (rows, cols)."""
    free = Grid(grid.origin_m, grid.spacing_m, np.zeros(grid.shape, dtype=np.bool_))
    if area.disc_m is not None:
        return free.with_obstacles(discs_m=[area.disc_m]).blocked
    return _polygon_cells(free, area.polygon_m)


def _polygon_cells(grid: Grid, corners_m: Iterable[Point]) -> npt.NDArray[np.bool_]:
    """Cells whose centre lies inside (even-odd rule), and those that an edge passes through."""
    cells = np.zeros(grid.shape, dtype=np.bool_)
    corners = (np.asarray(list(corners_m), dtype=np.float64).reshape(-1, 2) - grid.origin_m) / grid.spacing_m
    rows, cols = np.arange(grid.shape[0])[:, np.newaxis], np.arange(grid.shape[1])[np.newaxis, :]
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 != y1:
            crosses = (rows >= min(y0, y1)) & (rows < max(y0, y1))
            cells ^= crosses & (cols < x0 + (rows - y0) * (x1 - x0) / (y1 - y0))
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        low_row, high_row = _span(y0, y1, grid.shape[0])
        low_col, high_col = _span(x0, x1, grid.shape[1])
        part = _passed(rows[low_row:high_row], cols[:, low_col:high_col], x0, y0, x1, y1)
        cells[low_row:high_row, low_col:high_col] |= part
    return cells


def _span(a: float, b: float, size: int) -> tuple[int, int]:
    """First and last + 1 of the cells between two places along an axis."""
    low, high = math.floor(min(a, b) + 0.5), math.floor(max(a, b) + 0.5) + 1
    return min(max(low, 0), size), min(max(high, 0), size)


def _passed(
    rows: npt.NDArray[np.int_], cols: npt.NDArray[np.int_], x0: float, y0: float, x1: float, y1: float
) -> npt.NDArray[np.bool_]:
    """Cells of a window that a leg meets: it is not beside the cell (within the leg's bounding box)."""
    dx, dy = x1 - x0, y1 - y0
    beside = np.abs((cols - x0) * dy - (rows - y0) * dx)
    return np.asarray(beside <= 0.5 * (abs(dx) + abs(dy)))
