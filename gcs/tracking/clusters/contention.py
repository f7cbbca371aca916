"""Compiled competition for detections: which labels want the same one so much that it matters.

Two labels whose gates share a detection need not be associated jointly. Let a and b take detection j with
probabilities q_a(j) and q_b(j), each by itself. Their joint posterior is the product of the two, given that
they do not take the same detection; the two distributions differ, in total variation, by the probability of
such a conflict, which is at most the sum of q_a(j) q_b(j). So labels go on apart where that product is below
the bound that also lets labels part (`parting.part`). At the edge of a gate, where most of the sharing
happens, it is below by orders of magnitude.

q is taken on the safe side. A label that loses a contested detection turns to its next best one, so what it
may fall back upon counts only what nobody contests: its death, its being missed, and detections without a
conflict. What is contested grows until nothing changes: the same sets whichever label is looked at first.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gcs.jit import inlined, leaf
from gcs.tracking.glmb.hypotheses import AssociationOptions, Clusters
from gcs.tracking.numerics.fast_math import exp_into

_NO_LABEL, _SEVERAL_LABELS = -1, -2
_MAX_ROUNDS = 64
"""In which what is contested may grow: a few are enough, and no scan may take for ever."""


@inlined
def find_root(parent: Any, i: int) -> int:
    """Root of the tree that i is in; the way there becomes shorter."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


class Contention(NamedTuple):
    """Room to see who wants what. A label with rivals is a rival; what is shared, several of them gate."""

    owner: Any
    """(detections,) the one label that gates it, or nobody, or many."""
    contested: Any
    strongest_q: Any
    """(detections,) the strongest claim to each, and the strongest of another rival."""
    second_q: Any
    strongest_rival: Any
    """(detections,) whose the first is."""
    last_entry: Any
    """(detections,) the last of the options below for each, or -1."""
    hyp_probability: Any
    """(hypotheses,) probability of each."""
    has_rivals: Any
    """(tracks,) whether each is of a rival."""
    track_probability: Any
    """(tracks,) probability of those, 0 of others."""
    track_cluster: Any
    """(tracks,) which group those are in."""
    rival_cluster: Any
    """(rivals,)."""
    uncontested_weight: Any
    """(rivals,) weight of what nobody contests: absence, death, a miss, detections that nobody else gates."""
    begin: Any
    """(rivals + 1,) where the options of each for shared detections begin."""
    meas: Any
    """Of these options, which detection each is for."""
    rival: Any
    """Whose it is."""
    previous_entry: Any
    """The one before it for the same detection, or -1."""
    weight: Any
    """Of the option, times its track's probability."""
    q: Any
    """q."""
    scratch: Any
    """(detections,) scratch, 0."""
    newly_contested: Any
    """(detections,) those contested of late."""
    queue: Any
    """(rivals,) those who claim anew for that."""
    is_queued: Any
    """(rivals,) whether they are among these."""


@inlined
def allocate_contention(n_hyps: int, n_tracks: int, n_options: int, n_detections: int) -> Contention:
    """Return room for so many."""
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
def _find_owners(options: AssociationOptions, track_label: Any, contention: Contention) -> None:
    """Fill `to.owner`."""
    start, meas, owner = options.start, options.meas, contention.owner
    for j in range(owner.size):
        owner[j] = contention.last_entry[j] = _NO_LABEL
    for t in range(track_label.size):
        label = track_label[t]
        for o in range(start[t], start[t + 1]):
            j = meas[o]
            if j >= 0 and owner[j] != label:
                owner[j] = label if owner[j] == _NO_LABEL else _SEVERAL_LABELS


@inlined
def _find_rivals(options: AssociationOptions, track_label: Any, contention: Contention) -> None:
    """Fill `to.wants`."""
    start, meas, owner = options.start, options.meas, contention.owner
    first = 0
    while first < track_label.size:
        end, rivals = first, False
        while end < track_label.size and track_label[end] == track_label[first]:
            for o in range(start[end], start[end + 1]):
                rivals |= meas[o] >= 0 and owner[meas[o]] == _SEVERAL_LABELS
            end += 1
        for t in range(first, end):
            contention.has_rivals[t] = rivals
        first = end


@inlined
def _compute_track_probabilities(clusters: Clusters, contention: Contention) -> None:
    """Fill `to.chance` and `to.group`."""
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
def _list_rivals(options: AssociationOptions, track_label: Any, contention: Contention) -> int:
    """List the labels with rivals, and what they want; return how many they are."""
    start, meas, owner = options.start, options.meas, contention.owner
    count, n, t = 0, 0, 0
    while t < track_label.size:
        if not contention.has_rivals[t]:
            t += 1
            continue
        label, absent, uncontested_weight, contention.begin[count] = track_label[t], 1.0, 0.0, n
        contention.rival_cluster[count], contention.is_queued[count] = contention.track_cluster[t], False
        while t < track_label.size and track_label[t] == label:
            absent -= contention.track_probability[t]
            for o in range(start[t], start[t + 1]):
                weight, j = contention.track_probability[t] * math.exp(options.logw[o]), meas[o]
                if j < 0 or owner[j] != _SEVERAL_LABELS:
                    uncontested_weight += weight
                    continue
                contention.meas[n], contention.rival[n], contention.weight[n] = j, count, weight
                contention.previous_entry[n], contention.last_entry[j] = contention.last_entry[j], n
                n += 1
            t += 1
        contention.uncontested_weight[count] = max(absent, 0.0) + uncontested_weight
        count += 1
    contention.begin[count] = n
    return count


@inlined
def _update_rival(r: int, max_conflict: float, newly_contested: int, contention: Contention) -> int:
    """Let rival r claim what it shares; put what is contested by that behind the first of `work.fresh`.

    Returns how many there are then; `fresh` before.
    """
    meas, scratch, contested, strongest_q = (
        contention.meas,
        contention.scratch,
        contention.contested,
        contention.strongest_q,
    )
    fallback = contention.uncontested_weight[r]
    for i in range(contention.begin[r], contention.begin[r + 1]):
        scratch[meas[i]] += contention.weight[i]
        if not contested[meas[i]]:
            fallback += contention.weight[i]
    for i in range(contention.begin[r], contention.begin[r + 1]):
        j = meas[i]
        contention.q[i] = q = scratch[j] / max(fallback + (scratch[j] if contested[j] else 0.0), 1e-300)
        # The more is contested, the greater the claims, so those of before need no second look.
        if q > strongest_q[j]:
            if strongest_q[j] > 0.0 and contention.strongest_rival[j] != r:
                contention.second_q[j] = strongest_q[j]
            strongest_q[j], contention.strongest_rival[j] = q, r
        elif contention.strongest_rival[j] != r:
            contention.second_q[j] = max(contention.second_q[j], q)
    for i in range(contention.begin[r], contention.begin[r + 1]):
        j = meas[i]
        scratch[j] = 0.0
        if not contested[j] and strongest_q[j] * contention.second_q[j] > max_conflict:
            contested[j], contention.newly_contested[newly_contested] = True, j
            newly_contested += 1
    return newly_contested


@leaf
def find_contending_clusters(
    clusters: Clusters,
    options: AssociationOptions,
    track_label: Any,
    max_conflict: float,
    contention: Contention,
    parent: Any,
) -> None:
    """Fill `parent` (groups,) with sets of groups that are in conflict over detections, as trees."""
    for g in range(parent.size):
        parent[g] = g
    _find_owners(options, track_label, contention)
    _find_rivals(options, track_label, contention)
    _compute_track_probabilities(clusters, contention)
    n_rivals, newly_contested = _list_rivals(options, track_label, contention), 0
    for r in range(n_rivals):
        newly_contested = _update_rival(r, max_conflict, newly_contested, contention)
    for _ in range(_MAX_ROUNDS):
        n_queued = 0
        for k in range(newly_contested):
            i = contention.last_entry[contention.newly_contested[k]]
            while i >= 0:
                if not contention.is_queued[contention.rival[i]]:
                    contention.queue[n_queued], contention.is_queued[contention.rival[i]] = (
                        contention.rival[i],
                        True,
                    )
                    n_queued += 1
                i = contention.previous_entry[i]
        newly_contested = 0
        for k in range(n_queued):
            contention.is_queued[contention.queue[k]] = False
            newly_contested = _update_rival(contention.queue[k], max_conflict, newly_contested, contention)
    for i in range(contention.begin[n_rivals]):
        j = contention.meas[i]
        if (
            contention.contested[j]
            and contention.strongest_rival[j] != contention.rival[i]
            and contention.q[i] * contention.strongest_q[j] > max_conflict
        ):
            # The smaller index stays the root, so that order does not depend on history.
            a = find_root(parent, contention.rival_cluster[contention.rival[i]])
            b = find_root(parent, contention.rival_cluster[contention.strongest_rival[j]])
            parent[max(a, b)] = min(a, b)
