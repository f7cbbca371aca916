"""One path: A* (Hart, Nilsson & Raphael 1968), by the length flown or by the paper's cost.

*Metric* (`seek`): the octile distance as heuristic, which makes the path the shortest. The open set is a
ring of buckets by estimated cost (after R. B. Dial, CACM 12, 1969), each a stack, so that the search runs
ahead towards the goal among equals. A bucket holds more than one estimate; so a node may be found by a longer
way first, and is then looked at again. Only the moves that the canonical order leaves are looked at
(`gcs.planning.search.canonical_ordering`).

*The paper's* (`seek_paper`): Hill, Thomas & Larson's nodes traversed plus Euclidean distance to the goal.
Diagonals count 1, the heuristic may overestimate, and the path may be longer than need be. The open set is a
heap, whose order among equals is part of what the result depends on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

import numpy as np

from gcs.jit import inlined, kernel, prefetch_row
from gcs.model import FloatArray
from gcs.planning.map.grid import Grid
from gcs.planning.search.canonical_ordering import (
    COL_STEP,
    LED,
    LISTED,
    NEAR_BIT,
    NO_MOVE,
    ROW_STEP,
    TIGHT,
    ByteArray,
    IntArray,
    move_cost,
    octile,
)
from gcs.planning.search.dijkstra import room_to_work, spread
from gcs.planning.search.neighbours import SearchMap, kernel_arrays, search_map

_PER_CELL = 2
"""Buckets to a cell of estimated cost. On random maps half as many or twice as many change little."""

_TIE = 1e-10
"""Improvements below this are rounding errors."""

_ALL_AT_ONCE = 16
"""Clearing as many costs in a row takes as long as one here and there."""

_DONE = 1 << 28
"""Set in what is known of a node once its own moves have been looked at."""

_OF_MAP = ~(_DONE | LED)

_ROW_STEPS, _COL_STEPS = np.array(ROW_STEP), np.array(COL_STEP)


@kernel
def seek(  # type: ignore[no-untyped-def]
    lists, any_near, offsets, stride, nodes, costs, goals, beyond, reached, known, entries, path,
):  # fmt: skip
    """Search the shortest path from a place to another and write it to `path`, last node first.

    `nodes`, `costs` (j,) and `goals`, `beyond` (k,): the nodes by which the two places join the map (-1:
    none) and how far off they lie. `reached` (flat nodes,) must be all zeros and is so again afterwards;
    `known` (flat nodes,) is what is packed of nodes, and the moves that led there are written to it, as is to
    `entries` (n, 2). Returns how many nodes were written, 0 if there is no way, -1 if `entries` is too short;
    the cost in cells from place to place, inf if there is none; the length from first to last node, every
    move counted plainly; and how many nodes were expanded.
    """
    aim, slack = np.int64(-1), -np.inf
    for k in range(goals.size):
        aim = goals[k] if aim < 0 else aim
    if aim < 0:
        return 0, np.inf, np.inf, 0
    # Rows and columns are told by a product: a division takes longer than all else that a node needs.
    per_row = 1.0 / stride
    aim_row = int((aim + 0.5) * per_row)
    aim_col = aim - aim_row * stride
    # The estimate aims at one node; another one where the place joins may be the last as long as it is less
    # than `slack` worse.
    for k in range(goals.size):
        if goals[k] >= 0:
            row = int((goals[k] + 0.5) * per_row)
            ahead = octile(abs(row - aim_row), abs(goals[k] - row * stride - aim_col))
            slack = max(slack, ahead - beyond[k])
    ring = 63 if any_near else 15
    head = np.full(ring + 1, -1)
    # Entries are node and next entry of the bucket. They are not used again: they tell what to clean up.
    used, live, base = 0, 0, np.inf
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
        reached[node] = costs[i] + 1.0  # 0 means not reached: costs are kept one higher
        known[node] = (known[node] & _OF_MAP) | NO_MOVE
        slot = int((costs[i] + ahead - base) * _PER_CELL) & ring
        entries[used, 0], entries[used, 1] = node, head[slot]
        head[slot] = used
        used, live = used + 1, live + 1
    best, last, bucket, expanded = np.inf, np.int64(-1), 0, 0
    full = entries.shape[0] - 8
    while live > 0 and used <= full and base + bucket / _PER_CELL < best + slack:
        slot = bucket & ring
        while head[slot] >= 0 and used <= full:
            entry = head[slot]
            node = np.int64(entries[entry, 0])
            head[slot] = entries[entry, 1]
            live -= 1
            told = np.int64(known[node])
            if told & _DONE:
                continue
            known[node] = told | _DONE
            expanded += 1
            here = reached[node]
            row = int((node + 0.5) * per_row)
            col = node - row * stride - aim_col
            row -= aim_row
            if abs(row) <= 1 and abs(col) <= 1:
                for k in range(goals.size):
                    if goals[k] == node and here - 1.0 + beyond[k] < best:
                        best, last = here - 1.0 + beyond[k], node
            left = np.int64(lists[told & LISTED])
            for k in range(left & 15):
                move = (left >> (4 + 3 * k)) & 7
                there = node + offsets[move]
                cost = here + move_cost(move, any_near and (told >> (NEAR_BIT + move)) & 1)
                before = reached[there]
                if before != 0.0 and cost >= before - _TIE:
                    continue
                estimate = cost - 1.0 + octile(abs(row + _ROW_STEPS[move]), abs(col + _COL_STEPS[move]))
                if estimate >= best + slack:
                    continue
                reached[there] = cost
                known[there] = (known[there] & _OF_MAP) | move
                to = max(int((estimate - base) * _PER_CELL), bucket) & ring
                entries[used, 0], entries[used, 1] = there, head[to]
                head[to] = used
                used, live = used + 1, live + 1
                # Most ways go on as they came.
                prefetch_row(reached, there + offsets[move])
                prefetch_row(known, there + offsets[move])
        bucket += 1
    if used * _ALL_AT_ONCE > reached.size:
        reached[:] = 0.0
    else:
        for i in range(used):
            reached[entries[i, 0]] = 0.0
    if used > full:
        return -1, np.inf, np.inf, expanded
    count, flown, node = 0, np.inf if last < 0 else 0.0, last
    while node >= 0:
        path[count] = node
        count += 1
        move = np.int64(known[node]) & LED
        if move == NO_MOVE:
            break
        flown += move_cost(move, False)
        node -= offsets[move]
    return count, best, flown, expanded


@lru_cache(maxsize=4)
def _spare(_grid: Grid, _clearance_m: float, _may_lean: bool) -> list[Seeker]:
    """Seekers of a map that nobody is using."""
    return []


@contextmanager
def seeker(grid: Grid, clearance_m: float = 0.0, shifts_nodes: bool = False) -> Iterator[Seeker]:
    """Lend a seeker for a map: one that was given back, if there is any; safe among threads."""
    spare = _spare(grid, clearance_m, shifts_nodes)
    try:
        lent = spare.pop()
    except IndexError:
        lent = Seeker(search_map(grid, clearance_m, shifts_nodes))
    yield lent
    spare.append(lent)


class Seeker:
    """Searches on one map; keeps the arrays that a search works on.

    Making them takes longer than most searches. One seeker does one search at a time.
    """

    def __init__(self, smap: SearchMap) -> None:
        self._smap = smap
        size = smap.moves.size
        self._reached, self._known = np.zeros(size), smap.packed.copy()
        self._entries = np.empty((2 * size, 2), dtype=np.int32)
        self._path = np.empty(size, dtype=np.int64)
        self._room = room_to_work(smap)

    def spread(
        self, nodes: IntArray, costs: FloatArray, goals: IntArray, field: FloatArray, came: ByteArray
    ) -> None:
        """Search from one place to all nodes; see `gcs.planning.search.dijkstra`."""
        searched = kernel_arrays(self._smap)
        spread(*searched, nodes, costs, goals, field, came, self._known, *self._room)

    def path(
        self, nodes: IntArray, costs: FloatArray, goals: IntArray, beyond: FloatArray
    ) -> tuple[IntArray, float, float, int]:
        """Return the nodes of a shortest path, and what else `seek` returns."""
        count = -1
        while count < 0:
            count, cost, flown, expanded = seek(
                *(*kernel_arrays(self._smap), self._smap.stride, nodes, costs, goals, beyond),
                *(self._reached, self._known, self._entries, self._path),
            )
            if count < 0:
                self._entries = np.empty((2 * len(self._entries), 2), dtype=np.int32)
        return self._path[:count][::-1].copy(), float(cost), float(flown), int(expanded)


@inlined
def _before(f, g, node, heap, i):  # type: ignore[no-untyped-def]
    """Order of the open set: nearest to done first; among equals the deeper one, then the lower index."""
    if f != heap[i, 0]:
        return f < heap[i, 0]
    if g != heap[i, 1]:
        return g > heap[i, 1]
    return node < heap[i, 2]


@inlined
def _put(heap, i, f, g, node):  # type: ignore[no-untyped-def]
    heap[i, 0], heap[i, 1] = f, g
    heap[i, 2] = node


@inlined
def _push(heap, size, f, g, node):  # type: ignore[no-untyped-def]
    """Add an entry to a heap of `size`: a hole rises to where it belongs."""
    i = size
    while i > 0:
        up = (i - 1) >> 1
        if not _before(f, g, node, heap, up):
            break
        _put(heap, i, heap[up, 0], heap[up, 1], heap[up, 2])
        i = up
    _put(heap, i, f, g, node)


@inlined
def _drop_first(heap, size):  # type: ignore[no-untyped-def]
    """Remove the first entry of a heap of `size`: the hole sinks until the last entry belongs there."""
    last = size - 1
    f, g, node = heap[last, 0], heap[last, 1], heap[last, 2]
    i, child = 0, 1
    while child < last:
        if child + 1 < last and _before(
            heap[child + 1, 0], heap[child + 1, 1], heap[child + 1, 2], heap, child
        ):
            child += 1
        if _before(f, g, node, heap, child):
            break
        _put(heap, i, heap[child, 0], heap[child, 1], heap[child, 2])
        i, child = child, 2 * child + 1
    _put(heap, i, f, g, node)


@kernel
def seek_paper(moves, near, offsets, stride, start, goal, path):  # type: ignore[no-untyped-def]
    """Search one path by the paper's cost, from node to node, and write it to `path`, goal first.

    Returns how many nodes were written, 0 if there is no way, and how many were expanded.
    """
    cost, came_by = np.empty(moves.size), np.empty(moves.size, np.int8)
    cost[:] = np.inf
    # The open set: estimated cost, cost so far, node. One may be reopened under the paper's cost, so this
    # size is a first guess and the heap grows.
    heap = np.empty((moves.size, 3))
    goal_row, goal_col = goal // stride, goal % stride
    cost[start] = 0.0
    _put(heap, 0, 0.0, 0.0, start)
    open_count, expanded = 1, 0
    while open_count > 0:
        here, node = heap[0, 1], int(heap[0, 2])
        _drop_first(heap, open_count)
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
            step = TIGHT if (near[node] >> move) & 1 else 1.0
            if here + step >= cost[there] - 1e-12:
                continue
            cost[there] = here + step
            came_by[there] = move
            ahead = math.hypot(abs(there // stride - goal_row), abs(there % stride - goal_col))
            if open_count == heap.shape[0]:
                small, heap = heap, np.empty((2 * open_count, 3))
                for i in range(open_count):
                    _put(heap, i, small[i, 0], small[i, 1], small[i, 2])
            _push(heap, open_count, cost[there] + ahead, cost[there], there)
            open_count += 1
    if cost[goal] == np.inf:
        return 0, expanded
    count, node = 0, goal
    while True:
        path[count] = node
        count += 1
        if node == start:
            return count, expanded
        node -= offsets[came_by[node]]
