"""If who interacts with whom were decided wrongly, labels would be associated apart that want one detection,
or believed to depend on each other, or not to, that do."""

import itertools
import math
from collections import defaultdict

import numpy as np
import pytest

from gcs.tracking.clusters.factorisation import split_clusters
from gcs.tracking.clusters.merging import merge_clusters
from gcs.tracking.glmb.hypotheses import AssociationOptions, Clusters
from gcs.tracking.glmb.params import GlmbParams

LIMITS = GlmbParams(1.0, max_hypotheses=1000, prune_weight=1e-300, min_existence=0.01).limits()
MISSED, DIED = -1, -2


def grouped(groups):
    """Groups of hypotheses, (log-weight, tracks), as flat arrays."""
    hypotheses = [h for group in groups for h in group]
    items = [t for _, tracks in hypotheses for t in tracks]
    return Clusters(
        np.cumsum([0, *map(len, groups)]),
        np.cumsum([0, *(len(tracks) for _, tracks in hypotheses)]),
        np.array(items, np.int64),
        np.array([w for w, _ in hypotheses]),
    )


def listed(groups):
    return [
        [
            (
                math.exp(groups.logw[h]),
                frozenset(groups.items[groups.start[h] : groups.start[h + 1]].tolist()),
            )
            for h in range(low, high)
        ]
        for low, high in itertools.pairwise(groups.first)
    ]


def competition(seed):
    """Labels of one to three tracks, each a group, with options for few detections."""
    rng = np.random.default_rng(seed)
    groups, options, labels, t = [], [], [], 0
    for label in range(40):
        n = rng.integers(1, 4)
        weight = rng.dirichlet(np.ones(n + 1))
        groups.append([(math.log(w), [t + i]) for i, w in enumerate(weight[:n])])
        groups[-1].append((math.log(weight[n]), []))
        labels += [label] * n
        near = rng.integers(0, 80)
        for _ in range(n):
            gated = np.unique((near + rng.integers(0, 4, rng.integers(0, 4))) % 80)
            options.append([*((int(j), rng.normal(-1.0, 3.0)) for j in gated), (MISSED, -4.0), (DIED, -5.0)])
        t += n
    flat = [o for each in options for o in each]
    start = np.cumsum([0, *map(len, options)])
    return (
        groups,
        AssociationOptions(start, np.array([j for j, _ in flat]), np.array([w for _, w in flat])),
        labels,
    )


def in_conflict(groups, options, labels, bound):
    """Sets of labels that claim the same detections, as the theory says it: until nothing changes."""
    chance = defaultdict(float)
    for group in groups:
        for w, tracks in group:
            for t in tracks:
                chance[t] += math.exp(w)
    free, wanted = defaultdict(lambda: 1.0), defaultdict(lambda: defaultdict(float))
    for t, label in enumerate(labels):
        free[label] -= chance[t]
        for o in range(options.start[t], options.start[t + 1]):
            weight = chance[t] * math.exp(options.logw[o])
            if options.meas[o] < 0:
                free[label] += weight
            else:
                wanted[label][int(options.meas[o])] += weight
    contested, before = set(), None
    while contested != before:
        before = set(contested)
        claim = {}
        for label, wants in wanted.items():
            fallback = free[label] + sum(w for j, w in wants.items() if j not in before)
            for j, w in wants.items():
                claim[label, j] = w / (fallback + (w if j in before else 0.0))
        pairs = [
            (a, b, j)
            for (a, j), (b, k) in itertools.combinations(claim, 2)
            if j == k and claim[a, j] * claim[b, j] > bound
        ]
        contested |= {j for _, _, j in pairs}
    sets = {label: {label} for label in labels}
    for a, b, _ in pairs:
        joined = sets[a] | sets[b]
        for label in joined:
            sets[label] = joined
    return {frozenset(s) for s in sets.values()}


@pytest.mark.parametrize("seed", range(8))
def test_labels_meet_that_claim_the_same_detections(seed):
    groups, options, labels = competition(seed)
    bound = 10.0 ** -(1 + seed % 4)
    expected = in_conflict(groups, options, labels, bound)
    alone, several = merge_clusters(
        grouped(groups), options, np.array(labels), 80, LIMITS._replace(max_conflict=bound)
    )
    assert {frozenset({int(g)}) for g in alone} == {s for s in expected if len(s) == 1}
    together = {frozenset(labels[t] for _, held in group for t in held) for group in listed(several)}
    assert together == {s for s in expected if len(s) > 1}
    assert any(len(s) > 2 for s in expected)


def dependent(seed):
    """Return the product of a pair of labels that exclude each other and of some alone, and these."""
    rng = np.random.default_rng(seed)
    tracks = [[0, 1], [2, 3], [4, 5, 6], [7], [8, 9]]
    labels = [label for label, own in enumerate(tracks) for _ in own]
    pair = {(0, 3): 0.5, (1, 2): 0.3, (0,): 0.2}
    alone = []
    for own in tracks[2:]:
        weight = rng.dirichlet(np.ones(len(own)))
        alone.append({(t,): w for t, w in zip(own, weight, strict=True)})
    alone[0] = {held: 0.9 * w for held, w in alone[0].items()} | {(): 0.1}
    alone.append({(10,): 0.001, (): 0.999})
    product = [
        (math.prod(w for _, w in parts), [t for held, _ in parts for t in held])
        for parts in itertools.product(pair.items(), *(each.items() for each in alone))
    ]
    product.sort(key=lambda h: -h[0])
    return product, pair, alone, [*labels, 5]


@pytest.mark.parametrize("seed", range(5))
def test_labels_part_into_the_marginals_of_those_that_depend_on_each_other(seed):
    product, pair, alone, labels = dependent(seed)
    parted = split_clusters(
        grouped([[(math.log(w), held) for w, held in product]]), np.array(labels), 6, LIMITS
    )
    found = [{held: w for w, held in group} for group in listed(parted)]
    for group in listed(parted):
        assert [w for w, _ in group] == sorted((w for w, _ in group), reverse=True)
    # The last label is too improbable to go on.
    expected = [{frozenset(held): w for held, w in each.items()} for each in (pair, *alone[:-1])]
    assert len(found) == len(expected)
    for theirs, ours in zip(expected, found, strict=True):
        assert ours == pytest.approx(theirs, rel=1e-9)


def test_labels_that_all_depend_on_each_other_stay_as_they_are():
    group = [(math.log(0.6), [0, 2]), (math.log(0.3), [1]), (math.log(0.1), [2])]
    parted = split_clusters(grouped([group]), np.array([0, 0, 1]), 2, LIMITS)
    assert listed(parted) == listed(grouped([group]))
