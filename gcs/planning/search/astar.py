"""A* on a heap from node to node (Hart, Nilsson & Raphael 1968), by the paper's cost.

The search expands the open node with the least estimate f = g + h: the cost so far plus a guess of the rest.
The paper's cost (Hill, Thomas & Larson) is the number of nodes traversed plus the Euclidean distance to the
goal, so a diagonal counts 1. The heuristic may overestimate. Paths may then be longer than the shortest, and
a node may be reopened. The result depends on the order among equal estimates: greatest g, then lowest index.

Shortest paths between places, with buckets in place of the heap: `gcs.planning.search.bucket_astar`.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import inlined, kernel
from gcs.model import ByteArray, FloatArray, IntArray
from gcs.planning.search.canonical_ordering import TIGHT_MOVE_COST

_COST_EPSILON = 1e-12
"""Improvements below this are rounding errors."""


@inlined
def _precedes(f: float, g: float, node: float, heap: FloatArray, i: int) -> bool:
    """Return True if an entry comes before another: least estimate, then greatest cost, then lowest index."""
    if f != heap[i, 0]:
        return f < heap[i, 0]
    if g != heap[i, 1]:
        return g > heap[i, 1]
    return node < heap[i, 2]


@inlined
def _set_entry(heap: FloatArray, i: int, f: float, g: float, node: float) -> None:
    heap[i, 0] = f
    heap[i, 1] = g
    heap[i, 2] = node


@inlined
def _push(heap: FloatArray, size: int, f: float, g: float, node: float) -> None:
    """Add an entry to a heap of `size`."""
    i = size
    while i > 0:
        up = (i - 1) >> 1
        if not _precedes(f, g, node, heap, up):
            break
        _set_entry(heap, i, heap[up, 0], heap[up, 1], heap[up, 2])
        i = up
    _set_entry(heap, i, f, g, node)


@inlined
def _pop_first(heap: FloatArray, size: int) -> None:
    """Remove the first entry of a heap of `size`."""
    last = size - 1
    f = heap[last, 0]
    g = heap[last, 1]
    node = heap[last, 2]
    i = 0
    child = 1
    while child < last:
        if child + 1 < last and _precedes(
            heap[child + 1, 0], heap[child + 1, 1], heap[child + 1, 2], heap, child
        ):
            child += 1
        if _precedes(f, g, node, heap, child):
            break
        _set_entry(heap, i, heap[child, 0], heap[child, 1], heap[child, 2])
        i = child
        child = 2 * child + 1
    _set_entry(heap, i, f, g, node)


@kernel
def astar_paper(
    moves: ByteArray, tight_moves: ByteArray, offsets: IntArray, stride: int, start: int, goal: int,
    path: IntArray,
) -> tuple[int, int]:  # fmt: skip
    """Search a path by the paper's cost from node to node, and write it to `path`, goal first.

    Returns the number of nodes written (0: no path) and of expanded nodes.
    """
    cost = np.empty(moves.size)
    came_by = np.empty(moves.size, np.int8)
    cost[:] = np.inf
    # The open set: estimated cost, cost so far, node. One may be reopened under the paper's cost, so this
    # size is a first guess and the heap grows.
    heap = np.empty((moves.size, 3))
    goal_row = goal // stride
    goal_col = goal % stride
    cost[start] = 0.0
    _set_entry(heap, 0, 0.0, 0.0, start)
    open_count = 1
    expanded = 0
    while open_count > 0:
        here = heap[0, 1]
        node = int(heap[0, 2])
        _pop_first(heap, open_count)
        open_count -= 1
        if here > cost[node]:
            continue
        if node == goal:
            break
        expanded += 1
        for move in range(8):
            if not (moves[node] >> move) & 1:
                continue
            there = node + offsets[move]
            step = TIGHT_MOVE_COST if (tight_moves[node] >> move) & 1 else 1.0
            if here + step >= cost[there] - _COST_EPSILON:
                continue
            cost[there] = here + step
            came_by[there] = move
            ahead = math.hypot(abs(there // stride - goal_row), abs(there % stride - goal_col))
            if open_count == heap.shape[0]:
                small = heap
                heap = np.empty((2 * open_count, 3))
                for i in range(open_count):
                    _set_entry(heap, i, small[i, 0], small[i, 1], small[i, 2])
            _push(heap, open_count, cost[there] + ahead, cost[there], there)
            open_count += 1
    if cost[goal] == np.inf:
        return 0, expanded
    count = 0
    node = goal
    while True:
        path[count] = node
        count += 1
        if node == start:
            return count, expanded
        node -= offsets[came_by[node]]
