"""One path from node to node of a grid, for tests and benches of the two A* searches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.model import IntArray
from gcs.planning.map.grid import Grid, Node
from gcs.planning.search.astar import astar_paper
from gcs.planning.search.canonical_ordering import DIAGONAL
from gcs.planning.search.grid_search import borrow_search
from gcs.planning.search.neighbours import flat_index, search_map
from gcs.planning.search.shortest import SearchCost, nearest_free

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
        Length along the nodes, for any search cost.
    expanded : int
        Number of expanded nodes: the work, independent of the machine.
    """

    nodes: IntArray
    length_m: float
    expanded: int


def find_path(
    grid: Grid, start: Node, goal: Node, cost: SearchCost = "metric", clearance_m: float = 0.0
) -> GridPath | None:
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
    if cost == "paper":
        path = np.empty(smap.moves.size, dtype=np.int64)
        count, expanded = astar_paper(
            smap.moves, smap.tight_moves, smap.offsets, smap.stride, first, last, path
        )
        path = path[:count][::-1]
        diagonal = np.isin(np.diff(path), smap.offsets[4:]).sum()
        length = count - 1 + (DIAGONAL - 1.0) * float(diagonal)
    else:
        with borrow_search(grid, clearance_m) as search:
            path, _, length, expanded = search.path(np.array([first]), _NOTHING, np.array([last]), _NOTHING)
    nodes = np.empty((len(path), 2), dtype=np.int64)
    np.divmod(path, smap.stride, out=(nodes[:, 0], nodes[:, 1]))
    nodes -= 1
    return GridPath(nodes, length * grid.spacing_m, int(expanded))
