"""Who flies to which target: the Hungarian assignment, with unreachable pairs and with patience.

The assignment minimises the team's total path length (Kuhn 1955, Munkres 1957; scipy's modified
Jonker-Volgenant). With more targets than agents every agent gets one and the targets whose service would cost
most are left out; with fewer, the agents whose service would cost most stay spare. As many pairs as possible
are made first: total length decides only between assignments of as many pairs. scipy refuses a matrix without
a finite solution, so a pair without a way gets a finite cost above any possible total, and is dropped from
the result.

Columns may have ranks: those of lower rank are served before all others. A target that needs several agents
has as many columns. Instead of the team's total, the longest way can be made as short as possible (the
bottleneck assignment, by bisection over the lengths), and only then the total.

Patience: positions are estimates, so the optimum flickers between assignments that differ by less than the
noise, and each flicker is a new mission for two vehicles. The current assignment, completed for whoever is
free, and the optimum differ by independent exchanges: chains and rings of agents that pass targets on to one
another (the connected parts of the symmetric difference of the two). An exchange is made only if it serves
more targets, or if it shortens the team's way by more than the threshold. So a gain at one end of a big swarm
never licenses a pointless swap at the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, TypeAlias

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.model import FloatArray

Objective: TypeAlias = Literal["total", "longest"]
_ROUNDING_M = 1e-6
"""Gains below this are rounding errors, not gains: equals stay as they are."""


def assign(
    costs: FloatArray,
    current: Mapping[int, int],
    switch_gain_m: float = 0.0,
    ranks: Sequence[int] | None = None,
    objective: Objective = "total",
) -> dict[int, int]:
    """Assign rows (agents) to columns (targets, or places at targets that need several).

    Parameters
    ----------
    costs : ndarray, shape (n, m)
        Length of the way of each agent to each target, not negative; inf where there is none.
    current : mapping of int to int
        The row-to-column assignment that is being flown; pairs outside the matrix or without a way count as
        gone.
    switch_gain_m : float
        By how much an exchange must shorten the total (or the longest way) before it is made; inf: never
        exchange.
    ranks : sequence of int, length m
        Columns of lower rank are served first, whatever it costs; all the same by default.
    objective : "total" or "longest"
        What is made as short as can be: all ways together, or the longest of them and then all together.

    Returns
    -------
    dict of int to int
        Column by row, in order of the rows; never a pair without a way.
    """
    n, m = costs.shape
    worth = np.ones(m) if ranks is None else 1.0 + max(ranks, default=0) - np.array(ranks, dtype=np.float64)
    best = _optimum(costs, worth, objective)
    kept: dict[int, int] = {}
    for row, col in sorted(current.items()):
        if 0 <= row < n and 0 <= col < m and np.isfinite(costs[row, col]) and col not in kept.values():
            kept[row] = col
    if not kept or all(best.get(row) == col for row, col in kept.items()):
        return best
    rows = [row for row in range(n) if row not in kept]
    taken = set(kept.values())
    cols = [col for col in range(m) if col not in taken]
    added = _optimum(costs[np.ix_(rows, cols)], worth[cols], objective)
    kept |= {rows[i]: cols[j] for i, j in added.items()}
    measure = sum if objective == "total" else _longest
    for exchange in _exchanges(kept, best):
        old = {row: kept[row] for row in exchange if row in kept}
        new = {row: best[row] for row in exchange if row in best}
        served = sum(worth[col] for col in new.values()) - sum(worth[col] for col in old.values())
        gain = measure(costs[pair] for pair in old.items()) - measure(costs[pair] for pair in new.items())
        if served > 0.5 or (served > -0.5 and gain > switch_gain_m + _ROUNDING_M):
            for row in old:
                del kept[row]
            kept |= new
    return dict(sorted(kept.items()))


def _longest(lengths: Iterable[float]) -> float:
    return max(lengths, default=0.0)


def _optimum(costs: FloatArray, worth: FloatArray, objective: Objective) -> dict[int, int]:
    """Return the assignment that serves most worth and, among these, is best by the objective."""
    if objective == "longest":
        costs = _without_longer(costs, worth)
    return _shortest(costs, worth)


def _shortest(costs: FloatArray, worth: FloatArray) -> dict[int, int]:
    """Return the assignment that serves most worth and, among these, has the least total.

    A worth counts more than any detour. That serves columns of more worth first, too: sets of columns that
    can be served together form a matroid (Edmonds & Fulkerson 1965), in which the best by any weights is
    found by taking the heaviest first.
    """
    finite = np.isfinite(costs)
    if not finite.any():
        return {}
    # Above the total of any assignment, so that one more pair always outweighs any detour.
    beyond = (float(costs[finite].max()) + 1.0) * (min(costs.shape) + 1)
    dropped = beyond * (float(worth.max()) + 1.0)
    rows, cols = linear_sum_assignment(np.where(finite, costs - beyond * worth, dropped))
    return {int(i): int(j) for i, j in zip(rows, cols, strict=True) if finite[i, j]}


def _without_longer(costs: FloatArray, worth: FloatArray) -> FloatArray:
    """Forbid ways longer than the longest that is needed to serve as much worth as can be."""
    lengths = np.unique(costs[np.isfinite(costs)])
    if not lengths.size:
        return costs
    most = worth[list(_shortest(costs, worth).values())].sum()
    low, high = 0, lengths.size - 1
    while low < high:
        middle = (low + high) // 2
        some = np.where(costs <= lengths[middle], 0.0, np.inf)
        if worth[list(_shortest(some, worth).values())].sum() > most - 0.5:
            high = middle
        else:
            low = middle + 1
    return np.where(costs <= lengths[low], costs, np.inf)


def _exchanges(one: dict[int, int], other: dict[int, int]) -> list[list[int]]:
    """Return the rows of each connected part of the difference of two assignments, lowest row first."""
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
