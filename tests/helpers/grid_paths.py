"""Paths and distances between nodes of a grid, for tests and benches of the searches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.model import FloatArray, IntArray
from gcs.planning.map.grid import Grid, Node
from gcs.planning.search.grid_search import borrow_search
from gcs.planning.search.neighbours import flat_index, search_map

_NOTHING = np.zeros(1)
"""Distance of a node from the grid: zero."""


@dataclass(frozen=True, eq=False)
class GridPath:
    """Path from node to node.

    Attributes
    ----------
    nodes : ndarray of int, shape (k, 2)
        (row, col), both ends included. An end inside an obstacle is replaced by `nearest_free`.
    length_m : float
        Length along the nodes.
    expanded : int
        Number of expanded nodes: the work, independent of the machine.
    """

    nodes: IntArray
    length_m: float
    expanded: int


def find_path(grid: Grid, start: Node, goal: Node, clearance_m: float = 0.0) -> GridPath | None:
    """Search one path with A*; None without a path.

    A start or goal inside an obstacle is replaced by its `nearest_free` node.
    """
    ends = [end if not grid.blocked[end] else nearest_free(grid, end) for end in (start, goal)]
    if ends[0] is None or ends[1] is None:
        return None
    smap = search_map(grid, clearance_m)
    first, last = (flat_index(smap, end) for end in (ends[0], ends[1]))
    if smap.component[first] != smap.component[last]:
        return None
    with borrow_search(grid, clearance_m) as search:
        path, _, length, expanded = search.path(np.array([first]), _NOTHING, np.array([last]), _NOTHING)
    nodes = np.empty((len(path), 2), dtype=np.int64)
    np.divmod(path, smap.stride, out=(nodes[:, 0], nodes[:, 1]))
    nodes -= 1
    return GridPath(nodes, length * grid.spacing_m, int(expanded))


def distances_m(grid: Grid, source: Node) -> FloatArray:
    """Return the exact shortest path length from one node to all, (rows, cols); inf without a path.

    A source inside an obstacle reaches nothing.
    """
    smap = search_map(grid)
    rows, cols = grid.shape
    node = -1 if grid.blocked[source] else flat_index(smap, source)
    field = np.empty(smap.moves.size)
    with borrow_search(grid) as search:
        came = np.empty(smap.moves.size, dtype=np.uint8)
        search.one_to_all(np.array([node]), _NOTHING, np.empty(0, dtype=np.int64), field, came)
    field *= grid.spacing_m
    return field.reshape(rows + 2, cols + 2)[1:-1, 1:-1]


def nearest_free(grid: Grid, node: Node) -> Node | None:
    """Return the free node nearest to one inside an obstacle, None on a map without any.

    Nearest in a straight line, within the largest connected component: an enclosed pocket leads nowhere. Ties
    go to the lowest row, then the lowest column.
    """
    rows, cols = grid.shape
    largest_component = search_map(grid).largest_component.reshape(rows + 2, cols + 2)[1:-1, 1:-1]
    free = np.argwhere(largest_component)
    if not len(free):
        return None
    row, col = free[int(np.argmin(((free - np.array(node)) ** 2).sum(axis=1)))]
    return int(row), int(col)
