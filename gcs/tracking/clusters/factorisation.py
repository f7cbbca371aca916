"""Splitting of clusters after a scan's update: labels that no longer depend on each other.

Labels with too little existence are dropped. Labels whose joint distribution is the product of their
marginals, within a bound on total variation, become clusters of their own. The test compares pairs of
labels. It uses the density, not distances: labels that crossed stay together while their identities are
ambiguous.

==============  =====================  =======  =========================================================
_SplitBuffers   shape                  dtype    meaning (n labels and h hypotheses of one cluster)
==============  =====================  =======  =========================================================
n_tracks        (n,)                   int64    number of tracks of each label
choice          (h, n)                 int64    track of each label in each hypothesis, from 1; 0 for none
marginal        (n, tracks + 1)        float64  probability of each choice
example         (n, tracks + 1)        int64    item where each track is found
joint           (2, tracks + 1, same)  float64  joint distribution of two labels
is_undecided    (n,)                   bool     True if the label may depend on others
set_of          (n,)                   int64    first label of its new cluster, -1 if dropped
item_label      (all items,)           int64    number of the label in its cluster
local           (all labels,)          int64    that number, -1 elsewhere
number          (all tracks,)          int64    number of the track in its label, from 1
weight          (all hypotheses,)      float64  probability
==============  =====================  =======  =========================================================
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf, spliced
from gcs.model import BoolArray, FloatArray, IntArray
from gcs.tracking.glmb.hypotheses import Clusters, allocate_clusters, item_key, trim_clusters
from gcs.tracking.glmb.params import Limits
from gcs.tracking.numerics.fast_math import exp_into
from gcs.tracking.numerics.sorting import (
    UniqueBuffers,
    allocate_unique,
    head,
    rank_by_weight,
    unique_hypotheses,
)


@inlined
def _number_tracks(
    items: IntArray,
    begin: int,
    end: int,
    item_label: IntArray,
    number: IntArray,
    n_tracks: IntArray,
    example: IntArray,
) -> int:
    """Number the tracks of each label among items `begin` to `end` - 1, from 1.

    Fills `number` (0 before), `n_tracks` and `example`; returns the greatest number.
    """
    max_number = 0
    for i in range(begin, end):
        if number[items[i]] == 0:
            n_tracks[item_label[i]] += 1
            number[items[i]] = n_tracks[item_label[i]]
            example[item_label[i], n_tracks[item_label[i]]] = i
            max_number = max(max_number, n_tracks[item_label[i]])
    return max_number


class _LabelNumbers(NamedTuple):
    """Output of `_number_labels`."""

    item_label: IntArray
    local: IntArray


class _SplitBuffers(NamedTuple):
    """Buffers to split one cluster (see the table above)."""

    n_tracks: IntArray
    choice: IntArray
    marginal: FloatArray
    example: IntArray
    joint: FloatArray
    is_undecided: BoolArray
    set_of: IntArray
    item_label: IntArray
    local: IntArray
    number: IntArray
    weight: FloatArray
    unique: UniqueBuffers


@inlined
def _is_dependent(
    p: int, q: int, low: int, n_hyps: int, max_dependence: float, buffers: _SplitBuffers
) -> bool:
    """Return True if labels p and q are further than `max_dependence` from independence.

    The distance is the total variation, over `n_hyps` hypotheses from `low` on. `joint` is scratch: two
    tables, used in turns, because most hypotheses add to the same few cells and would wait for each other.
    """
    choice = buffers.choice
    joint = buffers.joint
    weight = buffers.weight
    for a in range(buffers.n_tracks[p] + 1):
        for b in range(buffers.n_tracks[q] + 1):
            joint[0, a, b] = joint[1, a, b] = 0.0
    for h in range(0, n_hyps - 1, 2):
        joint[0, choice[h, p], choice[h, q]] += weight[low + h]
        joint[1, choice[h + 1, p], choice[h + 1, q]] += weight[low + h + 1]
    if n_hyps % 2 == 1:
        joint[0, choice[n_hyps - 1, p], choice[n_hyps - 1, q]] += weight[low + n_hyps - 1]
    distance = 0.0
    for a in range(buffers.n_tracks[p] + 1):
        for b in range(buffers.n_tracks[q] + 1):
            product = buffers.marginal[p, a] * buffers.marginal[q, b]
            distance += abs(joint[0, a, b] + joint[1, a, b] - product)
    return 0.5 * distance > max_dependence


@spliced
def _find_dependent_sets(clusters: Clusters, g: int, n: int, limits: Limits, buffers: _SplitBuffers) -> None:
    """Fill `set_of` for the n labels of cluster g."""
    start = clusters.start
    low = clusters.first[g]
    high = clusters.first[g + 1]
    choice = buffers.choice
    marginal = buffers.marginal
    n_tracks = buffers.n_tracks
    set_of = buffers.set_of
    is_undecided = buffers.is_undecided
    for p in range(n):
        n_tracks[p] = 0
    max_number = _number_tracks(
        clusters.items, start[low], start[high], buffers.item_label, buffers.number, n_tracks, buffers.example
    )
    for p in range(n):
        for a in range(max_number + 1):
            marginal[p, a] = 0.0
    for h in range(low, high):
        for p in range(n):
            choice[h - low, p] = 0
        for i in range(start[h], start[h + 1]):
            choice[h - low, buffers.item_label[i]] = buffers.number[clusters.items[i]]
        for p in range(n):
            marginal[p, choice[h - low, p]] += buffers.weight[h]
    # A label with one almost certain track is independent: its distance is at most 2 (1 - probability).
    for p in range(n):
        set_of[p] = p if 1.0 - marginal[p, 0] >= limits.min_existence else -1
        max_probability = 0.0
        for a in range(n_tracks[p] + 1):
            max_probability = max(max_probability, marginal[p, a])
        is_undecided[p] = set_of[p] >= 0 and 2.0 * (1.0 - max_probability) >= limits.max_dependence
    for p in range(n):
        if not is_undecided[p]:
            continue
        for q in range(p + 1, n):
            if (
                is_undecided[q]
                and set_of[p] != set_of[q]
                and _is_dependent(p, q, low, high - low, limits.max_dependence, buffers)
            ):
                a = set_of[p]
                b = set_of[q]
                for r in range(n):
                    if set_of[r] == max(a, b):
                        set_of[r] = min(a, b)


@inlined
def _marginal_of_label(p: int, buffers: _SplitBuffers) -> int:
    """Write the marginal of label p to `unique`: its tracks as items, and -1 for absence.

    Returns the number of hypotheses.
    """
    unique = buffers.unique
    count = ZERO
    for a in range(buffers.n_tracks[p] + 1):
        if buffers.marginal[p, a] > 0.0:
            unique.weight[count] = buffers.marginal[p, a]
            unique.example[count] = buffers.example[p, a] if a > 0 else -1
            count += 1
    rank_by_weight(count, unique)
    return count


@inlined
def _marginal_of_set(clusters: Clusters, g: int, p: int, buffers: _SplitBuffers) -> int:
    """Write the marginal of the labels of set p to `unique`, equal hypotheses merged.

    Returns the number of hypotheses.
    """
    low = clusters.first[g]
    high = clusters.first[g + 1]
    unique = buffers.unique
    for h in range(low, high):
        key = np.uint64(0)
        for i in range(clusters.start[h], clusters.start[h + 1]):
            if buffers.set_of[buffers.item_label[i]] == p:
                key += item_key(clusters.items[i])
        unique.key[h - low] = key
    return unique_hypotheses(high - low, buffers.weight, low, unique)


@leaf
def _number_labels(clusters: Clusters, g: int, track_label: IntArray, numbers: _LabelNumbers) -> int:
    """Number the labels of cluster g; return how many."""
    items = clusters.items
    begin = clusters.start[clusters.first[g]]
    end = clusters.start[clusters.first[g + 1]]
    n = 0
    for i in range(begin, end):
        label = track_label[items[i]]
        if numbers.local[label] < 0:
            numbers.local[label] = n
            n += 1
        numbers.item_label[i] = numbers.local[label]
    return n


@leaf
def _measure_clusters(
    clusters: Clusters, track_label: IntArray, numbers: _LabelNumbers
) -> tuple[int, int, int, int]:
    """Return the most labels and hypotheses of a cluster, tracks of a label, and the total hypotheses."""
    labels = 1
    hyps = 1
    tracks = 1
    run = 0
    capacity = 0
    for t in range(track_label.size):
        run = run + 1 if t > 0 and track_label[t] == track_label[t - 1] else 1
        tracks = max(tracks, run)
    for g in range(clusters.first.size - 1):
        count = clusters.first[g + 1] - clusters.first[g]
        n = _number_labels(clusters, g, track_label, numbers)
        labels = max(labels, n)
        hyps = max(hyps, count)
        capacity = capacity + n * count
    return labels, hyps, tracks, capacity


@leaf
def _fill_split(clusters: Clusters, limits: Limits, buffers: _SplitBuffers, out: Clusters) -> tuple[int, int]:
    """Fill `out` with the split clusters; return the number of clusters and hypotheses."""
    first, start, items, logw = clusters
    count = 0
    n_hyps = 0
    size = 0
    out.first[0] = out.start[0] = 0
    exp_into(clusters.logw, buffers.weight)
    for g in range(first.size - 1):
        n = ZERO
        for i in range(start[first[g]], start[first[g + 1]]):
            n = max(n, buffers.item_label[i] + 1)
        _find_dependent_sets(clusters, g, n, limits, buffers)
        for p in range(n):
            members = 0
            for q in range(n):
                members += buffers.set_of[q] == p
            if members == 0:
                continue
            if members == n:
                for h in range(first[g], first[g + 1]):
                    for i in range(start[h], start[h + 1]):
                        out.items[size] = items[i]
                        size += 1
                    out.logw[n_hyps] = logw[h]
                    out.start[n_hyps + 1] = size
                    n_hyps += 1
            elif members == 1:
                for k in range(_marginal_of_label(p, buffers)):
                    if buffers.unique.which[k] >= 0:
                        out.items[size] = items[buffers.unique.which[k]]
                        size += 1
                    out.logw[n_hyps] = buffers.unique.logw[k]
                    out.start[n_hyps + 1] = size
                    n_hyps += 1
            else:
                for k in range(_marginal_of_set(clusters, g, p, buffers)):
                    h = buffers.unique.which[k]
                    for i in range(start[h], start[h + 1]):
                        if buffers.set_of[buffers.item_label[i]] == p:
                            out.items[size] = items[i]
                            size += 1
                    out.logw[n_hyps] = buffers.unique.logw[k]
                    out.start[n_hyps + 1] = size
                    n_hyps += 1
            count += 1
            out.first[count] = n_hyps
    return count, n_hyps


@kernel
def split_clusters(clusters: Clusters, track_label: IntArray, n_labels: int, limits: Limits) -> Clusters:
    """Split each cluster into sets of dependent labels, without labels of too little existence."""
    item_label = np.empty(clusters.items.size, np.int64)
    local = np.empty(n_labels, np.int64)
    number = np.zeros(track_label.size, np.int64)
    weight = np.empty(clusters.logw.size)
    local[:] = -1
    labels, hyps, tracks, capacity = _measure_clusters(
        clusters, track_label, _LabelNumbers(item_label, local)
    )
    buffers = _SplitBuffers(
        np.empty(labels, np.int64),
        np.empty((hyps, labels), np.int64),
        np.empty((labels, tracks + 1)),
        np.empty((labels, tracks + 1), np.int64),
        np.empty((2, tracks + 1, tracks + 1)),
        np.empty(labels, np.bool_),
        np.empty(labels, np.int64),
        item_label,
        local,
        number,
        weight,
        allocate_unique(hyps),
    )
    # A label is in one cluster, and at most in a cluster of its own afterwards.
    out = allocate_clusters(n_labels, capacity, clusters.items.size)
    count, n = _fill_split(clusters, limits, buffers, out)
    return trim_clusters(out, count, n)


@leaf
def _renumber_items(old: IntArray, number: IntArray, used: IntArray, items: IntArray) -> int:
    for i in range(old.size):
        number[old[i]] = 1
    count = 0
    for o in range(number.size):
        if number[o]:
            number[o] = count
            used[count] = o
            count += 1
    for i in range(items.size):
        items[i] = number[old[i]]
    return count


@kernel
def renumber(clusters: Clusters, n_options: int) -> tuple[Clusters, IntArray]:
    """Renumber the used options 0, 1, 2 ... in their order; also return these options."""
    number = np.zeros(n_options, np.int64)
    used = np.empty(n_options, np.int64)
    items = np.empty(clusters.items.size, np.int64)
    count = _renumber_items(clusters.items, number, used, items)
    return Clusters(clusters.first, clusters.start, items, clusters.logw), head(used, count)
