"""If a likely association were left out, it could be the true one, and the track would be lost."""

import heapq
import itertools
import math

import numpy as np
import pytest
from helpers.reference_glmb import ranked_assignments

from gcs.tracking.glmb.hypotheses import AssociationOptions, Clusters
from gcs.tracking.glmb.joint_association import update_clusters
from gcs.tracking.glmb.params import GlmbParams

DETECTIONS = 9
MISSED = -1


def crowd(seed, n_labels):
    """One group of labels with two tracks each, four hypotheses over them, and the options of all tracks.

    No track ends and the hypotheses differ, so no two parents lead to one component.
    """
    rng = np.random.default_rng(seed)
    choices = rng.permutation(2**n_labels)[:4]
    hypotheses = [[2 * label + int(choice >> label & 1) for label in range(n_labels)] for choice in choices]
    logw = -np.sort(-np.log(rng.dirichlet(np.ones(4))))
    groups = Clusters(
        np.array([0, 4]),
        np.cumsum([0, *map(len, hypotheses)]),
        np.array([t for tracks in hypotheses for t in tracks], np.int64),
        logw,
    )
    start = [0]
    meas = []
    weight = []
    for _ in range(2 * n_labels):
        gated = rng.permutation(DETECTIONS)[: rng.integers(0, 6)]
        own = [*((rng.normal(2.0, 3.0), int(j)) for j in gated), (-4.0, MISSED)]
        for w, j in sorted(own, reverse=True):
            meas.append(j)
            weight.append(w)
        start.append(len(meas))
    return groups, AssociationOptions(np.array(start), np.array(meas, np.int64), np.array(weight)), hypotheses


def ranked(hypotheses, logw, options):
    """Children of all hypotheses, the best first: (log-weight, their options)."""

    def of(tracks, base):
        n = len(tracks)
        cost = np.full((n, DETECTIONS + n), np.inf)
        option = {}
        for row, t in enumerate(tracks):
            for o in range(options.start[t], options.start[t + 1]):
                j = options.meas[o]
                column = j if j >= 0 else DETECTIONS + row
                cost[row, column] = -options.logw[o]
                option[row, column] = o
        for total, columns in ranked_assignments(cost):
            yield base - total, frozenset(int(option[at]) for at in enumerate(columns))

    each = (of(tracks, base) for tracks, base in zip(hypotheses, logw, strict=True))
    return heapq.merge(*each, key=lambda child: -child[0])


def found(groups, options, limits):
    result = update_clusters(groups, options, DETECTIONS, limits, np.ones(1, np.uint64))
    return {
        frozenset(result.items[low:high].tolist()): math.exp(w)
        for (low, high), w in zip(itertools.pairwise(result.start.tolist()), result.logw, strict=True)
    }


@pytest.mark.parametrize("n_labels", [3, 6])
@pytest.mark.parametrize("seed", range(6))
def test_the_best_associations_equal_ranked_assignment(seed, n_labels):
    groups, options, hypotheses = crowd(seed, n_labels)
    limits = GlmbParams(1.0, max_hypotheses=40, prune_weight=1e-12).limits()
    best = itertools.islice(ranked(hypotheses, groups.logw, options), 40)
    expected = {child: math.exp(logw) for logw, child in best}
    ours = found(groups, options, limits)
    assert set(ours) == set(expected)
    total = sum(expected.values())
    for child, weight in ours.items():
        assert weight == pytest.approx(expected[child] / total, rel=1e-9)


def test_all_assignments_come_in_order():
    cost = np.array([[1.0, 5.0, np.inf, 2.0], [3.0, np.inf, 1.0, 2.0], [4.0, 0.5, 2.0, np.inf]])
    plain = sorted(
        (sum(cost[row, column] for row, column in enumerate(columns)), columns)
        for columns in itertools.permutations(range(4), 3)
    )
    totals, columns = zip(*ranked_assignments(cost), strict=True)
    assert list(totals) == sorted(totals)
    assert set(columns) == {each for total, each in plain if total < np.inf}
