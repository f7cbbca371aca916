"""The obstacle map: square cells around the nodes of a search grid.

Source: Hill, Thomas & Larson, "Swarm Mission Planning" and "Simulation Description": a mesh of 51 x 51 nodes
over 2000 m x 2000 m, with blocked nodes. Here each node has a cell of side ``spacing_m`` centred on it. A
blocked node blocks its whole cell, so collision tests are exact for any leg, not for nodes alone.

Node (row, col) counts rows north and columns east. Node (0, 0) lies at ``origin_m``. Outside the map nothing
is blocked, but no waypoint lies there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy import ndimage

from gcs.model import BoolArray, FloatArray
from gcs.planning.map.rasterize import cover

Node: TypeAlias = tuple[int, int]
"""(row north, column east)."""

Point: TypeAlias = tuple[float, float]
"""(east_m, north_m)."""

Polygon: TypeAlias = Sequence[Sequence[Sequence[float]]]
"""Rings of corners (east_m, north_m): the outline first, then the holes."""


TOUCH = 1e-9
"""In cells: a leg within this distance of a blocked cell touches it. Clearances are kept up to this."""


@dataclass(frozen=True, eq=False)
class Grid:
    """A map of blocked and free cells.

    Attributes
    ----------
    origin_m : tuple of float
        East and north of node (0, 0).
    spacing_m : float
        Distance of neighbouring nodes, east and north alike.
    blocked : ndarray of bool, shape (rows north, cols east)
        Read-only.

    Raises
    ------
    ValueError
        For a map without nodes or a spacing that is not a positive number.
    """

    origin_m: Point
    spacing_m: float
    blocked: BoolArray

    def __post_init__(self) -> None:
        blocked = np.array(self.blocked, dtype=np.bool_, order="C")
        if blocked.ndim != 2 or blocked.size == 0:
            raise ValueError(
                f"blocked must be a (rows, cols) array with at least one node, not {blocked.shape}"
            )
        if not (math.isfinite(self.spacing_m) and self.spacing_m > 0.0):
            raise ValueError(f"spacing_m must be a positive number, not {self.spacing_m}")
        blocked.flags.writeable = False
        object.__setattr__(self, "blocked", blocked)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows north, cols east)."""
        rows, cols = self.blocked.shape
        return rows, cols

    def node_of(self, point_m: Point) -> Node:
        """Return the node whose cell contains a point; for a point outside the map, the nearest node."""
        rows, cols = self.shape
        col = math.floor((point_m[0] - self.origin_m[0]) / self.spacing_m + 0.5)
        row = math.floor((point_m[1] - self.origin_m[1]) / self.spacing_m + 0.5)
        return min(max(row, 0), rows - 1), min(max(col, 0), cols - 1)

    def point_of(self, node: Node) -> Point:
        """Return the position of a node, in metres."""
        row, col = node
        return self.origin_m[0] + col * self.spacing_m, self.origin_m[1] + row * self.spacing_m

    def contains(self, point_m: Point, margin_m: float = 0.0) -> bool:
        """Return True if a point lies in a cell of the map, or no farther than `margin_m` from one."""
        return math.dist(point_m, self.nearest_inside(point_m)) <= margin_m

    def is_free(self, point_m: Point) -> bool:
        """Return True if a point lies in a free cell of the map."""
        on_map = self.contains(point_m, TOUCH * self.spacing_m)
        return on_map and not self.blocked[self.node_of(point_m)]

    def nearest_inside(self, point_m: Point) -> Point:
        """Return the point of the map that is nearest to a point."""
        (rows, cols) = self.shape
        half_m = 0.5 * self.spacing_m
        (west, south) = self.origin_m
        east_m = min(max(point_m[0], west - half_m), west + cols * self.spacing_m - half_m)
        north_m = min(max(point_m[1], south - half_m), south + rows * self.spacing_m - half_m)
        return east_m, north_m

    def with_obstacles(
        self,
        discs_m: Iterable[Sequence[float]] = (),
        boxes_m: Iterable[Sequence[float]] = (),
        cells: Iterable[Node] = (),
        polygons_m: Iterable[Polygon] = (),
    ) -> Grid:
        """Return this map with more obstacles.

        Discs (east, north, radius), boxes (east_min, north_min, east_max, north_max) and polygons block every
        cell that they overlap, even one that they lie within.
        """
        blocked = self.blocked.copy()
        rows, cols = self.shape
        east = self.origin_m[0] + self.spacing_m * np.arange(cols)[np.newaxis, :]
        north = self.origin_m[1] + self.spacing_m * np.arange(rows)[:, np.newaxis]
        half = self.spacing_m / 2.0
        touch = TOUCH * self.spacing_m
        for x, y, radius in discs_m:
            gap = np.hypot(
                np.maximum(np.abs(east - x) - half, 0.0), np.maximum(np.abs(north - y) - half, 0.0)
            )
            blocked |= gap < max(radius - touch, touch)
        for west, south, far_east, far_north in boxes_m:
            over_east = (east - half < far_east - touch) & (east + half > west + touch)
            over_north = (north - half < far_north - touch) & (north + half > south + touch)
            blocked |= over_east & over_north
        for row, col in cells:
            blocked[row, col] = True
        for polygon in polygons_m:
            passed, inside = cover(self.shape, self._rings(polygon))
            blocked |= passed | inside
        return Grid(self.origin_m, self.spacing_m, blocked)

    def within(self, polygons_m: Iterable[Polygon]) -> Grid:
        """Return this map with every cell blocked that is not entirely inside one of the polygons."""
        outside = np.ones(self.shape, dtype=np.bool_)
        for polygon in polygons_m:
            passed, inside = cover(self.shape, self._rings(polygon))
            outside &= passed | ~inside
        return Grid(self.origin_m, self.spacing_m, self.blocked | outside)

    def _rings(self, polygon_m: Polygon) -> list[FloatArray]:
        """Return rings in cells."""
        return [(np.asarray(ring, dtype=np.float64) - self.origin_m) / self.spacing_m for ring in polygon_m]

    def inflate(self, clearance_m: float) -> Grid:
        """Return this map with every node blocked that is nearer than `clearance_m` to a blocked cell.

        A node next to a blocked cell is half a spacing away from it. Straight moves on the inflated map keep
        the clearance exactly. Diagonal moves may come nearer by up to a ninth, if it exceeds 1.4 spacings.
        """
        if clearance_m <= 0.0 or not self.blocked.any():
            return self
        reach = min(clearance_m / self.spacing_m, 2.0 * max(self.shape))
        steps = np.arange(-math.ceil(reach + 0.5), math.ceil(reach + 0.5) + 1)
        gap = np.maximum(np.abs(steps) - 0.5, 0.0)
        near = np.hypot(gap[:, np.newaxis], gap[np.newaxis, :]) < reach - TOUCH
        near[len(steps) // 2, len(steps) // 2] = True
        return Grid(self.origin_m, self.spacing_m, ndimage.binary_dilation(self.blocked, structure=near))


def free_grid(shape: tuple[int, int], spacing_m: float, origin_m: Point = (0.0, 0.0)) -> Grid:
    """Return a map of (rows, cols) nodes without obstacles."""
    return Grid(origin_m, spacing_m, np.zeros(shape, dtype=np.bool_))


def free_grid_like(grid: Grid) -> Grid:
    """Return a map of the same nodes without obstacles."""
    return free_grid(grid.shape, grid.spacing_m, grid.origin_m)


def random_obstacles(
    grid: Grid,
    threshold: float,
    rng: np.random.Generator,
    keep_clear: Iterable[Point] = (),
    keep_clear_m: float = 0.0,
) -> Grid:
    """Return a map with the random obstacles of the paper.

    A node is blocked if its uniform random number is below the threshold.

    One number is drawn for each node, row by row, so a seed always gives the same map. Nodes within
    `keep_clear_m` of a point in `keep_clear` get no random obstacle.
    """
    rows, cols = grid.shape
    drawn = rng.random((rows, cols)) < threshold
    east = grid.origin_m[0] + grid.spacing_m * np.arange(cols)[np.newaxis, :]
    north = grid.origin_m[1] + grid.spacing_m * np.arange(rows)[:, np.newaxis]
    for x, y in keep_clear:
        drawn &= np.hypot(east - x, north - y) > keep_clear_m
    return Grid(grid.origin_m, grid.spacing_m, grid.blocked | drawn)
