"""Assignment of agents to targets (Hungarian), with ranks, pins, and the gain that a change must have.

The assignment minimises the total path length (Kuhn 1955, Munkres 1957; scipy's modified Jonker-Volgenant).
It makes as many pairs as possible first; length decides between assignments with as many pairs. Pairs without
a path get a finite cost above any total, and are dropped from the result.

Columns of lower rank are served first. A target that needs several agents has several columns.

Each agent that changes its target gets a new mission, and the optimum of a large swarm changes in long chains
for a few metres. So `with_change_costs` makes the pairs that are flown cheaper before the assignment. A pair
of cost c counts c / (1 + f) with f = `CHANGE_FRACTION` if it is flown, and c + g / 2 if not: a swap of two
agents must gain g. With g = 0 the true total T of the assignment X that is found and of the optimum B obey

    T(X) / (1 + f) <= counted(X) <= counted(B) <= T(B),

so keeping targets never costs more than the fraction f of the optimum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.model import FloatArray, Label
from gcs.planning.map.grid import Point
from gcs.planning.planner_inputs import AgentState, TargetDemand

CHANGE_FRACTION = 0.02
"""Greatest increase of the total that keeping targets may cost, as a fraction of the optimum."""
_MAX_GAIN_M = 1e8
"""Gain that no exchange has. An infinite one would leave no other pair than those that are flown."""
_GROUNDED_COST = 1e6
"""Added cost of an agent on the ground: one in the air serves its target, however far it is."""
_DOUBTFUL_COST = 2e6
"""Added cost of an agent that rejected its last mission: any other serves its target."""
_UNFIT_COST = 1e7
"""Cost of an unfit agent that keeps its target: any other agent goes first."""


def with_change_costs(costs: FloatArray, flown: Sequence[int], switch_gain_m: float = 0.0) -> FloatArray:
    """Return the costs as the assignment counts them: less for pairs that are flown, more for others.

    Parameters
    ----------
    costs : ndarray, shape (n, m)
        Path length of each pair, not negative; inf without a path.
    flown : sequence of int, length n
        Column that each row flies to, -1 for none.
    switch_gain_m : float
        Further gain that a swap of two rows needs, and each changed row half of it; inf: never change.
    """
    counted: FloatArray = costs + 0.5 * min(switch_gain_m, _MAX_GAIN_M)
    for row, column in enumerate(flown):
        if column >= 0:
            counted[row, column] = costs[row, column] / (1.0 + CHANGE_FRACTION)
    return counted


def fit_costs(
    costs: FloatArray, agents: Sequence[AgentState], targets: Sequence[Point], flown_to: Sequence[int]
) -> FloatArray:
    """Return the costs without forbidden targets; agents in the air go first, doubtful and unfit ones last.

    `flown_to` has the target that each agent flies to, -1 for none.
    """
    unfit = np.array([agent.is_unfit for agent in agents])
    if unfit.any():
        costs = np.where(unfit[:, None], math.inf, costs)
        for i in np.flatnonzero(unfit).tolist():
            if flown_to[i] >= 0:
                costs[i, flown_to[i]] = _UNFIT_COST
    grounded = np.array([agent.is_grounded for agent in agents])
    if grounded.any() and not grounded.all():
        costs = costs + _GROUNDED_COST * grounded[:, None]
    doubtful = np.array([agent.is_doubtful for agent in agents])
    if doubtful.any() and not doubtful.all():
        costs = costs + _DOUBTFUL_COST * doubtful[:, None]
    limited = [i for i, agent in enumerate(agents) if agent.range_m < math.inf]
    if limited:
        costs = costs.copy()
    for i in limited:
        agent = agents[i]
        for j, target in enumerate(targets):
            length_m = math.dist((agent.east_m, agent.north_m), target) + math.dist(target, agent.home_m)
            if length_m > agent.range_m:
                costs[i, j] = math.inf
    return costs


def pinned_costs(
    costs: FloatArray,
    agents: Sequence[AgentState],
    labels: Sequence[Label],
    needs: Sequence[TargetDemand],
) -> FloatArray:
    """Return the costs without the other targets of pinned agents, and without their competitors."""
    pairs = [(i, labels.index(agent.pinned)) for i, agent in enumerate(agents) if agent.pinned in labels]
    pairs = [(i, j) for i, j in pairs if np.isfinite(costs[i, j])]
    if not pairs:
        return costs
    allowed = np.ones(costs.shape, np.bool_)
    for j in {j for _, j in pairs}:
        rows = [i for i, other in pairs if other == j]
        if len(rows) >= needs[j].agents:
            allowed[:, j] = False
    for i, j in pairs:
        allowed[i] = False
        allowed[i, j] = True
    return np.where(allowed, costs, np.inf)


def assign(costs: FloatArray, ranks: Sequence[int] | None = None) -> dict[int, int]:
    """Assign rows (agents) to columns (targets, or agents needed at targets).

    Parameters
    ----------
    costs : ndarray, shape (n, m)
        Cost of each pair, not negative; inf without a path.
    ranks : sequence of int, length m
        Columns of lower rank are served first. Default: all equal.

    Returns
    -------
    dict of int to int
        Column by row, in order of rows; never a pair without a path.

    Notes
    -----
    Column sets that can be served together form a matroid (Edmonds & Fulkerson 1965). A weight above any
    detour therefore serves columns of lower rank first.
    """
    weights = np.ones(costs.shape[1])
    if ranks is not None:
        weights += max(ranks, default=0) - np.array(ranks, dtype=np.float64)
    finite = np.isfinite(costs)
    if not finite.any():
        return {}
    # Above the total of any assignment, so that one more pair always outweighs any detour.
    beyond = (float(costs[finite].max()) + 1.0) * (min(costs.shape) + 1)
    dropped = beyond * (float(weights.max()) + 1.0)
    rows, cols = linear_sum_assignment(np.where(finite, costs - beyond * weights, dropped))
    return {int(i): int(j) for i, j in zip(rows, cols, strict=True) if finite[i, j]}


def assign_agents(costs: FloatArray, needs: Sequence[TargetDemand]) -> dict[int, int]:
    """Return the target index of each assigned agent. A target has one column per agent that it needs."""
    columns = [j for j, demand in enumerate(needs) for _ in range(demand.agents)]
    pairs = assign(costs[:, columns], [needs[j].rank for j in columns])
    return {i: columns[column] for i, column in pairs.items()}
