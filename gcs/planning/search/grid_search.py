"""Searches on one map: the kernels with their work arrays, lent to one caller at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

import numpy as np

from gcs.model import ByteArray, FloatArray, IntArray
from gcs.planning.map.grid import Grid
from gcs.planning.search.bucket_astar import bucket_astar
from gcs.planning.search.dijkstra import dijkstra_buffers, one_to_all
from gcs.planning.search.neighbours import SearchMap, search_map


@lru_cache(maxsize=4)
def _idle_searches(_grid: Grid, _clearance_m: float, _shifts_nodes: bool) -> list[GridSearch]:
    """Return the searches of a map that are not in use."""
    return []


@contextmanager
def borrow_search(grid: Grid, clearance_m: float = 0.0, shifts_nodes: bool = False) -> Iterator[GridSearch]:
    """Lend a search for a map and take it back. Thread-safe."""
    idle = _idle_searches(grid, clearance_m, shifts_nodes)
    try:
        lent = idle.pop()
    except IndexError:
        lent = GridSearch(search_map(grid, clearance_m, shifts_nodes))
    yield lent
    idle.append(lent)


class GridSearch:
    """Search kernels of one map with their work arrays.

    Allocation takes longer than most searches. One object runs one search at a time.
    """

    def __init__(self, smap: SearchMap) -> None:
        self._smap = smap
        size = smap.moves.size
        self._reached = np.zeros(size)
        self._packed = smap.packed.copy()
        self._entries = np.empty((2 * size, 2), dtype=np.int32)
        self._path = np.empty(size, dtype=np.int64)
        self._stack, self._edges = dijkstra_buffers(smap)

    def one_to_all(
        self, nodes: IntArray, costs: FloatArray, goals: IntArray, field: FloatArray, came_by: ByteArray
    ) -> None:
        """Search from one place to all nodes; see `gcs.planning.search.dijkstra`."""
        smap = self._smap
        one_to_all(
            smap.move_lists, smap.has_tight_moves, smap.offsets, nodes, costs, goals, field, came_by,
            self._packed, self._stack, self._edges,
        )  # fmt: skip

    def path(
        self, nodes: IntArray, costs: FloatArray, goals: IntArray, goal_costs: FloatArray
    ) -> tuple[IntArray, float, float, int]:
        """Return the nodes of a shortest path, and the other results of `bucket_astar`."""
        smap = self._smap
        count = -1
        while count < 0:
            count, cost, flown, expanded = bucket_astar(
                smap.move_lists, smap.has_tight_moves, smap.offsets, smap.stride, nodes, costs, goals,
                goal_costs, self._reached, self._packed, self._entries, self._path,
            )  # fmt: skip
            if count < 0:
                self._entries = np.empty((2 * len(self._entries), 2), dtype=np.int32)
        return self._path[:count][::-1].copy(), float(cost), float(flown), int(expanded)
