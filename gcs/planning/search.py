r"""Shortest ways on the grid: from one place to everywhere, and A* from node to node.

Moves go to the eight neighbours; a straight move costs 1, a diagonal one sqrt(2) (in cells), and a diagonal
needs both of the straight neighbours beside it to be free: corners are not cut. The legal moves of every node
are packed into one byte each, on a map with a blocked border, so that the inner loop needs no bounds and no
obstacle tests.

*One to all* (`distances_m`, `fields`) is Dijkstra's algorithm with Dial's buckets (R. B. Dial, CACM 12,
1969): no move costs less than 1, so in buckets of width 1 every node of the lowest bucket is final, in any
order, and no heap is needed. One search serves every target of an agent; a cost matrix takes one search a
row, not one a pair.

*A\\** (`find_path`; Hart, Nilsson & Raphael 1968) knows two costs. "metric" is the length flown, with the
octile distance as heuristic: the shortest path. "paper" is the cost of Hill, Thomas & Larson, nodes traversed
plus Euclidean distance to the goal: diagonals count 1, the heuristic may overestimate, and the path may be
longer than need be.

*Clearance*: nodes nearer to an obstacle than wanted are tight, and a move from or to a tight node counts
`TIGHT` times. So clearance is given up where there is no other way, or none but a long detour; and a place
that lies in the tight zone leaves it at once. Counting tight moves a thousandfold, as good as forbidding
them, was tried on random maps with 25 m of clearance: where a fifth of the nodes is blocked, no route can
keep it, and routes nearly doubled in length to save single tight moves; eightfold they grow by a third. Up to
a tenth blocked, both keep the clearance on all but 0 to 4 % of the routes that they plan.

Paths are read off the distances backwards, from the goal to the source, going straight on among equals: fewer
corners, and the same path whatever the order of the search.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from gcs.compiling import inlined, kernel
from gcs.model import FloatArray
from gcs.planning.grid import Grid, Node

SearchCost: TypeAlias = Literal["metric", "paper"]
IntArray: TypeAlias = npt.NDArray[np.int64]

TIGHT = 8.0
"""How many moves one tight move counts."""

_TIE = 1e-7
"""Costs within this are equal; different costs of a map differ by more, rounding errors stay below."""

_DIAGONAL = math.sqrt(2.0)

# Moves in the order east, north, west, south, north-east, north-west, south-west, south-east.
_ROW_STEP = (0, 1, 0, -1, 1, 1, -1, -1)
_COL_STEP = (1, 0, -1, 0, 1, -1, -1, 1)


class SearchMap(NamedTuple):
    """A grid as the kernels read it; flat arrays over a map with a border of one blocked node all around."""

    moves: npt.NDArray[np.uint8]
    """Bit d is set if move d is legal from this node."""
    tight: npt.NDArray[np.bool_]
    """Nearer to an obstacle than the clearance."""
    mainland: npt.NDArray[np.bool_]
    """Free nodes of the largest connected part of the map: where a place inside an obstacle is left to."""
    offsets: IntArray
    """(8,) flat index steps of the moves."""
    stride: int
    any_tight: bool


@lru_cache(maxsize=16)
def search_map(grid: Grid, clearance_m: float = 0.0) -> SearchMap:
    """Prepare a grid for searching; kept for the grids last used, since a grid is planned on many times."""
    rows, cols = grid.shape
    stride = cols + 2
    blocked = np.ones((rows + 2, stride), dtype=np.bool_)
    blocked[1:-1, 1:-1] = grid.blocked
    tight = np.zeros_like(blocked)
    tight[1:-1, 1:-1] = grid.inflate(clearance_m).blocked & ~grid.blocked
    # Diagonals need two free straight neighbours, so what is connected at all is connected by straight moves.
    parts, count = ndimage.label(~blocked)
    mainland = (
        parts == (1 + int(np.argmax(np.bincount(parts.ravel())[1:]))) if count else np.zeros_like(blocked)
    )
    offsets = np.array([r * stride + c for r, c in zip(_ROW_STEP, _COL_STEP, strict=True)], dtype=np.int64)
    moves = np.zeros((rows + 2, stride), dtype=np.uint8)
    for move, (r, c) in enumerate(zip(_ROW_STEP, _COL_STEP, strict=True)):
        free = ~blocked[1:-1, 1:-1] & ~blocked[1 + r : rows + 1 + r, 1 + c : cols + 1 + c]
        if r and c:
            free &= ~blocked[1 + r : rows + 1 + r, 1:-1] & ~blocked[1:-1, 1 + c : cols + 1 + c]
        moves[1:-1, 1:-1] |= free.astype(np.uint8) << np.uint8(move)
    return SearchMap(moves.ravel(), tight.ravel(), mainland.ravel(), offsets, stride, bool(tight.any()))


@inlined
def _move_cost(move, tight):  # type: ignore[no-untyped-def]
    return (1.0 if move < 4 else _DIAGONAL) * (TIGHT if tight else 1.0)


@inlined
def _spread(moves, tight, offsets, any_tight, nodes, costs, head, entry_node, entry_next, done, field):  # type: ignore[no-untyped-def]
    """Fill `field` with the cost from a place to every node.

    `nodes`, `costs`: by which nodes the place joins the map (-1: none) and how far off they are. Buckets are
    linked lists in one pool (`entry_node`, `entry_next`) whose freed entries are used again first.
    """
    mask = head.size - 1
    field[:] = np.inf
    done[:] = False
    head[:] = -1
    unused, used, live, bucket = -1, 0, 0, 1 << 60
    for i in range(nodes.size):
        node = nodes[i]
        if node >= 0 and costs[i] < field[node]:
            field[node] = costs[i]
            b = int(costs[i])
            entry_node[used], entry_next[used] = node, head[b & mask]
            head[b & mask] = used
            used, live, bucket = used + 1, live + 1, min(bucket, b)
    while live > 0:
        slot = bucket & mask
        while head[slot] >= 0:
            entry = head[slot]
            node = entry_node[entry]
            head[slot] = entry_next[entry]
            entry_next[entry] = unused
            unused = entry
            live -= 1
            if done[node]:
                continue
            done[node] = True
            here, legal = field[node], moves[node]
            for move in range(8):
                if not (legal >> move) & 1:
                    continue
                there = node + offsets[move]
                near = any_tight and (tight[node] or tight[there])
                cost = here + _move_cost(move, near)
                known = field[there]
                if cost >= known:
                    continue
                field[there] = cost
                b = int(cost)
                if known < np.inf and int(known) == b:
                    continue
                if unused >= 0:
                    entry, unused = unused, entry_next[unused]
                else:
                    entry, used = used, used + 1
                entry_node[entry], entry_next[entry] = there, head[b & mask]
                head[b & mask] = entry
                live += 1
        bucket += 1


@kernel
def fields(moves, tight, offsets, any_tight, nodes, costs):  # type: ignore[no-untyped-def]
    """Cost in cells from each of n places to every node: (n, flat nodes); inf where no way leads.

    `nodes`, `costs` (n, j): the nodes by which a place joins the map (-1: none) and how far off it they lie.
    The costs of one place may differ by sqrt(2) at most, so that they fit into the ring of buckets.
    """
    count, size = nodes.shape[0], moves.size
    result = np.empty((count, size))
    # The ring is longer than the dearest move and the spread of the joins together, in buckets of 1.
    head = np.empty(16 if any_tight else 4, np.int64)
    # A node is entered once by each legal move into it, as every node is expanded once.
    entry_node = np.empty(8 * size + nodes.shape[1], np.int32)
    entry_next = np.empty(8 * size + nodes.shape[1], np.int32)
    done = np.empty(size, np.bool_)
    for i in range(count):
        _spread(
            moves,
            tight,
            offsets,
            any_tight,
            nodes[i],
            costs[i],
            head,
            entry_node,
            entry_next,
            done,
            result[i],
        )
    return result


@kernel
def trace_back(moves, tight, offsets, field, nodes, costs, goal, path):  # type: ignore[no-untyped-def]
    """Read a shortest path off a field, from `goal` back to the field's place, into `path`.

    Returns how many nodes were written and the length in cells. The length counts every move plainly, tight
    or not, and the way from the place to the node it joins by.
    """
    node, last, count, flown = goal, -1, 0, 0.0
    while True:
        path[count] = node
        count += 1
        here = field[node]
        for i in range(nodes.size):
            if nodes[i] == node and costs[i] <= here + _TIE:
                return count, flown + costs[i]
        chosen = -1
        for turn in range(9):
            move = last if turn == 0 else turn - 1
            if move < 0 or not (moves[node] >> move) & 1:
                continue
            there = node + offsets[move]
            if field[there] + _move_cost(move, tight[node] or tight[there]) <= here + _TIE:
                chosen = move
                break
        if chosen < 0:
            return 0, np.inf
        flown += _move_cost(chosen, False)
        node, last = node + offsets[chosen], chosen


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
def astar(moves, tight, offsets, stride, start, goal, paper, path):  # type: ignore[no-untyped-def]
    """Search one path with A* and write it to `path`, goal first.

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
            near = tight[node] or tight[there]
            step = (TIGHT if near else 1.0) if paper else _move_cost(move, near)
            if here + step >= cost[there] - 1e-12:
                continue
            cost[there] = here + step
            came_by[there] = move
            dr, dc = abs(there // stride - goal_row), abs(there % stride - goal_col)
            ahead = math.hypot(dr, dc) if paper else max(dr, dc) + (_DIAGONAL - 1.0) * min(dr, dc)
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


@dataclass(frozen=True, eq=False)
class GridPath:
    """A path from node to node.

    Attributes
    ----------
    nodes : ndarray of int, shape (k, 2)
        (row, col), both ends included. An end that lay inside an obstacle is replaced by `nearest_free`.
    length_m : float
        Length flown along the nodes, whatever the cost that was searched for.
    expanded : int
        How many nodes the search looked at: what it cost, independent of the machine.
    """

    nodes: IntArray
    length_m: float
    expanded: int


def find_path(
    grid: Grid, start: Node, goal: Node, cost: SearchCost = "metric", clearance_m: float = 0.0
) -> GridPath | None:
    """Search one path with A*; None if there is no way.

    A start or goal inside an obstacle is replaced by its `nearest_free` node.
    """
    ends = [end if not grid.blocked[end] else nearest_free(grid, end) for end in (start, goal)]
    if ends[0] is None or ends[1] is None:
        return None
    smap = search_map(grid, clearance_m)
    path = np.empty(smap.moves.size, dtype=np.int64)
    first, last = (flat_index(smap, end) for end in (ends[0], ends[1]))
    count, expanded = astar(
        smap.moves, smap.tight, smap.offsets, smap.stride, first, last, cost == "paper", path
    )
    if count == 0:
        return None
    rows, cols = np.divmod(path[:count][::-1], smap.stride)
    nodes = np.column_stack((rows - 1, cols - 1))
    diagonal = np.count_nonzero(np.abs(np.diff(nodes, axis=0)).sum(axis=1) == 2)
    return GridPath(nodes, (count - 1 - diagonal + _DIAGONAL * diagonal) * grid.spacing_m, int(expanded))


def distances_m(grid: Grid, source: Node) -> FloatArray:
    """Return the exact shortest path length from one node to all, (rows, cols); inf where no way leads.

    A source inside an obstacle reaches nothing.
    """
    smap = search_map(grid)
    rows, cols = grid.shape
    node = -1 if grid.blocked[source] else flat_index(smap, source)
    field: FloatArray = fields(
        smap.moves, smap.tight, smap.offsets, False, np.array([[node]]), np.zeros((1, 1))
    )[0]
    return field.reshape(rows + 2, cols + 2)[1:-1, 1:-1] * grid.spacing_m


def nearest_free(grid: Grid, node: Node) -> Node | None:
    """Return the free node nearest to one inside an obstacle, None on a map without any.

    Nearest in a straight line, among the nodes of the largest connected part of the map (a pocket enclosed by
    obstacles leads nowhere); of equally near ones the lowest row, then the lowest column.
    """
    rows, cols = grid.shape
    mainland = search_map(grid).mainland.reshape(rows + 2, cols + 2)[1:-1, 1:-1]
    free = np.argwhere(mainland)
    if not len(free):
        return None
    row, col = free[int(np.argmin(((free - np.array(node)) ** 2).sum(axis=1)))]
    return int(row), int(col)


def flat_index(smap: SearchMap, node: Node) -> int:
    """Return a node's index in the flat arrays of a search map."""
    return (node[0] + 1) * smap.stride + node[1] + 1
