"""A* from one place to another (Hart, Nilsson & Raphael 1968), by path length or by the paper's cost.

*Metric* (`astar`): the octile distance is the heuristic, so the path is the shortest. The open set is a ring
of buckets by estimated cost (after R. B. Dial, CACM 12, 1969). Each bucket is a stack, so equal estimates are
expanded depth first. A bucket holds more than one estimate, so a node may be reached by a longer path first
and is then reopened. Only moves of the canonical ordering are expanded
(`gcs.planning.search.canonical_ordering`).

*The paper's* (`astar_paper`): nodes traversed plus Euclidean distance to the goal (Hill, Thomas & Larson).
Diagonals count 1. The heuristic may overestimate, so paths may be longer than the shortest. The open set is a
heap, because the result depends on its order among equals.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

import numpy as np

from gcs.jit import inlined, int64, kernel, prefetch_row
from gcs.model import ByteArray, FloatArray, Int32Array, IntArray, UInt32Array
from gcs.planning.map.grid import Grid
from gcs.planning.search.canonical_ordering import (
    ARRIVAL_MASK,
    COL_STEP,
    LIST_MASK,
    NO_MOVE,
    ROW_STEP,
    TIGHT_BIT,
    TIGHT_MOVE_COST,
    move_length,
    octile,
)
from gcs.planning.search.dijkstra import dijkstra_buffers, one_to_all
from gcs.planning.search.neighbours import SearchMap, kernel_arrays, search_map

_BUCKETS_PER_CELL = 2
"""Buckets per cell of estimated cost."""

_COST_EPSILON = 1e-10
"""Improvements below this are rounding errors."""

_FULL_CLEAR_RATIO = 16
"""Clearing the whole array takes as long as this many times fewer single entries."""

_CLOSED_BIT = 1 << 28
"""Set in the packed word of a node that has been expanded."""

_MAP_BITS = ~(_CLOSED_BIT | ARRIVAL_MASK)

_ROW_STEPS = np.array(ROW_STEP)
_COL_STEPS = np.array(COL_STEP)


@kernel
def astar(
    move_lists: UInt32Array, has_tight_moves: bool, offsets: IntArray, stride: int, nodes: IntArray,
    costs: FloatArray, goals: IntArray, goal_costs: FloatArray, reached: FloatArray, packed: UInt32Array,
    entries: Int32Array, path: IntArray,
) -> tuple[int, float, float, int]:  # fmt: skip
    """Search the shortest path between two places and write it to `path`, last node first.

    `nodes`, `costs` (j,) and `goals`, `goal_costs` (k,): nodes that connect the places to the grid (-1: none)
    and their distances. `reached` (flat nodes,) must be zeros, and is zeros again afterwards. `packed` (flat
    nodes,) holds the packed words; arrival moves are written to it. `entries` (n, 2) is work space. Returns
    the number of nodes written (0: no path, -1: `entries` too short), the cost in cells between the places
    (inf: no path), the length from first to last node without clearance costs, and the number of expanded
    nodes.
    """
    aim = int64(-1)
    slack = -np.inf
    for k in range(goals.size):
        aim = goals[k] if aim < 0 else aim
    if aim < 0:
        return 0, np.inf, np.inf, 0
    # Rows and columns by multiplication: a division takes longer than the rest of the work of a node.
    per_row = 1.0 / stride
    aim_row = int((aim + 0.5) * per_row)
    aim_col = aim - aim_row * stride
    # The estimate aims at one goal node. Another one may be the last node if it is less than `slack` worse.
    for k in range(goals.size):
        if goals[k] >= 0:
            row = int((goals[k] + 0.5) * per_row)
            ahead = octile(abs(row - aim_row), abs(goals[k] - row * stride - aim_col))
            slack = max(slack, ahead - goal_costs[k])
    ring = 63 if has_tight_moves else 15
    head = np.full(ring + 1, -1)
    # Entries are node and next entry of the bucket. They stay: they list the nodes to reset.
    used = 0
    live = 0
    base = np.inf
    for i in range(nodes.size):
        if nodes[i] >= 0:
            row = int((nodes[i] + 0.5) * per_row)
            base = min(base, costs[i] + octile(abs(row - aim_row), abs(nodes[i] - row * stride - aim_col)))
    base -= 1e-6
    for i in range(nodes.size):
        node = nodes[i]
        if node < 0 or (reached[node] != 0.0 and costs[i] + 1.0 >= reached[node]):
            continue
        row = int((node + 0.5) * per_row)
        ahead = octile(abs(row - aim_row), abs(node - row * stride - aim_col))
        reached[node] = costs[i] + 1.0  # 0 means not reached, so costs are stored plus one
        packed[node] = (packed[node] & _MAP_BITS) | NO_MOVE
        slot = int((costs[i] + ahead - base) * _BUCKETS_PER_CELL) & ring
        entries[used, 0] = node
        entries[used, 1] = head[slot]
        head[slot] = used
        used = used + 1
        live = live + 1
    best = np.inf
    last = int64(-1)
    bucket = 0
    expanded = 0
    full = entries.shape[0] - 8
    while live > 0 and used <= full and base + bucket / _BUCKETS_PER_CELL < best + slack:
        slot = bucket & ring
        while head[slot] >= 0 and used <= full:
            entry = head[slot]
            node = int64(entries[entry, 0])
            head[slot] = entries[entry, 1]
            live -= 1
            word = int64(packed[node])
            if word & _CLOSED_BIT:
                continue
            packed[node] = word | _CLOSED_BIT
            expanded += 1
            here = reached[node]
            row = int((node + 0.5) * per_row)
            col = node - row * stride - aim_col
            row -= aim_row
            if abs(row) <= 1 and abs(col) <= 1:
                for k in range(goals.size):
                    if goals[k] == node and here - 1.0 + goal_costs[k] < best:
                        best = here - 1.0 + goal_costs[k]
                        last = node
            left = int64(move_lists[word & LIST_MASK])
            for k in range(left & 15):
                move = (left >> (4 + 3 * k)) & 7
                there = node + offsets[move]
                cost = here + move_length(move, has_tight_moves and (word >> (TIGHT_BIT + move)) & 1)
                before = reached[there]
                if before != 0.0 and cost >= before - _COST_EPSILON:
                    continue
                estimate = cost - 1.0 + octile(abs(row + _ROW_STEPS[move]), abs(col + _COL_STEPS[move]))
                if estimate >= best + slack:
                    continue
                reached[there] = cost
                packed[there] = (packed[there] & _MAP_BITS) | move
                to = max(int((estimate - base) * _BUCKETS_PER_CELL), bucket) & ring
                entries[used, 0] = there
                entries[used, 1] = head[to]
                head[to] = used
                used = used + 1
                live = live + 1
                # Most paths go straight on.
                prefetch_row(reached, there + offsets[move])
                prefetch_row(packed, there + offsets[move])
        bucket += 1
    if used * _FULL_CLEAR_RATIO > reached.size:
        reached[:] = 0.0
    else:
        for i in range(used):
            reached[entries[i, 0]] = 0.0
    if used > full:
        return -1, np.inf, np.inf, expanded
    count = 0
    flown = np.inf if last < 0 else 0.0
    node = last
    while node >= 0:
        path[count] = node
        count += 1
        move = int64(packed[node]) & ARRIVAL_MASK
        if move == NO_MOVE:
            break
        flown += move_length(move, False)
        node -= offsets[move]
    return count, best, flown, expanded


@lru_cache(maxsize=4)
def _idle_searches(_grid: Grid, _clearance_m: float, _may_lean: bool) -> list[GridSearch]:
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
        self._known = smap.packed.copy()
        self._entries = np.empty((2 * size, 2), dtype=np.int32)
        self._path = np.empty(size, dtype=np.int64)
        self._room = dijkstra_buffers(smap)

    def one_to_all(
        self, nodes: IntArray, costs: FloatArray, goals: IntArray, field: FloatArray, came_by: ByteArray
    ) -> None:
        """Search from one place to all nodes; see `gcs.planning.search.dijkstra`."""
        searched = kernel_arrays(self._smap)
        one_to_all(*searched, nodes, costs, goals, field, came_by, self._known, *self._room)

    def path(
        self, nodes: IntArray, costs: FloatArray, goals: IntArray, goal_costs: FloatArray
    ) -> tuple[IntArray, float, float, int]:
        """Return the nodes of a shortest path, and the other results of `astar`."""
        count = -1
        while count < 0:
            count, cost, flown, expanded = astar(
                *(*kernel_arrays(self._smap), self._smap.stride, nodes, costs, goals, goal_costs),
                *(self._reached, self._known, self._entries, self._path),
            )
            if count < 0:
                self._entries = np.empty((2 * len(self._entries), 2), dtype=np.int32)
        return self._path[:count][::-1].copy(), float(cost), float(flown), int(expanded)


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
            if here + step >= cost[there] - 1e-12:
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
