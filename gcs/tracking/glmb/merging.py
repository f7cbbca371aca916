"""Merging of similar components (tracks) of one label.

The number of association histories multiplies at every scan. Histories that differ in one old detection
soon have nearly equal Gaussians. Tracks of one label with close means, by the covariance of the more probable
one, become one Gaussian with the moments of their mixture (Salmond 1990). Hypotheses that then hold equal
tracks become one. Existence and cardinality do not change.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf
from gcs.tracking.glmb.hypotheses import Clusters, allocate_clusters, item_key, trim_clusters
from gcs.tracking.numerics.fast_math import exp_into
from gcs.tracking.numerics.sorting import (
    SortBuffers,
    UniqueBuffers,
    allocate_sort,
    allocate_unique,
    argsort_descending,
    unique_hypotheses,
)

if TYPE_CHECKING:
    from gcs.model import BoolArray, FloatArray, IntArray


@inlined
def cholesky4(cov: FloatArray, t: int, cholesky: FloatArray, at: int) -> None:
    """Write the Cholesky factor of covariance t into row `at`; both arrays are (n, 4, 4).

    Written out by element: loops over so small a matrix take several times as long.
    """
    l00 = math.sqrt(max(cov[t, 0, 0], 1e-300))
    l10 = cov[t, 1, 0] / l00
    l20 = cov[t, 2, 0] / l00
    l30 = cov[t, 3, 0] / l00
    l11 = math.sqrt(max(cov[t, 1, 1] - l10 * l10, 1e-300))
    l21 = (cov[t, 2, 1] - l20 * l10) / l11
    l31 = (cov[t, 3, 1] - l30 * l10) / l11
    l22 = math.sqrt(max(cov[t, 2, 2] - l20 * l20 - l21 * l21, 1e-300))
    l32 = (cov[t, 3, 2] - l30 * l20 - l31 * l21) / l22
    l33 = math.sqrt(max(cov[t, 3, 3] - l30 * l30 - l31 * l31 - l32 * l32, 1e-300))
    cholesky[at, 0, 0] = l00
    cholesky[at, 1, 0] = l10
    cholesky[at, 1, 1] = l11
    cholesky[at, 2, 0] = l20
    cholesky[at, 2, 1] = l21
    cholesky[at, 2, 2] = l22
    cholesky[at, 3, 0] = l30
    cholesky[at, 3, 1] = l31
    cholesky[at, 3, 2] = l32
    cholesky[at, 3, 3] = l33


@inlined
def within_gate(
    mean: FloatArray, a: int, centre: FloatArray, b: int, cholesky: FloatArray, f: int, max_distance2: float
) -> bool:
    """Return True if mean a is within squared Mahalanobis distance `max_distance2` of centre b.

    Row f of `cholesky` is the factor of the covariance (see `cholesky4`).
    """
    w0 = (mean[a, 0] - centre[b, 0]) / cholesky[f, 0, 0]
    total = w0 * w0
    if total >= max_distance2:
        return False
    w1 = (mean[a, 1] - centre[b, 1] - cholesky[f, 1, 0] * w0) / cholesky[f, 1, 1]
    total += w1 * w1
    if total >= max_distance2:
        return False
    w2 = (mean[a, 2] - centre[b, 2] - cholesky[f, 2, 0] * w0 - cholesky[f, 2, 1] * w1) / cholesky[f, 2, 2]
    total += w2 * w2
    w3 = mean[a, 3] - centre[b, 3] - cholesky[f, 3, 0] * w0 - cholesky[f, 3, 1] * w1 - cholesky[f, 3, 2] * w2
    w3 /= cholesky[f, 3, 3]
    return bool(total + w3 * w3 < max_distance2)


@inlined
def outside_axis_gate(
    mean: FloatArray, a: int, centre: FloatArray, b: int, cov: FloatArray, t: int, max_distance2: float
) -> bool:
    """Return True if mean a is outside the gate around centre b along one axis alone.

    It needs no Cholesky factor, and implies that `within_gate` is False.
    """
    for i in range(4):
        off = mean[a, i] - centre[b, i]
        if off * off > 1.001 * max_distance2 * cov[t, i, i]:
            return True
    return False


class _MergeBuffers(NamedTuple):
    """Buffers to find the similar ones of n tracks in H hypotheses.

    =================  =========  =======  ==============================================
    hyp_probability    (H,)       float64
    track_probability  (n,)       float64  0 before
    representative     (n,)       int64    the track itself, or a more probable similar one
    cholesky           (n, 4, 4)  float64  scratch
    is_factored        (n,)       bool     scratch
    order              (n,)                scratch
    =================  =========  =======  ==============================================
    """

    hyp_probability: FloatArray
    track_probability: FloatArray
    representative: IntArray
    cholesky: FloatArray
    is_factored: BoolArray
    order: SortBuffers


@leaf
def _find_representatives(
    clusters: Clusters,
    mean: FloatArray,
    cov: FloatArray,
    track_label: IntArray,
    max_distance2: float,
    buffers: _MergeBuffers,
    representatives: IntArray,
) -> None:
    """Fill the probabilities and `representative`; `representatives` (n,) is scratch."""
    hyp_probability, track_probability, representative, cholesky, is_factored, order = buffers
    exp_into(clusters.logw, hyp_probability)
    for h in range(clusters.logw.size):
        w = hyp_probability[h]
        for i in range(clusters.start[h], clusters.start[h + 1]):
            track_probability[clusters.items[i]] += w
    n = track_label.size
    first = ZERO
    while first < n:
        end = first
        while end < n and track_label[end] == track_label[first]:
            end += 1
        count = 0
        if end == first + 1:
            representative[first] = first
            first = end
            continue
        argsort_descending(track_probability, first, end, order)
        for k in range(end - first):
            t = order.index[k]
            representative[t] = t
            is_factored[t] = False
            for i in range(count):
                d = representatives[i]
                if not is_factored[d]:
                    if outside_axis_gate(mean, t, mean, d, cov, d, max_distance2):
                        continue
                    cholesky4(cov, d, cholesky, d)
                    is_factored[d] = True
                if within_gate(mean, t, mean, d, cholesky, d, max_distance2):
                    representative[t] = d
                    break
            if representative[t] == t:
                representatives[count] = t
                count += 1
        first = end


@leaf
def _number_mixtures(representative: IntArray, mixture: IntArray) -> int:
    """Number the tracks that represent others in `mixture` (n,), -1 elsewhere; return how many."""
    count = 0
    mixture[:] = -1
    for t in range(representative.size):
        if representative[t] != t and mixture[representative[t]] < 0:
            mixture[representative[t]] = count
            count += 1
    return count


@leaf
def _moment_match(
    mean: FloatArray,
    cov: FloatArray,
    track_probability: FloatArray,
    representative: IntArray,
    mixture: IntArray,
    total: FloatArray,
    centre: FloatArray,
    spread: FloatArray,
) -> None:
    """Give each representative the mean and covariance of its mixture, in place.

    `total`, `centre` and `spread` are sums for each mixture, 0 before.
    """
    n = representative.size
    for t in range(n):
        at = mixture[representative[t]]
        if at < 0:
            continue
        total[at] += track_probability[t]
        for i in range(4):
            centre[at, i] += track_probability[t] * mean[t, i]
    for t in range(n):
        at = mixture[representative[t]]
        if at >= 0:
            share = track_probability[t] / total[at]
            for i in range(4):
                off = mean[t, i] - centre[at, i] / total[at]
                for j in range(4):
                    spread[at, i, j] += share * (
                        cov[t, i, j] + off * (mean[t, j] - centre[at, j] / total[at])
                    )
    for t in range(n):
        at = mixture[t]
        if at >= 0:
            for i in range(4):
                mean[t, i] = centre[at, i] / total[at]
                for j in range(4):
                    cov[t, i, j] = spread[at, i, j]


@leaf
def max_cluster_hypotheses(clusters: Clusters) -> int:
    """Return the most hypotheses of a cluster."""
    max_count = 0
    for g in range(clusters.first.size - 1):
        max_count = max(max_count, clusters.first[g + 1] - clusters.first[g])
    return max_count


@leaf
def merge_hypotheses(
    clusters: Clusters,
    hyp_probability: FloatArray,
    representative: IntArray,
    unique: UniqueBuffers,
    out: Clusters,
) -> None:
    """Replace tracks by their representatives and merge hypotheses that become equal."""
    first, start, items, logw = clusters
    n = 0
    out.first[0] = out.start[0] = 0
    for g in range(first.size - 1):
        changed = False
        for i in range(start[first[g]], start[first[g + 1]]):
            changed |= representative[items[i]] != items[i]
        count = first[g + 1] - first[g]
        if changed:
            for h in range(first[g], first[g + 1]):
                key = np.uint64(0)
                for i in range(start[h], start[h + 1]):
                    key += item_key(representative[items[i]])
                unique.key[h - first[g]] = key
            count = unique_hypotheses(count, hyp_probability, first[g], unique)
        for k in range(count):
            h = unique.which[k] if changed else first[g] + k
            out.logw[n] = unique.logw[k] if changed else logw[h]
            size = out.start[n]
            for i in range(start[h], start[h + 1]):
                out.items[size] = representative[items[i]]
                size += 1
            n += 1
            out.start[n] = size
        out.first[g + 1] = n


@kernel
def merge_similar_tracks(
    clusters: Clusters, mean: FloatArray, cov: FloatArray, track_label: IntArray, max_distance2: float
) -> Clusters:
    """Merge tracks of one label within `max_distance2`; `mean` and `cov` change in place.

    Tracks of a label are adjacent. A merged track is in no hypothesis of the result.
    """
    n = track_label.size
    buffers = _MergeBuffers(
        np.empty(clusters.logw.size),
        np.zeros(n),
        np.empty(n, np.int64),
        np.empty((n, 4, 4)),
        np.empty(n, np.bool_),
        allocate_sort(n),
    )
    mixture = np.empty(n, np.int64)
    _find_representatives(clusters, mean, cov, track_label, max_distance2, buffers, mixture)
    representative = buffers.representative
    count = _number_mixtures(representative, mixture)
    total = np.zeros(count)
    centre = np.zeros((count, 4))
    spread = np.zeros((count, 4, 4))
    _moment_match(mean, cov, buffers.track_probability, representative, mixture, total, centre, spread)
    n_clusters = clusters.first.size - 1
    out = allocate_clusters(n_clusters, clusters.logw.size, clusters.items.size)
    unique = allocate_unique(max_cluster_hypotheses(clusters))
    merge_hypotheses(clusters, buffers.hyp_probability, representative, unique, out)
    return trim_clusters(out, n_clusters, out.first[n_clusters])
