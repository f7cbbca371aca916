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
from gcs.tracking.glmb.hypotheses import Clusters, Options
from gcs.tracking.numerics.fast_math import exponentials

_NOBODY, _MANY = -1, -2
_ROUNDS = 64
"""In which what is contested may grow: a few are enough, and no scan may take for ever."""


@inlined
def root_of(parent: Any, i: int) -> int:
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
    most: Any
    """(detections,) the strongest claim to each, and the strongest of another rival."""
    second: Any
    strongest: Any
    """(detections,) whose the first is."""
    last: Any
    """(detections,) the last of the options below for each, or -1."""
    likely: Any
    """(hypotheses,) probability of each."""
    wants: Any
    """(tracks,) whether each is of a rival."""
    chance: Any
    """(tracks,) probability of those, 0 of others."""
    group: Any
    """(tracks,) which group those are in."""
    rival_group: Any
    """(rivals,)."""
    free: Any
    """(rivals,) weight of what nobody contests: absence, death, a miss, detections that nobody else gates."""
    begin: Any
    """(rivals + 1,) where the options of each for shared detections begin."""
    meas: Any
    """Of these options, which detection each is for."""
    rival: Any
    """Whose it is."""
    before: Any
    """The one before it for the same detection, or -1."""
    weight: Any
    """Of the option, times its track's probability."""
    claim: Any
    """q."""
    share: Any
    """(detections,) scratch, 0."""
    fresh: Any
    """(detections,) those contested of late."""
    turn: Any
    """(rivals,) those who claim anew for that."""
    waits: Any
    """(rivals,) whether they are among these."""


@inlined
def room_for_claims(n_hyps: int, n_tracks: int, n_options: int, n_detections: int) -> Contention:
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
def _own(options: Options, track_label: Any, to: Contention) -> None:
    """Fill `to.owner`."""
    start, meas, owner = options.start, options.meas, to.owner
    for j in range(owner.size):
        owner[j] = to.last[j] = _NOBODY
    for t in range(track_label.size):
        label = track_label[t]
        for o in range(start[t], start[t + 1]):
            j = meas[o]
            if j >= 0 and owner[j] != label:
                owner[j] = label if owner[j] == _NOBODY else _MANY


@inlined
def _want(options: Options, track_label: Any, to: Contention) -> None:
    """Fill `to.wants`."""
    start, meas, owner = options.start, options.meas, to.owner
    first = 0
    while first < track_label.size:
        end, rivals = first, False
        while end < track_label.size and track_label[end] == track_label[first]:
            for o in range(start[end], start[end + 1]):
                rivals |= meas[o] >= 0 and owner[meas[o]] == _MANY
            end += 1
        for t in range(first, end):
            to.wants[t] = rivals
        first = end


@inlined
def _weigh(groups: Clusters, to: Contention) -> None:
    """Fill `to.chance` and `to.group`."""
    exponentials(groups.logw, to.likely)
    for g in range(groups.first.size - 1):
        for h in range(groups.first[g], groups.first[g + 1]):
            wanting = False
            for i in range(groups.start[h], groups.start[h + 1]):
                wanting |= to.wants[groups.items[i]]
            if not wanting:
                continue
            w = to.likely[h]
            for i in range(groups.start[h], groups.start[h + 1]):
                to.chance[groups.items[i]] += w
                to.group[groups.items[i]] = g


@inlined
def _rivals(options: Options, track_label: Any, to: Contention) -> int:
    """List the labels with rivals, and what they want; return how many they are."""
    start, meas, owner = options.start, options.meas, to.owner
    count, n, t = 0, 0, 0
    while t < track_label.size:
        if not to.wants[t]:
            t += 1
            continue
        label, absent, free, to.begin[count] = track_label[t], 1.0, 0.0, n
        to.rival_group[count], to.waits[count] = to.group[t], False
        while t < track_label.size and track_label[t] == label:
            absent -= to.chance[t]
            for o in range(start[t], start[t + 1]):
                weight, j = to.chance[t] * math.exp(options.logw[o]), meas[o]
                if j < 0 or owner[j] != _MANY:
                    free += weight
                    continue
                to.meas[n], to.rival[n], to.weight[n] = j, count, weight
                to.before[n], to.last[j] = to.last[j], n
                n += 1
            t += 1
        to.free[count] = max(absent, 0.0) + free
        count += 1
    to.begin[count] = n
    return count


@inlined
def _claim(r: int, bound: float, fresh: int, work: Contention) -> int:
    """Let rival r claim what it shares; put what is contested by that behind the first of `work.fresh`.

    Returns how many there are then; `fresh` before.
    """
    meas, share, contested, most = work.meas, work.share, work.contested, work.most
    fallback = work.free[r]
    for i in range(work.begin[r], work.begin[r + 1]):
        share[meas[i]] += work.weight[i]
        if not contested[meas[i]]:
            fallback += work.weight[i]
    for i in range(work.begin[r], work.begin[r + 1]):
        j = meas[i]
        work.claim[i] = claim = share[j] / max(fallback + (share[j] if contested[j] else 0.0), 1e-300)
        # The more is contested, the greater the claims, so those of before need no second look.
        if claim > most[j]:
            if most[j] > 0.0 and work.strongest[j] != r:
                work.second[j] = most[j]
            most[j], work.strongest[j] = claim, r
        elif work.strongest[j] != r:
            work.second[j] = max(work.second[j], claim)
    for i in range(work.begin[r], work.begin[r + 1]):
        j = meas[i]
        share[j] = 0.0
        if not contested[j] and most[j] * work.second[j] > bound:
            contested[j], work.fresh[fresh] = True, j
            fresh += 1
    return fresh


@leaf
def unite(
    groups: Clusters, options: Options, track_label: Any, bound: float, work: Contention, parent: Any
) -> None:
    """Fill `parent` (groups,) with sets of groups that are in conflict over detections, as trees."""
    for g in range(parent.size):
        parent[g] = g
    _own(options, track_label, work)
    _want(options, track_label, work)
    _weigh(groups, work)
    n_rivals, fresh = _rivals(options, track_label, work), 0
    for r in range(n_rivals):
        fresh = _claim(r, bound, fresh, work)
    for _ in range(_ROUNDS):
        turns = 0
        for k in range(fresh):
            i = work.last[work.fresh[k]]
            while i >= 0:
                if not work.waits[work.rival[i]]:
                    work.turn[turns], work.waits[work.rival[i]] = work.rival[i], True
                    turns += 1
                i = work.before[i]
        fresh = 0
        for k in range(turns):
            work.waits[work.turn[k]] = False
            fresh = _claim(work.turn[k], bound, fresh, work)
    for i in range(work.begin[n_rivals]):
        j = work.meas[i]
        if work.contested[j] and work.strongest[j] != work.rival[i] and work.claim[i] * work.most[j] > bound:
            # The smaller index stays the root, so that order does not depend on history.
            a = root_of(parent, work.rival_group[work.rival[i]])
            b = root_of(parent, work.rival_group[work.strongest[j]])
            parent[max(a, b)] = min(a, b)
