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


@inlined
def _claim(
    meas: Any,
    low: int,
    high: int,
    weight: Any,
    absent: float,
    owner: Any,
    contested: Any,
    share: Any,
    claim: Any,
) -> None:
    """Fill `claim` (options,) with q of the label that has the options `low` to `high` - 1, if it has rivals.

    `weight` (options,) is that of the option times its track's probability; `absent` is the probability that
    the label was not there before; `share` (detections,) is scratch, and zero again at the end.
    """
    fallback = absent
    for o in range(low, high):
        j = meas[o]
        if j < 0 or not contested[j]:
            fallback += weight[o]
        if j >= 0:
            share[j] += weight[o]
    for o in range(low, high):
        j = meas[o]
        if j >= 0 and owner[j] == _MANY:
            claim[o] = share[j] / max(fallback + (share[j] if contested[j] else 0.0), 1e-300)
    for o in range(low, high):
        if meas[o] >= 0:
            share[meas[o]] = 0.0


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
    absent: Any
    group: Any
    """(tracks,) which group each is in."""
    known: Any
    weight: Any
    """(options,) of the option times its track's probability."""
    claim: Any
    """(options,) q."""


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
    )


@inlined
def _weigh(groups: Groups, options: Options, n_rivals: int, to: Claims) -> None:
    """Fill `to.weight`, `to.absent` and `to.group` for the labels with rivals."""
    start_o = options.start
    for r in range(n_rivals):
        for t in range(to.span[r, 0], to.span[r, 1]):
            to.weight[start_o[t]] = 0.0
    for g in range(groups.first.size - 1):
        for h in range(groups.first[g], groups.first[g + 1]):
            w = math.exp(groups.logw[h])
            for i in range(groups.start[h], groups.start[h + 1]):
                to.weight[start_o[groups.items[i]]] += w
                to.group[groups.items[i]] = g
    for r in range(n_rivals):
        absent = 1.0
        for t in range(to.span[r, 0], to.span[r, 1]):
            prior = to.weight[start_o[t]]
            absent -= prior
            for o in range(start_o[t], start_o[t + 1]):
                to.weight[o] = prior * math.exp(options.logw[o])
        to.absent[r], to.known[r] = max(absent, 0.0), -1


@leaf
def unite(
    groups: Groups, options: Options, track_label: Any, bound: float, work: Claims, parent: Any
) -> None:
    """Fill `parent` (groups,) with sets of groups that are in conflict over detections, as trees."""
    start_o, meas = options.start, options.meas
    owner, span, contested, claim, most = work.owner, work.span, work.contested, work.claim, work.most
    strongest, group = work.strongest, work.group
    for g in range(parent.size):
        parent[g] = g
    owner[:] = _NOBODY
    n_rivals = _rivals(options, track_label, owner, span)
    if n_rivals == 0:
        return
    _weigh(groups, options, n_rivals, work)
    for _ in range(_ROUNDS):
        changed = False
        for r in range(n_rivals):
            low, high, count = start_o[span[r, 0]], start_o[span[r, 1]], 0
            for o in range(low, high):
                count += meas[o] >= 0 and contested[meas[o]]
            if count == work.known[r]:
                continue
            # The more is contested, the greater the claims, so those of before need no second look.
            work.known[r] = count
            _claim(meas, low, high, work.weight, work.absent[r], owner, contested, work.share, claim)
            for o in range(low, high):
                j = meas[o]
                if j >= 0 and owner[j] == _MANY and claim[o] > most[j]:
                    most[j], strongest[j] = claim[o], r
        for r in range(n_rivals):
            for o in range(start_o[span[r, 0]], start_o[span[r, 1]]):
                j = meas[o]
                if j < 0 or owner[j] != _MANY or strongest[j] == r or claim[o] * most[j] <= bound:
                    continue
                changed |= not contested[j]
                contested[j] = True
                # The smaller index stays the root, so that order does not depend on history.
                a, b = root_of(parent, group[span[r, 0]]), root_of(parent, group[span[strongest[j], 0]])
                parent[max(a, b)] = min(a, b)
        if not changed:
            break
