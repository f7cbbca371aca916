"""One to all: shortest ways from one place to every node, or to as many as are asked for.

Dijkstra's algorithm with Dial's buckets (R. B. Dial, CACM 12, 1969): no move costs less than 1, so in buckets
of width 1 every node of the lowest bucket is final, in any order, and no heap is needed. A node enters a
bucket at most once, so a bucket is a plain stack; and a node is left out when its cost is below that of the
bucket it is found in: then it was there before. From each node only the moves that its canonical order leaves
are looked at (`gcs.planning.canonical`): fewer than two on average, not eight.

One search serves every target of an agent; a cost matrix takes one search a row, not one a pair. It ends when
the nodes asked for have their final costs.
"""

from __future__ import annotations

import numpy as np

from gcs.compiling import kernel, leaf
from gcs.planning.canonical import FIRST, NO_MOVE, REMAINING, move_cost


@leaf
def _pass_on(order, remaining, near, offsets, stack, height, bucket, field, came):  # type: ignore[no-untyped-def]
    """Look at the moves of all nodes of a bucket; returns by how many there are more nodes in buckets now."""
    ring = height.size - 1
    slot, live = bucket & ring, 0
    count = height[slot]
    for entry in range(count):
        node = np.int64(stack[slot, entry])
        here = field[node]
        if here < bucket:
            continue
        left, dear = remaining[order[node], came[node]], near[node]
        while left:
            move = FIRST[left]
            left &= left - 1
            there = node + offsets[move]
            cost = here + move_cost(move, (dear >> move) & 1)
            known = field[there]
            if cost >= known:
                continue
            field[there], came[there] = cost, move
            b = int(cost)
            if known < b + 1:
                continue
            stack[b & ring, height[b & ring]] = there
            height[b & ring] += 1
            live += 1
    height[slot] = 0
    return live - count


@leaf
def _pass_on_plainly(moves, offsets, stack, height, bucket, field, came):  # type: ignore[no-untyped-def]
    """The same where no move is near, a tenth faster: a move leads to one of the next two buckets."""
    slot, next_slot, far_slot = bucket & 3, (bucket + 1) & 3, (bucket + 2) & 3
    count, near_height, far_height = height[slot], height[next_slot], height[far_slot]
    low, middle, high = float(bucket), bucket + 2.0, bucket + 3.0
    for entry in range(count):
        node = np.int64(stack[slot, entry])
        here = field[node]
        if here < low:
            continue
        left = REMAINING[came[node], moves[node]]
        while left:
            move = FIRST[left]
            left &= left - 1
            there = node + offsets[move]
            cost = here + move_cost(move, False)
            known = field[there]
            if cost >= known:
                continue
            field[there], came[there] = cost, move
            if cost < middle:
                if known >= middle:
                    stack[next_slot, near_height] = there
                    near_height += 1
            elif known >= high:
                stack[far_slot, far_height] = there
                far_height += 1
    live = near_height - height[next_slot] + far_height - height[far_slot] - count
    height[slot], height[next_slot], height[far_slot] = 0, near_height, far_height
    return live


@kernel
def spread(moves, order, remaining, near, any_near, offsets, nodes, costs, goals, field, came):  # type: ignore[no-untyped-def]
    """Fill `field` (flat nodes,) with the cost in cells from a place, `came` with the moves that lead there.

    `nodes`, `costs` (j,): the nodes by which the place joins the map (-1: none) and how far off it they lie;
    the costs may differ by sqrt(2) at most. Ends when all of `goals` are final, if there are any and all can
    be reached. Returns below which cost the field is final: inf when all of it is. What cannot be reached
    has the cost inf.
    """
    # The ring of buckets is longer than the dearest move and the spread of the joins together.
    ring = 15 if any_near else 3
    stack, height = np.empty((ring + 1, moves.size), np.int32), np.zeros(ring + 1, np.int64)
    field[:] = np.inf
    live, bucket, final = 0, 1 << 60, 0
    for i in range(nodes.size):
        node = nodes[i]
        if node >= 0 and costs[i] < field[node]:
            field[node], came[node] = costs[i], NO_MOVE
            b = int(costs[i])
            stack[b & ring, height[b & ring]] = node
            height[b & ring] += 1
            live, bucket = live + 1, min(bucket, b)
    while live > 0:
        if any_near:
            live += _pass_on(order, remaining, near, offsets, stack, height, bucket, field, came)
        else:
            live += _pass_on_plainly(moves, offsets, stack, height, bucket, field, came)
        bucket += 1
        while final < goals.size and field[goals[final]] < bucket:
            final += 1
        if goals.size > 0 and final == goals.size:
            return float(bucket)
    return np.inf


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
