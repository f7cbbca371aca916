"""One to all: shortest ways from one place to every node, or to as many as are asked for.

Dijkstra's algorithm with Dial's buckets (R. B. Dial, CACM 12, 1969): no move costs less than 1, so in buckets
of width 1 every node of the lowest bucket is final, in any order, and no heap is needed. A node enters a
bucket at most once, so a bucket is a plain stack; and a node is left out when its cost is below that of the
bucket it is found in: then it was there before. From each node only the moves that its canonical order leaves
are looked at (`gcs.planning.search.canonical_ordering`): fewer than two on average, not eight.

One search serves every target of an agent; a cost matrix takes one search a row, not one a pair. It ends when
the nodes asked for have their final costs.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from gcs.jit import kernel, leaf, prefetch_row
from gcs.planning.search.canonical_ordering import DIAGONAL, LED, LISTED, MOST_MOVES, NEAR_BIT, NO_MOVE, TIGHT
from gcs.planning.search.neighbours import SearchMap

IntArray32: TypeAlias = npt.NDArray[np.int32]

_COSTS = np.array([1.0] * 4 + [DIAGONAL] * 4)
_CHUNK = 2048
"""Nodes whose moves are listed at a time: the list stays in the fastest cache."""


@leaf
def _list_moves(lists, known, stack, slot, first, beyond, low, field, edges):  # type: ignore[no-untyped-def]
    """List the moves to look at from entries of a bucket: 8 times the node and the move; returns how many.

    Nearly without branches: three moves are written whether there are as many or not.
    """
    size = 0
    for entry in range(first, beyond):
        node = np.int64(stack[slot, entry])
        moves = np.int64(lists[known[node] & LISTED])
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
def _pass_on(lists, offsets, stack, height, bucket, field, known, edges):  # type: ignore[no-untyped-def]
    """Look at the moves of all nodes of a bucket; returns by how many there are more nodes in buckets now."""
    ring = height.size - 1
    slot, live = bucket & ring, 0
    count = height[slot]
    for first in range(0, count, _CHUNK):
        beyond = min(first + _CHUNK, count)
        size = _list_moves(lists, known, stack, slot, first, beyond, float(bucket), field, edges)
        for k in range(size):
            edge = np.int64(edges[k])
            node, move = edge >> 3, edge & 7
            there = node + offsets[move]
            dear = TIGHT if (known[node] >> (NEAR_BIT + move)) & 1 else 1.0
            cost, before = field[node] + dear * _COSTS[move], field[there]
            if cost < before:
                field[there] = cost
                known[there] = (known[there] & ~LED) | move
                prefetch_row(field, there + offsets[move])
                prefetch_row(known, there + offsets[move])
                b = int(cost)
                stack[b & ring, height[b & ring]] = there
                is_new = before >= b + 1
                height[b & ring] += is_new
                live += is_new
    height[slot] = 0
    return live - count


@leaf
def _pass_on_plainly(lists, offsets, stack, height, bucket, field, known, edges):  # type: ignore[no-untyped-def]
    """The same where no move is near, a quarter faster: a move leads to one of the next two buckets."""
    slot, next_slot, far_slot = bucket & 3, (bucket + 1) & 3, (bucket + 2) & 3
    count, near_height, far_height = height[slot], height[next_slot], height[far_slot]
    low, middle, high = float(bucket), bucket + 2.0, bucket + 3.0
    for first in range(0, count, _CHUNK):
        beyond = min(first + _CHUNK, count)
        size = _list_moves(lists, known, stack, slot, first, beyond, low, field, edges)
        for k in range(size):
            edge = np.int64(edges[k])
            node, move = edge >> 3, edge & 7
            there = node + offsets[move]
            cost, before = field[node] + _COSTS[move], field[there]
            if cost < before:
                field[there] = cost
                known[there] = (known[there] & ~LED) | move
                prefetch_row(field, there + offsets[move])
                prefetch_row(known, there + offsets[move])
                stack[next_slot, near_height] = there
                near_height += (cost < middle) & (before >= middle)
                stack[far_slot, far_height] = there
                far_height += (cost >= middle) & (before >= high)
    live = near_height - height[next_slot] + far_height - height[far_slot] - count
    height[slot], height[next_slot], height[far_slot] = 0, near_height, far_height
    return live


def room_to_work(smap: SearchMap) -> tuple[IntArray32, IntArray32]:
    """Buckets and a list of moves, for `spread` to work in."""
    # The ring of buckets is longer than the dearest move and the spread of the joins together.
    buckets = 16 if smap.any_near else 4
    return np.empty((buckets, smap.packed.size), np.int32), np.empty((_CHUNK + 1) * MOST_MOVES, np.int32)


@kernel
def spread(  # type: ignore[no-untyped-def]
    lists, any_near, offsets, nodes, costs, goals, field, came, known, stack, edges
):
    """Fill `field` (flat nodes,) with the cost in cells from a place, `came` with the moves that lead there.

    `nodes`, `costs` (j,): the nodes by which the place joins the map (-1: none) and how far off it they lie;
    the costs may differ by sqrt(2) at most. `known` (flat nodes,): what is packed of nodes; the moves that
    led there are written to it. `stack` and `edges`: see `room_to_work`. Ends when all of `goals` are final,
    if there are any and all can be reached. Returns below which cost the field is final: inf when all of it
    is. What cannot be reached has the cost inf, and nothing in `came`.
    """
    ring, size, stride = stack.shape[0] - 1, field.size, offsets[1]
    height = np.zeros(ring + 1, np.int64)
    live, bucket, final, low, high = 0, 1 << 60, 0, size, -1
    for i in range(nodes.size):
        if nodes[i] >= 0:
            low, high = min(low, nodes[i]), max(high, nodes[i])
    # Rows are made ready just before the search may get there: a bucket leads one row on.
    low, high = max(0, low - 4 * stride), min(size, high + 4 * stride)
    field[low:high] = np.inf
    for i in range(nodes.size):
        node = nodes[i]
        if node >= 0 and costs[i] < field[node]:
            field[node], known[node] = costs[i], (known[node] & ~LED) | NO_MOVE
            b = int(costs[i])
            stack[b & ring, height[b & ring]] = node
            height[b & ring] += 1
            live, bucket = live + 1, min(bucket, b)
    end = np.inf
    while live > 0:
        if any_near:
            live += _pass_on(lists, offsets, stack, height, bucket, field, known, edges)
        else:
            live += _pass_on_plainly(lists, offsets, stack, height, bucket, field, known, edges)
        bucket += 1
        while final < goals.size and low <= goals[final] < high and field[goals[final]] < bucket:
            final += 1
        if goals.size > 0 and final == goals.size:
            end = float(bucket)
            break
        field[max(0, low - stride) : low], field[high : high + stride] = np.inf, np.inf
        low, high = max(0, low - stride), min(size, high + stride)
    field[:low], field[high:] = np.inf, np.inf
    for node in range(low, high):
        came[node] = known[node] & LED
    return end


@kernel
def trace_back(offsets, came, goal, path):  # type: ignore[no-untyped-def]
    """Write the nodes from `goal` back to where the search began to `path`; returns their number."""
    node, count = goal, 0
    while True:
        path[count] = node
        count += 1
        if came[node] == NO_MOVE:
            return count
        node -= offsets[came[node]]


@kernel
def costs_at(field, nodes, costs):  # type: ignore[no-untyped-def]
    """Read a field at `nodes` (m, j) into `costs` (m, j); inf where a node is -1."""
    for i in range(nodes.shape[0]):
        for k in range(nodes.shape[1]):
            costs[i, k] = field[nodes[i, k]] if nodes[i, k] >= 0 else np.inf
