"""Marginals of the posterior: existence of labels, probability of tracks, cardinality distribution.

Clusters are independent. Existence adds up within a cluster, and the cardinality distributions of the
clusters convolve.

==================  ============  =======  =====================================================
Marginals           shape         dtype    meaning (L labels, n tracks)
==================  ============  =======  =====================================================
existence           (L,)          float64  probability that each label exists
representative      (L,)          int64    track that represents each label (see below)
estimated           (k,)          int64    tracks of the MAP-cardinality estimate (`map_tracks`)
cardinality         (L + 1,)      float64  probability of each number of objects
probability         (n,)          float64  probability of each track
==================  ============  =======  =====================================================

A label is represented by the track that the representative hypothesis of its cluster holds, or else by the
first track in the order of the hypotheses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf
from gcs.tracking.glmb.hypotheses import Clusters
from gcs.tracking.numerics.fast_math import exp_into
from gcs.tracking.numerics.sorting import head

if TYPE_CHECKING:
    from gcs.model import FloatArray, IntArray

_TAIL = 1e-15


@inlined
def _representative_hypothesis(
    clusters: Clusters, g: int, track_label: IntArray, existence: FloatArray
) -> int:
    """Return the most probable hypothesis of cluster g with the most likely labels (existence > 1/2).

    One hypothesis is used for all labels. The best track of each label by itself would put two labels at one
    object while their identities are ambiguous.
    """
    first, start, items, _ = clusters
    chosen = first[g]
    largest = -1
    for h in range(first[g], first[g + 1]):
        likely = 0
        for i in range(start[h], start[h + 1]):
            if existence[track_label[items[i]]] > 0.5:
                likely += 1
        if likely > largest:
            chosen = h
            largest = likely
    return chosen


@inlined
def _cardinality_weights(clusters: Clusters, g: int, hyp_probability: FloatArray, weight: FloatArray) -> int:
    """Add the probability of each number of objects of cluster g to `weight`; return the greatest number.

    `weight` is 0 before; `hyp_probability` is that of each hypothesis.
    """
    max_size = 0
    for h in range(clusters.first[g], clusters.first[g + 1]):
        size = clusters.start[h + 1] - clusters.start[h]
        max_size = max(max_size, size)
        weight[size] += hyp_probability[h]
    return max_size


@inlined
def _map_hypothesis(clusters: Clusters, g: int, weight: FloatArray, max_size: int) -> int:
    """Return the best hypothesis with the most probable number of objects of cluster g."""
    size = 0
    for k in range(1, max_size + 1):
        if weight[k] > weight[size]:
            size = k
    h = clusters.first[g]
    while clusters.start[h + 1] - clusters.start[h] != size:
        h += 1
    return h


@inlined
def _convolve(
    old: FloatArray, new: FloatArray, smallest: int, largest: int, weight: FloatArray, max_size: int
) -> None:
    """Convolve `old` (`smallest` to `largest`) with `weight` (0 to `max_size`) into `new`."""
    if max_size == 1:
        w0 = weight[0]
        w1 = weight[1]
        n = largest - smallest
        new[smallest] = w0 * old[smallest]
        new[largest + 1] = w1 * old[largest]
        lower = old[smallest:largest]
        upper = old[smallest + 1 : largest + 1]
        to = new[smallest + 1 : largest + 1]
        for k in range(n):
            to[k] = w0 * upper[k] + w1 * lower[k]
        return
    for k in range(smallest, largest + max_size + 1):
        new[k] = 0.0
    for size in range(max_size + 1):
        if weight[size] > 0.0:
            for k in range(smallest, largest + 1):
                new[k + size] += weight[size] * old[k]


class Marginals(NamedTuple):
    """Marginals of labels and tracks (see the table above)."""

    existence: FloatArray
    representative: IntArray
    estimated: IntArray
    cardinality: FloatArray
    probability: FloatArray


@leaf
def _accumulate_marginals(
    clusters: Clusters,
    track_label: IntArray,
    weight: FloatArray,
    other: FloatArray,
    hyp_probability: FloatArray,
    out: Marginals,
) -> int:
    """Fill `out`; return the number of estimated tracks.

    `weight` (L + 1,) and `other` (L + 1,) are 0 before; `other` alternates with `out.cardinality`.
    """
    first, start, items, _ = clusters
    # Only `smallest` to `largest` objects are probable so far; the tails left out are below 1e-12.
    n = smallest = largest = ZERO
    before = out.cardinality
    after = other
    before[0] = 1.0
    exp_into(clusters.logw, hyp_probability)
    for g in range(first.size - 1):
        low = first[g]
        high = first[g + 1]
        max_size = ZERO
        for h in range(low, high):
            w = hyp_probability[h]
            max_size = max(max_size, start[h + 1] - start[h])
            weight[start[h + 1] - start[h]] += w
            for i in range(start[h], start[h + 1]):
                out.probability[items[i]] += w
                out.existence[track_label[items[i]]] += w
        _convolve(before, after, smallest, largest, weight, max_size)
        largest += max_size
        while smallest < largest and after[smallest] < _TAIL:
            after[smallest] = 0.0
            smallest += 1
        while largest > smallest and after[largest] < _TAIL:
            after[largest] = 0.0
            largest -= 1
        before, after = after, before
        representative_hypothesis = (
            low if high == low + 1 else _representative_hypothesis(clusters, g, track_label, out.existence)
        )
        for i in range(start[representative_hypothesis], start[representative_hypothesis + 1]):
            out.representative[track_label[items[i]]] = items[i]
        for i in range(start[low], start[high]):
            if out.representative[track_label[items[i]]] < 0:
                out.representative[track_label[items[i]]] = items[i]
        best = _map_hypothesis(clusters, g, weight, max_size)
        for i in range(start[best], start[best + 1]):
            out.estimated[n] = items[i]
            n += 1
        for size in range(max_size + 1):
            weight[size] = 0.0
    for i in range(out.existence.size):
        out.existence[i] = min(out.existence[i], 1.0)
    for k in range(before.size):
        if not smallest <= k <= largest:
            before[k] = 0.0
    return n


@inlined
def compute_marginals(clusters: Clusters, track_label: IntArray, n_labels: int) -> Marginals:
    """Return the marginals of the clusters."""
    existence = np.zeros(n_labels)
    probability = np.zeros(track_label.size)
    representative = np.empty(n_labels, np.int64)
    estimated = np.empty(n_labels, np.int64)
    even = np.zeros(n_labels + 1)
    odd = np.zeros(n_labels + 1)
    representative[:] = -1
    out = Marginals(existence, representative, estimated, even, probability)
    n = _accumulate_marginals(
        clusters, track_label, np.zeros(n_labels + 1), odd, np.empty(clusters.logw.size), out
    )
    cardinality = even if clusters.first.size % 2 == 1 else odd
    return Marginals(existence, representative, head(estimated, n), cardinality, probability)


@kernel
def track_probabilities(clusters: Clusters, n_tracks: int) -> FloatArray:
    """Return the probability of each track (n,): that of the hypotheses that hold it."""
    probability = np.zeros(n_tracks)
    hyp_probability = np.empty(clusters.logw.size)
    exp_into(clusters.logw, hyp_probability)
    for h in range(clusters.logw.size):
        for i in range(clusters.start[h], clusters.start[h + 1]):
            probability[clusters.items[i]] += hyp_probability[h]
    return probability


@kernel
def map_tracks(clusters: Clusters) -> IntArray:
    """Return the tracks of the best hypothesis with the most probable cardinality of each cluster."""
    chosen = np.empty(clusters.items.size, np.int64)
    n = ZERO
    weight = np.zeros(clusters.items.size + 1)
    hyp_probability = np.empty(clusters.logw.size)
    exp_into(clusters.logw, hyp_probability)
    for g in range(clusters.first.size - 1):
        max_size = _cardinality_weights(clusters, g, hyp_probability, weight)
        best = _map_hypothesis(clusters, g, weight, max_size)
        for i in range(clusters.start[best], clusters.start[best + 1]):
            chosen[n] = clusters.items[i]
            n += 1
        for size in range(max_size + 1):
            weight[size] = 0.0
    return head(chosen, n)
