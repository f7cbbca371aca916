"""Distances from a grid node to all others along shortest paths, and the free node nearest to one."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from gcs.model import FloatArray
from gcs.planning.map.grid import Grid, Node
from gcs.planning.search.grid_search import borrow_search
from gcs.planning.search.neighbours import flat_index, search_map

SearchCost: TypeAlias = Literal["metric", "paper"]

_NOTHING = np.zeros(1)
"""Distance of a node from the grid: zero."""


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
