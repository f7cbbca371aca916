"""Wrong clusters would associate competing labels separately, or keep independent labels together."""

import itertools
import math
from collections import defaultdict

import numpy as np
import pytest

from gcs.tracking.clusters.cluster_product import merge_clusters
from gcs.tracking.clusters.factorisation import split_clusters
from gcs.tracking.glmb.hypotheses import AssociationOptions, Clusters
from gcs.tracking.glmb.params import GlmbParams

LIMITS = GlmbParams(1.0, max_hypotheses=1000, prune_weight=1e-300, min_existence=0.01).limits()
MISSED = -1
ABSENT = -2


def flat_clusters(clusters):
    """Groups of hypotheses, (log-weight, tracks), as flat arrays."""
    hypotheses = [h for cluster in clusters for h in cluster]
    items = [t for _, tracks in hypotheses for t in tracks]
    return Clusters(
        np.cumsum([0, *map(len, clusters)]),
        np.cumsum([0, *(len(tracks) for _, tracks in hypotheses)]),
        np.array(items, np.int64),
        np.array([w for w, _ in hypotheses]),
    )


def listed_clusters(clusters):
    return [
        [
            (
                math.exp(clusters.logw[h]),
                frozenset(clusters.items[clusters.start[h] : clusters.start[h + 1]].tolist()),
            )
            for h in range(low, high)
        ]
        for low, high in itertools.pairwise(clusters.first)
    ]


def competition(seed):
    """Labels of one to three tracks, each a cluster, with options for few detections."""
    rng = np.random.default_rng(seed)
    clusters = []
    options = []
    labels = []
    t = 0
    for label in range(40):
        n = rng.integers(1, 4)
        weight = rng.dirichlet(np.ones(n + 1))
        clusters.append([(math.log(w), [t + i]) for i, w in enumerate(weight[:n])])
        clusters[-1].append((math.log(weight[n]), []))
        labels += [label] * n
        near = rng.integers(0, 80)
        for _ in range(n):
            gated = np.unique((near + rng.integers(0, 4, rng.integers(0, 4))) % 80)
            options.append(
                [*((int(j), rng.normal(-1.0, 3.0)) for j in gated), (MISSED, -4.0), (ABSENT, -5.0)]
            )
        t += n
    flat = [o for each in options for o in each]
    start = np.cumsum([0, *map(len, options)])
    return (
        clusters,
        AssociationOptions(start, np.array([j for j, _ in flat]), np.array([w for _, w in flat])),
        labels,
    )


def in_conflict(clusters, options, labels, bound):
    """Sets of labels in conflict over detections, from the definition: until nothing changes."""
    probability = defaultdict(float)
    for cluster in clusters:
        for w, tracks in cluster:
            for t in tracks:
                probability[t] += math.exp(w)
    uncontested = defaultdict(lambda: 1.0)
    weights = defaultdict(lambda: defaultdict(float))
    for t, label in enumerate(labels):
        uncontested[label] -= probability[t]
        for o in range(options.start[t], options.start[t + 1]):
            weight = probability[t] * math.exp(options.logw[o])
            if options.meas[o] < 0:
                uncontested[label] += weight
            else:
                weights[label][int(options.meas[o])] += weight
    contested = set()
    before = None
    while contested != before:
        before = set(contested)
        q = {}
        for label, own in weights.items():
            fallback = uncontested[label] + sum(w for j, w in own.items() if j not in before)
            for j, w in own.items():
                q[label, j] = w / (fallback + (w if j in before else 0.0))
        pairs = [
            (a, b, j)
            for (a, j), (b, k) in itertools.combinations(q, 2)
            if j == k and q[a, j] * q[b, j] > bound
        ]
        contested |= {j for _, _, j in pairs}
    sets = {label: {label} for label in labels}
    for a, b, _ in pairs:
        joined = sets[a] | sets[b]
        for label in joined:
            sets[label] = joined
    return {frozenset(s) for s in sets.values()}


@pytest.mark.parametrize("seed", range(8))
def test_clusters_that_compete_for_a_detection_are_merged(seed):
    clusters, options, labels = competition(seed)
    bound = 10.0 ** -(1 + seed % 4)
    expected = in_conflict(clusters, options, labels, bound)
    singletons, joint = merge_clusters(
        flat_clusters(clusters), options, np.array(labels), 80, LIMITS._replace(max_conflict=bound)
    )
    assert {frozenset({int(g)}) for g in singletons} == {s for s in expected if len(s) == 1}
    together = {
        frozenset(labels[t] for _, held in cluster for t in held) for cluster in listed_clusters(joint)
    }
    assert together == {s for s in expected if len(s) > 1}
    assert any(len(s) > 2 for s in expected)


def dependent(seed):
    """Return the product of a pair of labels that exclude each other and of some singletons, and these."""
    rng = np.random.default_rng(seed)
    tracks = [[0, 1], [2, 3], [4, 5, 6], [7], [8, 9]]
    labels = [label for label, own in enumerate(tracks) for _ in own]
    pair = {(0, 3): 0.5, (1, 2): 0.3, (0,): 0.2}
    singletons = []
    for own in tracks[2:]:
        weight = rng.dirichlet(np.ones(len(own)))
        singletons.append({(t,): w for t, w in zip(own, weight, strict=True)})
    singletons[0] = {held: 0.9 * w for held, w in singletons[0].items()} | {(): 0.1}
    singletons.append({(10,): 0.001, (): 0.999})
    product = [
        (math.prod(w for _, w in parts), [t for held, _ in parts for t in held])
        for parts in itertools.product(pair.items(), *(each.items() for each in singletons))
    ]
    product.sort(key=lambda h: -h[0])
    return product, pair, singletons, [*labels, 5]


@pytest.mark.parametrize("seed", range(5))
def test_independent_labels_are_split_into_their_marginals(seed):
    product, pair, singletons, labels = dependent(seed)
    split = split_clusters(
        flat_clusters([[(math.log(w), held) for w, held in product]]), np.array(labels), 6, LIMITS
    )
    found = [{held: w for w, held in cluster} for cluster in listed_clusters(split)]
    for cluster in listed_clusters(split):
        assert [w for w, _ in cluster] == sorted((w for w, _ in cluster), reverse=True)
    # The last label is too improbable to go on.
    expected = [{frozenset(held): w for held, w in each.items()} for each in (pair, *singletons[:-1])]
    assert len(found) == len(expected)
    for theirs, ours in zip(expected, found, strict=True):
        assert ours == pytest.approx(theirs, rel=1e-9)


def test_dependent_labels_stay_in_one_cluster():
    cluster = [(math.log(0.6), [0, 2]), (math.log(0.3), [1]), (math.log(0.1), [2])]
    split = split_clusters(flat_clusters([cluster]), np.array([0, 0, 1]), 2, LIMITS)
    assert listed_clusters(split) == listed_clusters(flat_clusters([cluster]))
