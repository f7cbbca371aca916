"""Assignment of agents to targets: the Hungarian algorithm, with ranks and hysteresis.

The assignment minimises the total path length (Kuhn 1955, Munkres 1957; scipy's modified Jonker-Volgenant).
It makes as many pairs as possible first; length decides between assignments with as many pairs. Pairs without
a path get a finite cost above any total, and are dropped from the result.

Columns of lower rank are served first. A target that needs several agents has several columns. The objective
"longest" is the bottleneck assignment: minimise the longest path by bisection, then the total.

Hysteresis: position noise makes the optimum flicker, and each change costs two mission uploads. The current
assignment and the optimum differ by independent exchanges: the connected components (alternating paths and
cycles) of their symmetric difference. An exchange is made only if it serves more targets, or shortens the
total by more than a threshold. A gain in one component never justifies a swap in another.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, TypeAlias

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.model import FloatArray

Objective: TypeAlias = Literal["total", "longest"]
_ROUNDING_M = 1e-6
"""Gains below this are rounding errors."""


def assign(
    costs: FloatArray,
    current: Mapping[int, int],
    switch_gain_m: float = 0.0,
    ranks: Sequence[int] | None = None,
    objective: Objective = "total",
) -> dict[int, int]:
    """Assign rows (agents) to columns (targets, or agents needed at targets).

    Parameters
    ----------
    costs : ndarray, shape (n, m)
        Path length of each pair, not negative; inf without a path.
    current : mapping of int to int
        Assignment that is being flown, column by row. Pairs outside the matrix or without a path are ignored.
    switch_gain_m : float
        Gain that an exchange needs; inf: never exchange.
    ranks : sequence of int, length m
        Columns of lower rank are served first. Default: all equal.
    objective : "total" or "longest"
        Minimise the total length, or the longest path and then the total.

    Returns
    -------
    dict of int to int
        Column by row, in order of rows; never a pair without a path.
    """
    n, m = costs.shape
    weights = np.ones(m) if ranks is None else 1.0 + max(ranks, default=0) - np.array(ranks, dtype=np.float64)
    best = _optimum(costs, weights, objective)
    kept: dict[int, int] = {}
    for row, col in sorted(current.items()):
        if 0 <= row < n and 0 <= col < m and np.isfinite(costs[row, col]) and col not in kept.values():
            kept[row] = col
    if not kept or all(best.get(row) == col for row, col in kept.items()):
        return best
    rows = [row for row in range(n) if row not in kept]
    assigned = set(kept.values())
    cols = [col for col in range(m) if col not in assigned]
    added = _optimum(costs[np.ix_(rows, cols)], weights[cols], objective)
    kept |= {rows[i]: cols[j] for i, j in added.items()}
    total = sum if objective == "total" else _longest
    for exchange in _exchanges(kept, best):
        old = {row: kept[row] for row in exchange if row in kept}
        new = {row: best[row] for row in exchange if row in best}
        served = sum(weights[col] for col in new.values()) - sum(weights[col] for col in old.values())
        gain = total(costs[pair] for pair in old.items()) - total(costs[pair] for pair in new.items())
        if served > 0.5 or (served > -0.5 and gain > switch_gain_m + _ROUNDING_M):
            for row in old:
                del kept[row]
            kept |= new
    return dict(sorted(kept.items()))


def _longest(lengths: Iterable[float]) -> float:
    return max(lengths, default=0.0)


def _optimum(costs: FloatArray, weights: FloatArray, objective: Objective) -> dict[int, int]:
    """Return the assignment of the greatest served weight that is best by the objective."""
    if objective == "longest":
        costs = _without_longer(costs, weights)
    return _shortest(costs, weights)


def _shortest(costs: FloatArray, weights: FloatArray) -> dict[int, int]:
    """Return the assignment of the greatest served weight and, among these, the least total length.

    Column sets that can be served together form a matroid (Edmonds & Fulkerson 1965). A weight above any
    detour therefore serves columns of greater weight first.
    """
    finite = np.isfinite(costs)
    if not finite.any():
        return {}
    # Above the total of any assignment, so that one more pair always outweighs any detour.
    beyond = (float(costs[finite].max()) + 1.0) * (min(costs.shape) + 1)
    dropped = beyond * (float(weights.max()) + 1.0)
    rows, cols = linear_sum_assignment(np.where(finite, costs - beyond * weights, dropped))
    return {int(i): int(j) for i, j in zip(rows, cols, strict=True) if finite[i, j]}


def _without_longer(costs: FloatArray, weights: FloatArray) -> FloatArray:
    """Forbid paths longer than the bottleneck that the greatest served weight needs."""
    lengths = np.unique(costs[np.isfinite(costs)])
    if not lengths.size:
        return costs
    most = weights[list(_shortest(costs, weights).values())].sum()
    low, high = 0, lengths.size - 1
    while low < high:
        middle = (low + high) // 2
        some = np.where(costs <= lengths[middle], 0.0, np.inf)
        if weights[list(_shortest(some, weights).values())].sum() > most - 0.5:
            high = middle
        else:
            low = middle + 1
    return np.where(costs <= lengths[low], costs, np.inf)


def _exchanges(one: dict[int, int], other: dict[int, int]) -> list[list[int]]:
    """Return the rows of each connected component of the difference of two assignments, lowest row first."""
    row_of = ({col: row for row, col in one.items()}, {col: row for row, col in other.items()})
    left = {row for row in one.keys() | other.keys() if one.get(row) != other.get(row)}
    parts = []
    for first in sorted(left):
        if first not in left:
            continue
        part, front = [], [first]
        left.discard(first)
        while front:
            row = front.pop()
            part.append(row)
            for col in (one.get(row), other.get(row)):
                for holders in row_of:
                    holder = holders.get(col) if col is not None else None
                    if holder in left:
                        left.discard(holder)
                        front.append(holder)
        parts.append(sorted(part))
    return parts
