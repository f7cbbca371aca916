"""Compiled competition for detections: which labels want the same one so much that it matters.

Two labels whose gates share a detection need not be associated jointly. Let a and b take detection j with
probabilities q_a(j) and q_b(j), each by itself. Their joint posterior is the product of the two, given that
they do not take the same detection; the two distributions differ, in total variation, by the probability of
such a conflict, which is at most the sum of q_a(j) q_b(j). So labels go on apart where that product is below
the bound that also lets labels part (`parting.part`). At the edge of a gate, where most of the sharing
happens, it is below by orders of magnitude.

q is taken on the safe side. A label that loses a contested detection turns to its next best one, so what it
may fall back upon counts only what nobody contests: its death, its being missed, and detections without a
conflict. What is contested grows until nothing changes.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gcs.compiling import inlined, leaf
from gcs.tracking.hypotheses import Groups, Options

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


@inlined
def _rivals(options: Options, track_label: Any, owner: Any, span: Any) -> int:
    """Fill `owner` (detections,) with the one label that gates it, or `_MANY`; find the labels with rivals.

    Row i of `span` gets the first track of the i-th of these, and the one after its last. Returns how many.
    """
    start, meas = options.start, options.meas
    n_tracks = track_label.size
    for t in range(n_tracks):
        for o in range(start[t], start[t + 1]):
            j = meas[o]
            if j >= 0 and owner[j] != track_label[t]:
                owner[j] = track_label[t] if owner[j] == _NOBODY else _MANY
    count, first = 0, 0
    while first < n_tracks:
        end, rivals = first, False
        while end < n_tracks and track_label[end] == track_label[first]:
            for o in range(start[end], start[end + 1]):
                rivals |= meas[o] >= 0 and owner[meas[o]] == _MANY
            end += 1
        if rivals:
            span[count, 0], span[count, 1] = first, end
            count += 1
        first = end
    return count


class Claims(NamedTuple):
    """Room to see who wants what."""

    owner: Any
    """(detections,) the one label that gates it, or nobody, or many."""
    contested: Any
    share: Any
    most: Any
    strongest: Any
    span: Any
    """(tracks, 2) first track of each label with rivals, and the one after its last."""
    free: Any
    """(rivals,) weight of what nobody contests: absence, death, a miss, detections that nobody else gates."""
    group: Any
    """(tracks,) which group each is in."""
    known: Any
    weight: Any
    """(options,) of the option times its track's probability."""
    claim: Any
    """(options,) q."""
    shared: Any
    """(options,) those for detections that several labels gate, rival by rival."""
    begin: Any
    """(rivals + 1,) where each rival's begin."""


@inlined
def room_for_claims(n_tracks: int, n_options: int, n_detections: int) -> Claims:
    """Return room for so many."""
    return Claims(
        np.empty(n_detections, np.int64),
        np.zeros(n_detections, np.bool_),
        np.zeros(n_detections),
        np.zeros(n_detections),
        np.empty(n_detections, np.int64),
        np.empty((n_tracks, 2), np.int64),
        np.empty(n_tracks),
        np.empty(n_tracks, np.int64),
        np.empty(n_tracks, np.int64),
        np.empty(n_options),
        np.empty(n_options),
        np.empty(n_options, np.int64),
        np.empty(n_tracks + 1, np.int64),
    )


@inlined
def _weigh(groups: Groups, options: Options, n_rivals: int, to: Claims) -> None:
    """Fill `to` for the labels with rivals: weights, what is free, options for shared detections."""
    start_o, meas = options.start, options.meas
    for r in range(n_rivals):
        for t in range(to.span[r, 0], to.span[r, 1]):
            to.weight[start_o[t]] = 0.0
    for g in range(groups.first.size - 1):
        for h in range(groups.first[g], groups.first[g + 1]):
            w = 1.0 if groups.logw[h] == 0.0 else math.exp(groups.logw[h])
            for i in range(groups.start[h], groups.start[h + 1]):
                to.weight[start_o[groups.items[i]]] += w
                to.group[groups.items[i]] = g
    n = 0
    for r in range(n_rivals):
        absent, free = 1.0, 0.0
        to.begin[r], to.known[r] = n, -1
        for t in range(to.span[r, 0], to.span[r, 1]):
            prior = to.weight[start_o[t]]
            absent -= prior
            for o in range(start_o[t], start_o[t + 1]):
                to.weight[o] = prior * math.exp(options.logw[o])
                if meas[o] >= 0 and to.owner[meas[o]] == _MANY:
                    to.shared[n] = o
                    n += 1
                else:
                    free += to.weight[o]
        to.free[r] = max(absent, 0.0) + free
    to.begin[n_rivals] = n


@inlined
def _claim(r: int, meas: Any, to: Claims) -> None:
    """Fill `to.claim` for the shared detections of rival r; `to.share` is zero before and after."""
    fallback = to.free[r]
    for i in range(to.begin[r], to.begin[r + 1]):
        o = to.shared[i]
        to.share[meas[o]] += to.weight[o]
        if not to.contested[meas[o]]:
            fallback += to.weight[o]
    for i in range(to.begin[r], to.begin[r + 1]):
        o = to.shared[i]
        share = to.share[meas[o]]
        to.claim[o] = share / max(fallback + (share if to.contested[meas[o]] else 0.0), 1e-300)
    for i in range(to.begin[r], to.begin[r + 1]):
        to.share[meas[to.shared[i]]] = 0.0


@leaf
def unite(
    groups: Groups, options: Options, track_label: Any, bound: float, work: Claims, parent: Any
) -> None:
    """Fill `parent` (groups,) with sets of groups that are in conflict over detections, as trees."""
    meas, span, group = options.meas, work.span, work.group
    shared, begin, contested, claim = work.shared, work.begin, work.contested, work.claim
    most, strongest = work.most, work.strongest
    for g in range(parent.size):
        parent[g] = g
    work.owner[:] = _NOBODY
    n_rivals = _rivals(options, track_label, work.owner, span)
    if n_rivals == 0:
        return
    _weigh(groups, options, n_rivals, work)
    for _ in range(_ROUNDS):
        changed = False
        for r in range(n_rivals):
            count = 0
            for i in range(begin[r], begin[r + 1]):
                count += contested[meas[shared[i]]]
            if count == work.known[r]:
                continue
            # The more is contested, the greater the claims, so those of before need no second look.
            work.known[r] = count
            _claim(r, meas, work)
            for i in range(begin[r], begin[r + 1]):
                o = shared[i]
                if claim[o] > most[meas[o]]:
                    most[meas[o]], strongest[meas[o]] = claim[o], r
        for r in range(n_rivals):
            for i in range(begin[r], begin[r + 1]):
                o = shared[i]
                j = meas[o]
                if strongest[j] == r or claim[o] * most[j] <= bound:
                    continue
                changed |= not contested[j]
                contested[j] = True
                # The smaller index stays the root, so that order does not depend on history.
                a, b = root_of(parent, group[span[r, 0]]), root_of(parent, group[span[strongest[j], 0]])
                parent[max(a, b)] = min(a, b)
        if not changed:
            break
