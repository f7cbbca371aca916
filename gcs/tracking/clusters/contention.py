"""Measurement contention: which labels compete for a detection so much that it matters.

Labels a and b that gate detection j need not be associated jointly. Let each by itself take j with
probability q_a(j) and q_b(j). Their joint posterior is the product of both, given that they do not take the
same detection. It differs from the product, in total variation, by the probability of such a conflict,
which is at most the sum of q_a(j) q_b(j). Labels stay in separate clusters where that product is below
`max_conflict`.

q is an upper bound. A label that loses a contested detection takes its next best option, so its alternatives
count only uncontested options: death, a miss, and detections without conflict. The contested set grows until
nothing changes, and does not depend on the order of the labels.

A *rival* is a label that gates a detection which another label gates too. An *entry* is an option of a rival
for such a detection.

====================  ==============  =======  =====================================================
Contention            shape           dtype    meaning (m detections, T tracks, R rivals, E entries)
====================  ==============  =======  =====================================================
owner                 (m,)            int64    the one label that gates it, or none, or several
contested             (m,)            bool     True if rivals are in conflict over it
strongest_q           (m,)            float64  greatest q of a rival
second_q              (m,)            float64  greatest q of another rival
strongest_rival       (m,)            int64    rival with `strongest_q`
last_entry            (m,)            int64    last entry for it, or -1
hyp_probability       (H,)            float64  probability of each hypothesis
has_rivals            (T,)            bool     True if the track is of a rival
track_probability     (T,)            float64  of tracks of rivals, else 0
track_cluster         (T,)            int64    cluster of tracks of rivals
rival_cluster         (R,)            int64    cluster of each rival
uncontested_weight    (R,)            float64  weight of absence, death, miss, and unshared detections
begin                 (R + 1,)        int64    first entry of each rival
meas                  (E,)            int64    detection of each entry
rival                 (E,)            int64    rival of each entry
previous_entry        (E,)            int64    previous entry for the same detection, or -1
weight                (E,)            float64  weight of the option times the track's probability
q                     (E,)            float64  probability that the rival takes the detection
scratch               (m,)            float64  0 between uses
newly_contested       (m,)            int64    detections that became contested in a round
queue                 (R,)            int64    rivals to be updated
is_queued             (R,)            bool     True if the rival is in `queue`
====================  ==============  =======  =====================================================
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.jit import inlined, leaf
from gcs.model import BoolArray, FloatArray, IntArray
from gcs.tracking.glmb.hypotheses import AssociationOptions, Clusters
from gcs.tracking.numerics.fast_math import exp_into

_NO_LABEL = -1
_SEVERAL_LABELS = -2
_MAX_ROUNDS = 64
"""Rounds in which the contested set may grow; a few suffice, and a scan must end."""


@inlined
def find_root(parent: IntArray, i: int) -> int:
    """Return the root of the tree with node i, with path compression."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


class Contention(NamedTuple):
    """Arrays of the contention analysis (see the table above)."""

    owner: IntArray
    contested: BoolArray
    strongest_q: FloatArray
    second_q: FloatArray
    strongest_rival: IntArray
    last_entry: IntArray
    hyp_probability: FloatArray
    has_rivals: BoolArray
    track_probability: FloatArray
    track_cluster: IntArray
    rival_cluster: IntArray
    uncontested_weight: FloatArray
    begin: IntArray
    meas: IntArray
    rival: IntArray
    previous_entry: IntArray
    weight: FloatArray
    q: FloatArray
    scratch: FloatArray
    newly_contested: IntArray
    queue: IntArray
    is_queued: BoolArray


@inlined
def allocate_contention(n_hyps: int, n_tracks: int, n_options: int, n_detections: int) -> Contention:
    """Allocate the arrays."""
    return Contention(
        np.empty(n_detections, np.int64),
        np.zeros(n_detections, np.bool_),
        np.zeros(n_detections),
        np.zeros(n_detections),
        np.empty(n_detections, np.int64),
        np.empty(n_detections, np.int64),
        np.empty(n_hyps),
        np.empty(n_tracks, np.bool_),
        np.zeros(n_tracks),
        np.empty(n_tracks, np.int64),
        np.empty(n_tracks, np.int64),
        np.empty(n_tracks),
        np.empty(n_tracks + 1, np.int64),
        np.empty(n_options, np.int64),
        np.empty(n_options, np.int64),
        np.empty(n_options, np.int64),
        np.empty(n_options),
        np.empty(n_options),
        np.zeros(n_detections),
        np.empty(n_detections, np.int64),
        np.empty(n_tracks, np.int64),
        np.empty(n_tracks, np.bool_),
    )


@inlined
def _find_owners(options: AssociationOptions, track_label: IntArray, contention: Contention) -> None:
    """Fill `owner`."""
    start, meas, _ = options
    owner = contention.owner
    for j in range(owner.size):
        owner[j] = contention.last_entry[j] = _NO_LABEL
    for t in range(track_label.size):
        label = track_label[t]
        for o in range(start[t], start[t + 1]):
            j = meas[o]
            if j >= 0 and owner[j] != label:
                owner[j] = label if owner[j] == _NO_LABEL else _SEVERAL_LABELS


@inlined
def _find_rivals(options: AssociationOptions, track_label: IntArray, contention: Contention) -> None:
    """Fill `has_rivals`."""
    start, meas, _ = options
    owner = contention.owner
    first = 0
    while first < track_label.size:
        end = first
        rivals = False
        while end < track_label.size and track_label[end] == track_label[first]:
            for o in range(start[end], start[end + 1]):
                rivals |= meas[o] >= 0 and owner[meas[o]] == _SEVERAL_LABELS
            end += 1
        for t in range(first, end):
            contention.has_rivals[t] = rivals
        first = end


@inlined
def _compute_track_probabilities(clusters: Clusters, contention: Contention) -> None:
    """Fill `track_probability` and `track_cluster`."""
    exp_into(clusters.logw, contention.hyp_probability)
    for g in range(clusters.first.size - 1):
        for h in range(clusters.first[g], clusters.first[g + 1]):
            is_relevant = False
            for i in range(clusters.start[h], clusters.start[h + 1]):
                is_relevant |= contention.has_rivals[clusters.items[i]]
            if not is_relevant:
                continue
            w = contention.hyp_probability[h]
            for i in range(clusters.start[h], clusters.start[h + 1]):
                contention.track_probability[clusters.items[i]] += w
                contention.track_cluster[clusters.items[i]] = g


@inlined
def _list_rivals(options: AssociationOptions, track_label: IntArray, contention: Contention) -> int:
    """List the rivals and their entries; return the number of rivals."""
    start, meas, logw = options
    owner = contention.owner
    count = 0
    n = 0
    t = 0
    while t < track_label.size:
        if not contention.has_rivals[t]:
            t += 1
            continue
        label = track_label[t]
        absent = 1.0
        uncontested_weight = 0.0
        contention.begin[count] = n
        contention.rival_cluster[count] = contention.track_cluster[t]
        contention.is_queued[count] = False
        while t < track_label.size and track_label[t] == label:
            absent -= contention.track_probability[t]
            for o in range(start[t], start[t + 1]):
                weight = contention.track_probability[t] * math.exp(logw[o])
                j = meas[o]
                if j < 0 or owner[j] != _SEVERAL_LABELS:
                    uncontested_weight += weight
                    continue
                contention.meas[n] = j
                contention.rival[n] = count
                contention.weight[n] = weight
                contention.previous_entry[n] = contention.last_entry[j]
                contention.last_entry[j] = n
                n += 1
            t += 1
        contention.uncontested_weight[count] = max(absent, 0.0) + uncontested_weight
        count += 1
    contention.begin[count] = n
    return count


@inlined
def _update_rival(r: int, max_conflict: float, n_newly_contested: int, contention: Contention) -> int:
    """Compute q of rival r; append newly contested detections.

    `n_newly_contested` are there before; returns their number after.
    """
    meas = contention.meas
    scratch = contention.scratch
    contested = contention.contested
    strongest_q = contention.strongest_q
    fallback = contention.uncontested_weight[r]
    for i in range(contention.begin[r], contention.begin[r + 1]):
        scratch[meas[i]] += contention.weight[i]
        if not contested[meas[i]]:
            fallback += contention.weight[i]
    for i in range(contention.begin[r], contention.begin[r + 1]):
        j = meas[i]
        contention.q[i] = q = scratch[j] / max(fallback + (scratch[j] if contested[j] else 0.0), 1e-300)
        # q only grows with the contested set, so earlier values need no second comparison.
        if q > strongest_q[j]:
            if strongest_q[j] > 0.0 and contention.strongest_rival[j] != r:
                contention.second_q[j] = strongest_q[j]
            strongest_q[j] = q
            contention.strongest_rival[j] = r
        elif contention.strongest_rival[j] != r:
            contention.second_q[j] = max(contention.second_q[j], q)
    for i in range(contention.begin[r], contention.begin[r + 1]):
        j = meas[i]
        scratch[j] = 0.0
        if not contested[j] and strongest_q[j] * contention.second_q[j] > max_conflict:
            contested[j] = True
            contention.newly_contested[n_newly_contested] = j
            n_newly_contested += 1
    return n_newly_contested


@leaf
def find_contending_clusters(
    clusters: Clusters,
    options: AssociationOptions,
    track_label: IntArray,
    max_conflict: float,
    contention: Contention,
    parent: IntArray,
) -> None:
    """Fill `parent` (clusters,) with the sets of clusters in conflict over detections, as trees."""
    for g in range(parent.size):
        parent[g] = g
    _find_owners(options, track_label, contention)
    _find_rivals(options, track_label, contention)
    _compute_track_probabilities(clusters, contention)
    n_rivals = _list_rivals(options, track_label, contention)
    n_newly_contested = 0
    for r in range(n_rivals):
        n_newly_contested = _update_rival(r, max_conflict, n_newly_contested, contention)
    for _ in range(_MAX_ROUNDS):
        n_queued = 0
        for k in range(n_newly_contested):
            i = contention.last_entry[contention.newly_contested[k]]
            while i >= 0:
                if not contention.is_queued[contention.rival[i]]:
                    contention.queue[n_queued] = contention.rival[i]
                    contention.is_queued[contention.rival[i]] = True
                    n_queued += 1
                i = contention.previous_entry[i]
        n_newly_contested = 0
        for k in range(n_queued):
            contention.is_queued[contention.queue[k]] = False
            n_newly_contested = _update_rival(
                contention.queue[k], max_conflict, n_newly_contested, contention
            )
    for i in range(contention.begin[n_rivals]):
        j = contention.meas[i]
        if (
            contention.contested[j]
            and contention.strongest_rival[j] != contention.rival[i]
            and contention.q[i] * contention.strongest_q[j] > max_conflict
        ):
            # The smaller index stays the root, so that the order of clusters does not depend on history.
            a = find_root(parent, contention.rival_cluster[contention.rival[i]])
            b = find_root(parent, contention.rival_cluster[contention.strongest_rival[j]])
            parent[max(a, b)] = min(a, b)
