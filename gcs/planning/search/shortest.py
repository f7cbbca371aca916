"""Shortest ways between nodes of a grid: one path, or the distances to all.

The searches themselves are kernels: `gcs.planning.search.astar` for one path, `gcs.planning.search.dijkstra`
for one to all, on what `gcs.planning.search.neighbours` makes of a grid. `gcs.planning.search.cost_matrix`
finds the ways of all pairs of two sets of places.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from gcs.model import FloatArray
from gcs.planning.map.grid import Grid, Node
from gcs.planning.search.astar import seek_paper, seeker
from gcs.planning.search.canonical_ordering import DIAGONAL, IntArray
from gcs.planning.search.neighbours import flat_index, search_map

SearchCost: TypeAlias = Literal["metric", "paper"]

_NOTHING = np.zeros(1)
"""How far off the map's nodes a node lies."""


@dataclass(frozen=True, eq=False)
class GridPath:
    """A path from node to node.

    Attributes
    ----------
    nodes : ndarray of int, shape (k, 2)
        (row, col), both ends included. An end that lay inside an obstacle is replaced by `nearest_free`.
    length_m : float
        Length flown along the nodes, whatever the cost that was searched for.
    expanded : int
        How many nodes the search looked at: what it cost, independent of the machine.
    """

    nodes: IntArray
    length_m: float
    expanded: int


def find_path(
    grid: Grid, start: Node, goal: Node, cost: SearchCost = "metric", clearance_m: float = 0.0
) -> GridPath | None:
    """Search one path with A*; None if there is no way.

    A start or goal inside an obstacle is replaced by its `nearest_free` node.
    """
    ends = [end if not grid.blocked[end] else nearest_free(grid, end) for end in (start, goal)]
    if ends[0] is None or ends[1] is None:
        return None
    smap = search_map(grid, clearance_m)
    first, last = (flat_index(smap, end) for end in (ends[0], ends[1]))
    if smap.part[first] != smap.part[last]:
        return None
    if cost == "paper":
        path = np.empty(smap.moves.size, dtype=np.int64)
        count, expanded = seek_paper(smap.moves, smap.near, smap.offsets, smap.stride, first, last, path)
        path = path[:count][::-1]
        diagonal = np.isin(np.diff(path), smap.offsets[4:]).sum()
        length = count - 1 + (DIAGONAL - 1.0) * float(diagonal)
    else:
        with seeker(grid, clearance_m) as search:
            path, _, length, expanded = search.path(np.array([first]), _NOTHING, np.array([last]), _NOTHING)
    nodes = np.empty((len(path), 2), dtype=np.int64)
    np.divmod(path, smap.stride, out=(nodes[:, 0], nodes[:, 1]))
    nodes -= 1
    return GridPath(nodes, length * grid.spacing_m, int(expanded))


def distances_m(grid: Grid, source: Node) -> FloatArray:
    """Return the exact shortest path length from one node to all, (rows, cols); inf where no way leads.

    A source inside an obstacle reaches nothing.
    """
    smap = search_map(grid)
    rows, cols = grid.shape
    node = -1 if grid.blocked[source] else flat_index(smap, source)
    field = np.empty(smap.moves.size)
    with seeker(grid) as search:
        came = np.empty(smap.moves.size, dtype=np.uint8)
        search.spread(np.array([node]), _NOTHING, np.empty(0, dtype=np.int64), field, came)
    field *= grid.spacing_m
    return field.reshape(rows + 2, cols + 2)[1:-1, 1:-1]


def nearest_free(grid: Grid, node: Node) -> Node | None:
    """Return the free node nearest to one inside an obstacle, None on a map without any.

    Nearest in a straight line, among the nodes of the largest connected part of the map (a pocket enclosed by
    obstacles leads nowhere); of equally near ones the lowest row, then the lowest column.
    """
    rows, cols = grid.shape
    mainland = search_map(grid).mainland.reshape(rows + 2, cols + 2)[1:-1, 1:-1]
    free = np.argwhere(mainland)
    if not len(free):
        return None
    row, col = free[int(np.argmin(((free - np.array(node)) ** 2).sum(axis=1)))]
    return int(row), int(col)
