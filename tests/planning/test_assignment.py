"""Who flies where: optimal, never to where no way leads, and not swapped for a trifle."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.planning.assignment import CHANGE_FRACTION, assign, with_change_costs


@st.composite
def cost_matrices(draw, max_side=5):
    n, m = draw(st.integers(0, max_side)), draw(st.integers(0, max_side))
    cell = st.one_of(st.integers(0, 60).map(float), st.just(math.inf))
    return np.array(draw(st.lists(cell, min_size=n * m, max_size=n * m))).reshape(n, m)


def all_assignments(costs):
    """Every set of pairs with a way, by brute force."""
    n, m = costs.shape
    for choice in itertools.product([None, *range(m)], repeat=n):
        used = [j for j in choice if j is not None]
        if len(set(used)) == len(used):
            pairs = {i: j for i, j in enumerate(choice) if j is not None}
            if all(math.isfinite(costs[p]) for p in pairs.items()):
                yield pairs


def worth(costs, pairs):
    """Sort key: more pairs first, then the shorter total."""
    return -len(pairs), sum(costs[p] for p in pairs.items())


@st.composite
def flown_assignments(draw, costs):
    n, m = costs.shape
    cols = draw(st.permutations(range(m)))
    rows = draw(st.permutations(range(n)))
    return dict(list(zip(rows, cols, strict=False))[: draw(st.integers(0, max(n, m)))])


def reassigned(costs, flown, gain=0.0):
    """The assignment of agents that fly to targets already: column by row."""
    columns = [flown.get(row, -1) for row in range(costs.shape[0])]
    return assign(with_change_costs(costs, columns, gain))


@settings(max_examples=200)
@given(cost_matrices())
def test_who_flies_nowhere_gets_the_best_assignment_there_is(costs):
    found = assign(costs)
    assert worth(costs, found) == pytest.approx(min(worth(costs, p) for p in all_assignments(costs)))
    assert len(set(found.values())) == len(found)
    assert list(found) == sorted(found)


@settings(max_examples=300)
@given(cost_matrices(), st.data())
def test_keeping_targets_costs_no_target_and_at_most_the_stated_fraction_of_the_optimum(costs, data):
    flown = data.draw(flown_assignments(costs))
    found = reassigned(costs, flown)
    pairs, total = min(worth(costs, p) for p in all_assignments(costs))
    assert -len(found) == pairs
    assert sum(costs[p] for p in found.items()) <= (1.0 + CHANGE_FRACTION) * total + 1e-6
    assert reassigned(costs, flown) == found
    assert list(found) == sorted(found)


@settings(max_examples=200)
@given(cost_matrices(), st.data(), st.integers(0, 60))
def test_a_gain_to_be_made_costs_no_more_than_itself_for_each_swap(costs, data, gain):
    found = reassigned(costs, data.draw(flown_assignments(costs)), gain)
    pairs, total = min(worth(costs, p) for p in all_assignments(costs))
    assert -len(found) == pairs
    assert sum(costs[p] for p in found.items()) <= (1.0 + CHANGE_FRACTION) * (total - gain * pairs / 2) + 1e-6


@settings(max_examples=200)
@given(cost_matrices(), st.data(), st.integers(0, 60))
def test_each_agent_that_changes_target_saves_half_the_gain(costs, data, gain):
    """Given an assignment that serves as many as can be: what is changed pays for all who change."""
    most = len(assign(costs))
    full = data.draw(st.sampled_from([p for p in all_assignments(costs) if len(p) == most]))
    found = reassigned(costs, full, gain)
    changed = sum(full.get(row) != column for row, column in found.items())
    saved = sum(costs[p] for p in full.items()) - sum(costs[p] for p in found.items())
    assert saved >= 0.5 * gain * changed - 1e-6


def test_agents_do_not_swap_for_less_than_the_gain():
    costs = np.array([[100.0, 90.0], [90.0, 100.0]])
    straight = {0: 0, 1: 1}
    assert reassigned(costs, straight, 50.0) == straight
    assert reassigned(costs, straight, 17.0) == straight
    assert reassigned(costs, straight, 16.0) == {0: 1, 1: 0}


def test_equally_good_assignments_are_left_as_they_are():
    costs = np.full((3, 3), 70.0)
    for flown in itertools.permutations(range(3)):
        assert reassigned(costs, dict(enumerate(flown))) == dict(enumerate(flown))


def test_a_gain_at_one_end_of_the_swarm_does_not_license_a_swap_at_the_other():
    costs = np.full((4, 4), 1e4)
    costs[:2, :2] = [[900.0, 100.0], [100.0, 900.0]]
    costs[2:, 2:] = [[101.0, 100.0], [100.0, 101.0]]
    assert reassigned(costs, {0: 0, 1: 1, 2: 2, 3: 3}) == {0: 1, 1: 0, 2: 2, 3: 3}


def test_a_chain_of_small_gains_does_not_send_a_whole_swarm_elsewhere():
    """Each agent would save 5 m of 1000 m with the target of its neighbour, and all must change for it."""
    n = 20
    costs = np.full((n, n), 2000.0)
    costs[np.arange(n), np.arange(n)] = 1000.0
    costs[np.arange(n), (np.arange(n) + 1) % n] = 995.0
    own = {row: row for row in range(n)}
    assert not assign(costs).items() & own.items()
    assert reassigned(costs, own) == own


def test_more_targets_than_agents_leaves_out_the_farthest():
    costs = np.array([[10.0, 500.0, 40.0], [20.0, 600.0, 30.0]])
    assert assign(costs) == {0: 0, 1: 2}


def test_fewer_targets_than_agents_leaves_surplus_agents():
    costs = np.array([[10.0], [5.0], [20.0]])
    assert assign(costs) == {1: 0}
    assert reassigned(costs, {0: 0}, 10.0) == {0: 0}


def test_the_target_of_a_lost_agent_goes_to_another():
    """Agents 0 and 1 fly to 0 and 1; the agent that flew to target 2 is gone, and 2 is now nearest to agent
    1."""
    costs = np.array([[10.0, 400.0, 400.0], [400.0, 300.0, 50.0]])
    assert reassigned(costs, {0: 0, 1: 1}, 100.0) == {0: 0, 1: 2}


def test_an_unreachable_pair_is_never_made_and_does_not_stop_the_others():
    costs = np.array([[math.inf, 10.0], [math.inf, 20.0]])
    assert assign(costs) == {0: 1}
    assert reassigned(np.full((2, 3), math.inf), {0: 0}) == {}


def test_a_target_more_outweighs_any_detour():
    costs = np.array([[1.0, 2.0], [5000.0, math.inf]])
    assert reassigned(costs, {0: 0}, math.inf) == {0: 1, 1: 0}


def test_a_swarm_without_agents_or_targets_has_no_assignment():
    assert reassigned(np.empty((0, 4)), {}) == reassigned(np.empty((4, 0)), {}) == {}


@settings(max_examples=200)
@given(cost_matrices(), st.data())
def test_what_ranks_first_is_served_first(costs, data):
    ranks = data.draw(st.lists(st.integers(0, 3), min_size=costs.shape[1], max_size=costs.shape[1]))

    def worth_by_rank(pairs):
        served = [ranks[j] for j in pairs.values()]
        return *(-served.count(rank) for rank in range(4)), sum(costs[p] for p in pairs.items())

    found = assign(costs, ranks)
    most = max(len(p) for p in all_assignments(costs))
    full = [p for p in all_assignments(costs) if len(p) == most]
    assert worth_by_rank(found) == pytest.approx(min(worth_by_rank(p) for p in full))
