"""Who flies to which target: the Hungarian assignment, with unreachable pairs and with patience.

The assignment minimises the team's total path length (Kuhn 1955, Munkres 1957; scipy's modified
Jonker-Volgenant). With more targets than agents every agent gets one and the targets whose service would cost
most are left out; with fewer, the agents whose service would cost most stay spare. As many pairs as possible
are made first: total length decides only between assignments of as many pairs. scipy refuses a matrix without
a finite solution, so a pair without a way gets a finite cost above any possible total, and is dropped from
the result.

Patience: positions are estimates, so the optimum flickers between assignments that differ by less than the
noise, and each flicker is a new mission for two vehicles. The current assignment, completed for whoever is
free, and the optimum differ by independent exchanges: chains and rings of agents that pass targets on to one
another (the connected parts of the symmetric difference of the two). An exchange is made only if it serves
more targets, or if it shortens the team's way by more than the threshold. So a gain at one end of a big swarm
never licenses a pointless swap at the other.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.model import FloatArray

_ROUNDING_M = 1e-6
"""Gains below this are rounding errors, not gains: equals stay as they are."""


def assign(costs: FloatArray, current: Mapping[int, int], switch_gain_m: float = 0.0) -> dict[int, int]:
    """Assign rows (agents) to columns (targets).

    Parameters
    ----------
    costs : ndarray, shape (n, m)
        Length of the way of each agent to each target, not negative; inf where there is none.
    current : mapping of int to int
        The row-to-column assignment that is being flown; pairs outside the matrix or without a way count as
        gone.
    switch_gain_m : float
        By how much an exchange must shorten the total before it is made; inf: never exchange.

    Returns
    -------
    dict of int to int
        Column by row, in order of the rows; never a pair without a way.
    """
    best = _optimum(costs)
    n, m = costs.shape
    kept: dict[int, int] = {}
    for row, col in sorted(current.items()):
        if 0 <= row < n and 0 <= col < m and np.isfinite(costs[row, col]) and col not in kept.values():
            kept[row] = col
    if not kept or all(best.get(row) == col for row, col in kept.items()):
        return best
    rows = [row for row in range(n) if row not in kept]
    taken = set(kept.values())
    cols = [col for col in range(m) if col not in taken]
    kept |= {rows[i]: cols[j] for i, j in _optimum(costs[np.ix_(rows, cols)]).items()}
    for exchange in _exchanges(kept, best):
        old = {row: kept[row] for row in exchange if row in kept}
        new = {row: best[row] for row in exchange if row in best}
        gain = sum(costs[pair] for pair in old.items()) - sum(costs[pair] for pair in new.items())
        if len(new) > len(old) or (len(new) == len(old) and gain > switch_gain_m + _ROUNDING_M):
            for row in old:
                del kept[row]
            kept |= new
    return dict(sorted(kept.items()))


def _optimum(costs: FloatArray) -> dict[int, int]:
    """Return the assignment of most pairs and, among these, least total."""
    if costs.size == 0:
        return {}
    finite = np.isfinite(costs)
    if not finite.any():
        return {}
    # Above the total of any assignment, so that one more pair always outweighs any detour.
    beyond = (float(costs[finite].max()) + 1.0) * (min(costs.shape) + 1)
    rows, cols = linear_sum_assignment(np.where(finite, costs, beyond))
    return {int(i): int(j) for i, j in zip(rows, cols, strict=True) if finite[i, j]}


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
