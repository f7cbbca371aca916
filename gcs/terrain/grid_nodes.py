"""Nodes of an elevation model in the local frame, and the cut of those without heights."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from gcs.model import FloatArray

MAX_NODES: Final = 4_000_000
"""Greatest number of nodes: finer files give fewer, mission files with more are refused."""
_TILE: Final = 256


@dataclass(frozen=True, slots=True)
class Nodes:
    """Nodes of the local frame: rows and columns from `first` up to `end`, counted from the origin."""

    spacing_m: float
    first: tuple[int, int]
    end: tuple[int, int]

    @classmethod
    def around(cls, size_m: tuple[float, float], margin_m: float, spacing_m: float) -> Nodes:
        """Return the nodes of an area (east, north) from the origin, with a margin."""
        first = math.floor(-margin_m / spacing_m)
        end = [math.ceil((size + margin_m) / spacing_m) + 1 for size in size_m]
        return cls(spacing_m, (first, first), (end[1], end[0]))

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.end[0] - self.first[0], self.end[1] - self.first[1]

    @property
    def count(self) -> int:
        """Number of nodes."""
        return self.shape[0] * self.shape[1]

    def within(self, outer: Nodes) -> tuple[slice, slice]:
        """Return where these nodes are in the array of others."""
        row, col = (own - other for own, other in zip(self.first, outer.first, strict=True))
        return slice(row, row + self.shape[0]), slice(col, col + self.shape[1])

    def tiles(self) -> Iterator[Nodes]:
        """Yield the nodes in squares."""
        for row in range(self.first[0], self.end[0], _TILE):
            for col in range(self.first[1], self.end[1], _TILE):
                end = min(row + _TILE, self.end[0]), min(col + _TILE, self.end[1])
                yield Nodes(self.spacing_m, (row, col), end)

    def places_m(self) -> tuple[FloatArray, FloatArray]:
        """Return east and north of each node."""
        rows = np.arange(self.first[0], self.end[0]) * self.spacing_m
        cols = np.arange(self.first[1], self.end[1]) * self.spacing_m
        north, east = np.meshgrid(rows, cols, indexing="ij")
        return east, north


def cut_margin(nodes: Nodes, heights: FloatArray, needed: Nodes) -> tuple[Nodes, FloatArray]:
    """Return the nodes without border rows and columns, until all that are left have heights.

    In turn the border with the most missing heights is cut. A hole within complete borders is cut off on the
    side where it is nearest. The nodes that are needed have heights, and stay.
    """
    rows, cols = needed.within(nodes)
    has_height = np.isfinite(heights)
    south = 0
    west = 0
    north, east = heights.shape
    while not (inner := has_height[south:north, west:east]).all():
        missing = {
            "south": _missing(inner[0], allowed=south < rows.start),
            "north": _missing(inner[-1], allowed=north > rows.stop),
            "west": _missing(inner[:, 0], allowed=west < cols.start),
            "east": _missing(inner[:, -1], allowed=east > cols.stop),
        }
        side = max(missing, key=lambda name: missing[name])
        depth = 1
        if missing[side] <= 0.0:
            row, col = np.argwhere(~inner)[0].tolist()
            depths = {
                "south": row + 1 if south + row < rows.start else math.inf,
                "north": north - south - row if south + row >= rows.stop else math.inf,
                "west": col + 1 if west + col < cols.start else math.inf,
                "east": east - west - col if west + col >= cols.stop else math.inf,
            }
            side = min(depths, key=lambda name: depths[name])
            depth = int(depths[side])
        south += depth * (side == "south")
        north -= depth * (side == "north")
        west += depth * (side == "west")
        east -= depth * (side == "east")
    first = nodes.first[0] + south, nodes.first[1] + west
    end = nodes.first[0] + north, nodes.first[1] + east
    return Nodes(nodes.spacing_m, first, end), heights[south:north, west:east]


def _missing(border: npt.NDArray[np.bool_], *, allowed: bool) -> float:
    """Return the share of a border without heights; -1 for one that must be kept."""
    return 1.0 - float(border.mean()) if allowed else -1.0
