"""A* on buckets from one place to another: the shortest path on the grid.

The octile distance is the heuristic, so the path is the shortest. The open set is a ring of buckets by
estimated cost (after R. B. Dial, CACM 12, 1969). Each bucket is a stack, so equal estimates are expanded
depth first. A bucket holds more than one estimate, so a node may be reached by a longer path first and is
then reopened. Only moves of the canonical ordering are expanded (`gcs.planning.search.canonical_ordering`).

The plain form, on a heap and without the ordering, is `gcs.planning.search.astar`. It is the reference of
the tests.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gcs.jit import inlined, int64, kernel, leaf, prefetch_row
from gcs.model import FloatArray, Int32Array, IntArray, UInt32Array
from gcs.planning.search.canonical_ordering import (
    ARRIVAL_MASK,
    COL_STEP,
    LIST_MASK,
    NO_MOVE,
    ROW_STEP,
    TIGHT_BIT,
    move_length,
    octile,
)

_BUCKETS_PER_CELL = 2
"""Buckets per cell of estimated cost."""

_COST_EPSILON = 1e-10
"""Improvements below this are rounding errors."""

_FULL_CLEAR_RATIO = 16
"""Clearing the whole array takes as long as this many times fewer single entries."""

_SPARE_ENTRIES = 8
"""Entries that the expansion of one node may add."""

_CLOSED_BIT = 1 << 28
"""Set in the packed word of a node that has been expanded."""

_MAP_BITS = ~(_CLOSED_BIT | ARRIVAL_MASK)

_ROW_STEPS = np.array(ROW_STEP)
_COL_STEPS = np.array(COL_STEP)


class _Moves(NamedTuple):
    """Moves of the map (see `gcs.planning.search.neighbours.SearchMap`)."""

    move_lists: UInt32Array
    has_tight_moves: bool
    offsets: IntArray
    stride: int
    per_row: float


class _Ends(NamedTuple):
    """Nodes that connect the two places to the grid (-1: none), (j,) and (k,), and their distances."""

    nodes: IntArray
    costs: FloatArray
    goals: IntArray
    goal_costs: FloatArray


class _Aim(NamedTuple):
    """Goal node that the estimates aim at. Bucket 0 begins at the estimate `base`.

    Another goal node may be the last one if its estimate is less than `slack` worse.
    """

    row: int
    col: int
    slack: float
    base: float


class _Work(NamedTuple):
    """Work arrays.

    =======  =============  =======  ============================================================
    reached  (flat nodes,)  float64  cost so far plus one; 0 means not reached
    packed   (flat nodes,)  uint32   packed words; arrival moves are written to them
    entries  (n, 2)         int32    node and next entry of its bucket; they list the nodes to reset
    head     (ring,)        int64    first entry of each bucket, -1 for none
    =======  =============  =======  ============================================================
    """

    reached: FloatArray
    packed: UInt32Array
    entries: Int32Array
    head: IntArray


@inlined
def _row_of(node: int, per_row: float) -> int:
    """Return the row of a flat node, by a multiplication: a division takes longer than all else."""
    return int((node + 0.5) * per_row)


@inlined
def _distance(node: int, stride: int, row: int, col: int) -> float:
    """Return the octile distance of a flat node from a row and column."""
    at = _row_of(node, 1.0 / stride)
    return octile(abs(at - row), abs(node - at * stride - col))


@leaf
def _find_aim(ends: _Ends, stride: int) -> _Aim:
    """Return the first goal node as aim; there is one."""
    aim = int64(-1)
    for k in range(ends.goals.size):
        aim = ends.goals[k] if aim < 0 else aim
    row = _row_of(aim, 1.0 / stride)
    col = aim - row * stride
    slack = -np.inf
    for k in range(ends.goals.size):
        if ends.goals[k] >= 0:
            slack = max(slack, _distance(ends.goals[k], stride, row, col) - ends.goal_costs[k])
    base = np.inf
    for i in range(ends.nodes.size):
        if ends.nodes[i] >= 0:
            base = min(base, ends.costs[i] + _distance(ends.nodes[i], stride, row, col))
    return _Aim(row, col, slack, base - 1e-6)


@inlined
def _push(work: _Work, used: int, slot: int, node: int) -> int:
    """Add an entry to a bucket; return the number of entries."""
    work.entries[used, 0] = node
    work.entries[used, 1] = work.head[slot]
    work.head[slot] = used
    return used + 1


@inlined
def _push_start(ends: _Ends, aim: _Aim, stride: int, work: _Work) -> int:
    """Add the nodes of the first place; return the number of entries."""
    used = 0
    for i in range(ends.nodes.size):
        node = ends.nodes[i]
        reached = ends.costs[i] + 1.0
        if node < 0 or (work.reached[node] != 0.0 and reached >= work.reached[node]):
            continue
        work.reached[node] = reached
        work.packed[node] = (work.packed[node] & _MAP_BITS) | NO_MOVE
        estimate = ends.costs[i] + _distance(node, stride, aim.row, aim.col)
        slot = int((estimate - aim.base) * _BUCKETS_PER_CELL) & (work.head.size - 1)
        used = _push(work, used, slot, node)
    return used


@inlined
def _expand(moves: _Moves, aim: _Aim, node: int, limit: float, bucket: int, work: _Work, used: int) -> int:
    """Relax the moves of a node to estimates below `limit`; return the number of entries."""
    row = _row_of(node, moves.per_row)
    col = node - row * moves.stride - aim.col
    row -= aim.row
    here = work.reached[node]
    word = int64(work.packed[node])
    left = int64(moves.move_lists[word & LIST_MASK])
    for k in range(left & 15):
        move = (left >> (4 + 3 * k)) & 7
        there = node + moves.offsets[move]
        cost = here + move_length(move, moves.has_tight_moves and (word >> (TIGHT_BIT + move)) & 1)
        before = work.reached[there]
        if before != 0.0 and cost >= before - _COST_EPSILON:
            continue
        estimate = cost - 1.0 + octile(abs(row + _ROW_STEPS[move]), abs(col + _COL_STEPS[move]))
        if estimate >= limit:
            continue
        work.reached[there] = cost
        work.packed[there] = (work.packed[there] & _MAP_BITS) | move
        to = max(int((estimate - aim.base) * _BUCKETS_PER_CELL), bucket)
        used = _push(work, used, to & (work.head.size - 1), there)
        # Most paths go straight on.
        prefetch_row(work.reached, there + moves.offsets[move])
        prefetch_row(work.packed, there + moves.offsets[move])
    return used


@leaf
def _search(moves: _Moves, ends: _Ends, aim: _Aim, work: _Work) -> tuple[int, float, int, int]:
    """Search; return the last node (-1: none), the cost, and the numbers of entries and expanded nodes."""
    used = _push_start(ends, aim, moves.stride, work)
    live = used
    best = np.inf
    last = int64(-1)
    bucket = 0
    expanded = 0
    full = work.entries.shape[0] - _SPARE_ENTRIES
    while live > 0 and used <= full and aim.base + bucket / _BUCKETS_PER_CELL < best + aim.slack:
        slot = bucket & (work.head.size - 1)
        while work.head[slot] >= 0 and used <= full:
            entry = work.head[slot]
            node = int64(work.entries[entry, 0])
            work.head[slot] = work.entries[entry, 1]
            live -= 1
            word = int64(work.packed[node])
            if word & _CLOSED_BIT:
                continue
            work.packed[node] = word | _CLOSED_BIT
            expanded += 1
            row = _row_of(node, moves.per_row)
            if abs(row - aim.row) <= 1 and abs(node - row * moves.stride - aim.col) <= 1:
                for k in range(ends.goals.size):
                    cost = work.reached[node] - 1.0 + ends.goal_costs[k]
                    if ends.goals[k] == node and cost < best:
                        best = cost
                        last = node
            before = used
            used = _expand(moves, aim, node, best + aim.slack, bucket, work, used)
            live += used - before
        bucket += 1
    return last, best, used, expanded


@inlined
def _clear(work: _Work, used: int) -> None:
    """Set `reached` to zeros again."""
    if used * _FULL_CLEAR_RATIO > work.reached.size:
        work.reached[:] = 0.0
    else:
        for i in range(used):
            work.reached[work.entries[i, 0]] = 0.0


@inlined
def _trace(last: int, offsets: IntArray, packed: UInt32Array, path: IntArray) -> tuple[int, float]:
    """Write the path to `path`, last node first; return the number of nodes and the length in cells."""
    count = 0
    length = np.inf if last < 0 else 0.0
    node = last
    while node >= 0:
        path[count] = node
        count += 1
        move = int64(packed[node]) & ARRIVAL_MASK
        if move == NO_MOVE:
            break
        length += move_length(move, False)
        node -= offsets[move]
    return count, length


@kernel
def bucket_astar(
    move_lists: UInt32Array, has_tight_moves: bool, offsets: IntArray, stride: int, nodes: IntArray,
    costs: FloatArray, goals: IntArray, goal_costs: FloatArray, reached: FloatArray, packed: UInt32Array,
    entries: Int32Array, path: IntArray,
) -> tuple[int, float, float, int]:  # fmt: skip
    """Search the shortest path between two places and write it to `path`, last node first.

    The arguments are fields of the records above: a record from Python costs a tenth of a short search.
    `reached` must be zeros, and is zeros again afterwards. Returns the number of nodes written (0: no path,
    -1: `entries` too short), the cost in cells between the places (inf: no path), the length from first to
    last node without clearance costs, and the number of expanded nodes.
    """
    has_goal = False
    for k in range(goals.size):
        has_goal |= goals[k] >= 0
    if not has_goal:
        return 0, np.inf, np.inf, 0
    moves = _Moves(move_lists, has_tight_moves, offsets, stride, 1.0 / stride)
    ends = _Ends(nodes, costs, goals, goal_costs)
    work = _Work(reached, packed, entries, np.full(64 if has_tight_moves else 16, -1))
    last, best, used, expanded = _search(moves, ends, _find_aim(ends, stride), work)
    _clear(work, used)
    if used > entries.shape[0] - _SPARE_ENTRIES:
        return -1, np.inf, np.inf, expanded
    count, length = _trace(last, offsets, packed, path)
    return count, best, length, expanded
