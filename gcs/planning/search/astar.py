"""A*: the shortest path on the grid, in its plain form.

The open set is a heap that yields the node of least f (P. E. Hart, N. J. Nilsson, B. Raphael, IEEE Trans.
Systems Science and Cybernetics 4(2), 1968):

    f(n) = g(n) + h(n)

    g    cost of the cheapest known path from the start to n
    h    octile distance from n to the goal: no path costs less

So g of the goal is the least cost when the goal leaves the heap. An entry that a cheaper path has overtaken
changes nothing. All costs are in cells.

Plans use the fast form, `gcs.planning.search.bucket_astar`. Its tests compare it with this one.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator

from gcs.planning.search.canonical_ordering import DIAGONAL, TIGHT_MOVE_COST
from gcs.planning.search.neighbours import SearchMap


def astar(smap: SearchMap, start: int, goal: int) -> tuple[list[int], float]:
    """Return the flat nodes of a path of least cost, and its cost; no nodes and inf without a path."""
    costs = {start: 0.0}
    came_from: dict[int, int] = {}
    open_nodes = [(_octile(smap, start, goal), start)]
    while open_nodes:
        _, node = heapq.heappop(open_nodes)
        if node == goal:
            return _trace(came_from, goal), costs[goal]
        for there, step in _neighbours(smap, node):
            cost = costs[node] + step
            if cost < costs.get(there, math.inf):
                costs[there] = cost
                came_from[there] = node
                heapq.heappush(open_nodes, (cost + _octile(smap, there, goal), there))
    return [], math.inf


def _neighbours(smap: SearchMap, node: int) -> Iterator[tuple[int, float]]:
    """Yield the nodes that legal moves lead to, and the costs of the moves."""
    for move, offset in enumerate(smap.offsets.tolist()):
        if (smap.moves[node] >> move) & 1:
            is_tight = (smap.tight_moves[node] >> move) & 1
            yield node + offset, (1.0 if move < 4 else DIAGONAL) * (TIGHT_MOVE_COST if is_tight else 1.0)


def _octile(smap: SearchMap, node: int, goal: int) -> float:
    """Return the length of the shortest path without obstacles."""
    row, col = divmod(node, smap.stride)
    goal_row, goal_col = divmod(goal, smap.stride)
    rows = abs(row - goal_row)
    cols = abs(col - goal_col)
    return max(rows, cols) + (DIAGONAL - 1.0) * min(rows, cols)


def _trace(came_from: dict[int, int], goal: int) -> list[int]:
    """Return the nodes of the path to the goal."""
    path = [goal]
    while path[-1] in came_from:
        path.append(came_from[path[-1]])
    return path[::-1]
