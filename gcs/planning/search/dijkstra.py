"""One-to-all Dijkstra with Dial's buckets (R. B. Dial, CACM 12, 1969).

No move costs less than 1, so with buckets of width 1 every node of the lowest bucket is final, in any order.
A bucket is therefore a plain stack and no heap is needed. A stale entry has a cost below its bucket and is
skipped. Only moves of the canonical ordering are relaxed (`gcs.planning.search.canonical_ordering`): fewer
than two per node on average, not eight.

One search gives a row of the cost matrix. It ends when all goals have their final costs.
"""

from __future__ import annotations

import numpy as np

from gcs.jit import int64, kernel, leaf, prefetch_row
from gcs.model import ByteArray, FloatArray, Int32Array, IntArray, UInt32Array
from gcs.planning.search.canonical_ordering import (
    ARRIVAL_MASK,
    DIAGONAL,
    LIST_MASK,
    MAX_MOVES,
    NO_MOVE,
    TIGHT_BIT,
    TIGHT_MOVE_COST,
)
from gcs.planning.search.neighbours import SearchMap

_COSTS = np.array([1.0] * 4 + [DIAGONAL] * 4)
_CHUNK = 2048
"""Nodes whose moves are listed at a time, so that the list stays in the first-level cache."""


@leaf
def _list_moves(
    move_lists: UInt32Array, packed: UInt32Array, stack: Int32Array, slot: int, first: int, beyond: int,
    low: float, field: FloatArray, edges: Int32Array,
) -> int:  # fmt: skip
    """List the moves of the entries of a bucket as 8 times the node plus the move; return their number.

    Nearly branch-free: three moves are written even if there are fewer.
    """
    size = 0
    for entry in range(first, beyond):
        node = int64(stack[slot, entry])
        moves = int64(move_lists[packed[node] & LIST_MASK])
        edges[size] = 8 * node + ((moves >> 4) & 7)
        edges[size + 1] = 8 * node + ((moves >> 7) & 7)
        edges[size + 2] = 8 * node + ((moves >> 10) & 7)
        count = moves & 15 if field[node] >= low else 0
        if count > 3:
            for k in range(3, count):
                edges[size + k] = 8 * node + ((moves >> (4 + 3 * k)) & 7)
        size += int(count)
    return size


@leaf
def _relax_bucket(
    move_lists: UInt32Array, offsets: IntArray, stack: Int32Array, height: IntArray, bucket: int,
    field: FloatArray, packed: UInt32Array, edges: Int32Array,
) -> int:  # fmt: skip
    """Relax the moves of all nodes of a bucket; return the change in the number of queued nodes."""
    ring = height.size - 1
    slot = bucket & ring
    live = 0
    count = height[slot]
    for first in range(0, count, _CHUNK):
        beyond = min(first + _CHUNK, count)
        size = _list_moves(move_lists, packed, stack, slot, first, beyond, float(bucket), field, edges)
        for k in range(size):
            edge = int64(edges[k])
            node = edge >> 3
            move = edge & 7
            there = node + offsets[move]
            factor = TIGHT_MOVE_COST if (packed[node] >> (TIGHT_BIT + move)) & 1 else 1.0
            cost = field[node] + factor * _COSTS[move]
            before = field[there]
            if cost < before:
                field[there] = cost
                packed[there] = (packed[there] & ~ARRIVAL_MASK) | move
                prefetch_row(field, there + offsets[move])
                prefetch_row(packed, there + offsets[move])
                b = int(cost)
                stack[b & ring, height[b & ring]] = there
                is_new = before >= b + 1
                height[b & ring] += is_new
                live += is_new
    height[slot] = 0
    return live - count


@leaf
def _relax_uniform_bucket(
    move_lists: UInt32Array, offsets: IntArray, stack: Int32Array, height: IntArray, bucket: int,
    field: FloatArray, packed: UInt32Array, edges: Int32Array,
) -> int:  # fmt: skip
    """Do the same without tight moves, a quarter faster: a move leads to one of the next two buckets."""
    slot = bucket & 3
    next_slot = (bucket + 1) & 3
    far_slot = (bucket + 2) & 3
    count = height[slot]
    near_height = height[next_slot]
    far_height = height[far_slot]
    low = float(bucket)
    middle = bucket + 2.0
    high = bucket + 3.0
    for first in range(0, count, _CHUNK):
        beyond = min(first + _CHUNK, count)
        size = _list_moves(move_lists, packed, stack, slot, first, beyond, low, field, edges)
        for k in range(size):
            edge = int64(edges[k])
            node = edge >> 3
            move = edge & 7
            there = node + offsets[move]
            cost = field[node] + _COSTS[move]
            before = field[there]
            if cost < before:
                field[there] = cost
                packed[there] = (packed[there] & ~ARRIVAL_MASK) | move
                prefetch_row(field, there + offsets[move])
                prefetch_row(packed, there + offsets[move])
                stack[next_slot, near_height] = there
                near_height += (cost < middle) & (before >= middle)
                stack[far_slot, far_height] = there
                far_height += (cost >= middle) & (before >= high)
    live = near_height - height[next_slot] + far_height - height[far_slot] - count
    height[slot] = 0
    height[next_slot] = near_height
    height[far_slot] = far_height
    return live


def dijkstra_buffers(smap: SearchMap) -> tuple[Int32Array, Int32Array]:
    """Return buckets and a list of moves as work space of `one_to_all`."""
    # The ring is longer than the most expensive move plus the spread of the connecting distances.
    buckets = 16 if smap.has_tight_moves else 4
    return np.empty((buckets, smap.packed.size), np.int32), np.empty((_CHUNK + 1) * MAX_MOVES, np.int32)


@kernel
def one_to_all(
    move_lists: UInt32Array, has_tight_moves: bool, offsets: IntArray, nodes: IntArray, costs: FloatArray,
    goals: IntArray, field: FloatArray, came_by: ByteArray, packed: UInt32Array, stack: Int32Array,
    edges: Int32Array,
) -> float:  # fmt: skip
    """Fill `field` (flat nodes,) with the cost in cells from a place, and `came_by` with the arrival moves.

    `nodes`, `costs` (j,): nodes that connect the place to the grid (-1: none) and their distances, which
    differ by sqrt(2) at most. `packed` (flat nodes,): packed words; arrival moves are written to them.
    `stack`, `edges`:
    `dijkstra_buffers`. Ends when all reachable `goals` are final. Returns the cost below which the field is
    final: inf if all of it is. Unreachable nodes have the cost inf, and nothing in `came_by`.
    """
    ring = stack.shape[0] - 1
    size = field.size
    stride = offsets[1]
    height = np.zeros(ring + 1, np.int64)
    live = 0
    bucket = 1 << 60
    final = 0
    low = size
    high = -1
    for i in range(nodes.size):
        if nodes[i] >= 0:
            low = min(low, nodes[i])
            high = max(high, nodes[i])
    # Rows are initialised just before the search can reach them: a bucket leads one row on.
    low = max(0, low - 4 * stride)
    high = min(size, high + 4 * stride)
    field[low:high] = np.inf
    for i in range(nodes.size):
        node = nodes[i]
        if node >= 0 and costs[i] < field[node]:
            field[node] = costs[i]
            packed[node] = (packed[node] & ~ARRIVAL_MASK) | NO_MOVE
            b = int(costs[i])
            stack[b & ring, height[b & ring]] = node
            height[b & ring] += 1
            live = live + 1
            bucket = min(bucket, b)
    end = np.inf
    while live > 0:
        if has_tight_moves:
            live += _relax_bucket(move_lists, offsets, stack, height, bucket, field, packed, edges)
        else:
            live += _relax_uniform_bucket(move_lists, offsets, stack, height, bucket, field, packed, edges)
        bucket += 1
        while final < goals.size and low <= goals[final] < high and field[goals[final]] < bucket:
            final += 1
        if goals.size > 0 and final == goals.size:
            end = float(bucket)
            break
        field[max(0, low - stride) : low] = np.inf
        field[high : high + stride] = np.inf
        low = max(0, low - stride)
        high = min(size, high + stride)
    field[:low] = np.inf
    field[high:] = np.inf
    for node in range(low, high):
        came_by[node] = packed[node] & ARRIVAL_MASK
    return end


@kernel
def trace_back(offsets: IntArray, came_by: ByteArray, goal: int, path: IntArray) -> int:
    """Write the nodes from `goal` back to the start to `path`; return their number."""
    node = goal
    count = 0
    while True:
        path[count] = node
        count += 1
        if came_by[node] == NO_MOVE:
            return count
        node -= offsets[came_by[node]]


@kernel
def costs_at(field: FloatArray, nodes: IntArray, costs: FloatArray) -> None:
    """Read a field at `nodes` (m, j) into `costs` (m, j); inf where a node is -1."""
    for i in range(nodes.shape[0]):
        for k in range(nodes.shape[1]):
            costs[i, k] = field[nodes[i, k]] if nodes[i, k] >= 0 else np.inf
