"""Merging of similar tracks of one label, for states of any dimension (see `glmb.merging`).

It finds what to merge. The moments of the mixtures are computed by the caller.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.jit import ZERO, kernel, leaf
from gcs.tracking.glmb.hypotheses import Clusters, allocate_clusters, trim_clusters
from gcs.tracking.glmb.merging import max_cluster_hypotheses, merge_hypotheses
from gcs.tracking.numerics.fast_math import exp_into
from gcs.tracking.numerics.sorting import SortBuffers, allocate_sort, allocate_unique, argsort_descending

if TYPE_CHECKING:
    from gcs.model import FloatArray, IntArray


@leaf
def _factor(cov: FloatArray, t: int, L: FloatArray) -> None:
    """Write the Cholesky factor of covariance t to `L` (d, d)."""
    for i in range(L.shape[0]):
        for j in range(i + 1):
            total = cov[t, i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(max(total, 1e-300)) if i == j else total / L[j, j]


@leaf
def _distance2(mean: FloatArray, a: int, b: int, L: FloatArray, w: FloatArray) -> float:
    """Return the squared Mahalanobis distance of means a and b by a factor; `w` (d,) is scratch."""
    total = 0.0
    for i in range(w.size):
        w[i] = mean[a, i] - mean[b, i]
        for k in range(i):
            w[i] -= L[i, k] * w[k]
        w[i] /= L[i, i]
        total += w[i] * w[i]
    return total


@leaf
def _find_representatives(
    mean: FloatArray,
    cov: FloatArray,
    track_label: IntArray,
    probability: FloatArray,
    max_distance2: float,
    order: SortBuffers,
    factors: FloatArray,
    w: FloatArray,
    found: IntArray,
    representative: IntArray,
) -> None:
    """Fill `representative` (n,): the track itself, or a more probable similar one of its label."""
    n = track_label.size
    first = ZERO
    while first < n:
        end = first
        while end < n and track_label[end] == track_label[first]:
            end += 1
        argsort_descending(probability, first, end, order)
        count = 0
        for k in range(end - first):
            t = order.index[k]
            representative[t] = t
            for i in range(count):
                if _distance2(mean, t, found[i], factors[i], w) < max_distance2:
                    representative[t] = found[i]
                    break
            if representative[t] == t:
                _factor(cov, t, factors[count])
                found[count] = t
                count += 1
        first = end


@kernel
def find_similar_tracks(
    clusters: Clusters, mean: FloatArray, cov: FloatArray, track_label: IntArray, max_distance2: float
) -> tuple[Clusters, FloatArray, IntArray]:
    """Return clusters of representatives, and the probability (n,) and representative (n,) of each track.

    Means are (n, d), covariances (n, d, d). Tracks of a label are adjacent. A track within `max_distance2` of
    a more probable one of its label is represented by it.
    """
    n, d = mean.shape
    hyp_probability = np.empty(clusters.logw.size)
    exp_into(clusters.logw, hyp_probability)
    probability = np.zeros(n)
    for h in range(clusters.logw.size):
        for i in range(clusters.start[h], clusters.start[h + 1]):
            probability[clusters.items[i]] += hyp_probability[h]
    representative = np.empty(n, np.int64)
    most = 1
    run = 0
    for t in range(n):
        run = run + 1 if t > 0 and track_label[t] == track_label[t - 1] else 1
        most = max(most, run)
    _find_representatives(
        mean, cov, track_label, probability, max_distance2, allocate_sort(n), np.zeros((most, d, d)),
        np.empty(d), np.empty(most, np.int64), representative,
    )  # fmt: skip
    n_clusters = clusters.first.size - 1
    out = allocate_clusters(n_clusters, clusters.logw.size, clusters.items.size)
    unique = allocate_unique(max_cluster_hypotheses(clusters))
    merge_hypotheses(clusters, hyp_probability, representative, unique, out)
    return trim_clusters(out, n_clusters, out.first[n_clusters]), probability, representative
