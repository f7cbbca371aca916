"""Compiled association of labels that compete with nobody: a whole scan's work on each in one pass.

In a large scene most labels want no detection that another wants. Such a label's hypotheses hold one of its
tracks, or none (it is not there); their children are all options of all tracks, and nothing needs to be
searched. So what `search.children`, `kernels.update`, `merging.merge_alike` and `parting.part` do for
groups of many labels, one after the other over arrays of everything, is done here label by label while its
few numbers are at hand: weigh the children, drop the hopeless, update, join those that became alike, forget
the label if it is improbable.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gcs.jit import ZERO, fetch_early, inlined, kernel, leaf, spliced
from gcs.tracking.glmb.hypotheses import DIED, Clusters, Limits, Options
from gcs.tracking.glmb.kalman import updated
from gcs.tracking.glmb.merging import factor, far, near
from gcs.tracking.numerics.fast_math import take_logarithms
from gcs.tracking.numerics.sorting import Order, greatest_first, head, room_to_order

if TYPE_CHECKING:
    from gcs.model import FloatArray
    from gcs.tracking.models.measurement import LinearisedMeasurement

_NOBODY = -1
_AHEAD = 2
"""How many labels before its turn a label's detection is fetched: those of neighbours are far apart."""


class SingletonUpdate(NamedTuple):
    """Probabilities that add up over the groups of a scan; empty where nobody asks for them."""

    explained: Any
    """(detections,) that some track made each."""
    detected: Any
    """(labels,) that each label, before the scan, was detected."""
    there: Any
    """(labels,) that it is there."""


class Tracks(NamedTuple):
    """Tracks after a scan: which option of which track each was, its Gaussian, and who holds it."""

    groups: Clusters
    parent: Any
    option: Any
    mean: Any
    """A row for each, and room for more behind them."""
    cov: Any


class _Children(NamedTuple):
    """Scratch: the children of one group; a child is an option of a track, or nobody."""

    option: Any
    parent: Any
    logw: Any
    order: Order
    """The ones kept, best first."""
    weight: Any
    """Of the ones kept, in that order; they add up to 1."""


@inlined
def _without_tail(kept: int, share: float, to: Any) -> Any:
    """Drop the least probable children that hold less than a share of the label's existence together.

    Their weight goes to its others, so the label exists as probably as before. Returns how many are left.
    """
    existence, dropped, n = 0.0, 0.0, ZERO
    for k in range(kept):
        if to.option[to.order.index[k]] != _NOBODY:
            existence += to.weight[k]
    last = kept
    while last > 0:
        more = 0.0 if to.option[to.order.index[last - 1]] == _NOBODY else to.weight[last - 1]
        if dropped + more > share * existence:
            break
        dropped += more
        last -= 1
    if dropped == 0.0:
        return kept
    for k in range(kept):
        c, weight = to.order.index[k], to.weight[k]
        if to.option[c] == _NOBODY:
            to.order.index[n], to.weight[n] = c, weight
            n += 1
        elif k < last:
            to.order.index[n], to.weight[n] = c, weight * existence / (existence - dropped)
            n += 1
    return n


@inlined
def _weigh(groups: Clusters, g: int, options: Options, limits: Limits, to: Any) -> Any:
    """Fill `to` with the children of group g; return how many are kept."""
    start, items = groups.start, groups.items
    n, best, absent, ways = 1, -np.inf, -np.inf, 0
    for h in range(groups.first[g], groups.first[g + 1]):
        if start[h] == start[h + 1]:
            absent, ways = max(absent, groups.logw[h]), ways + 1
            continue
        t = items[start[h]]
        for o in range(options.start[t], options.start[t + 1]):
            logw = groups.logw[h] + options.logw[o]
            if options.meas[o] == DIED:
                absent, ways = max(absent, logw), ways + 1
                continue
            to.option[n], to.parent[n], to.logw[n] = o, t, logw
            best = max(best, logw)
            n += 1
    # Nobody is there in several ways; they are added up only where that can be worth keeping.
    to.option[0], to.parent[0], to.logw[0] = _NOBODY, _NOBODY, -np.inf
    if ways > 0 and absent + ways > best + limits.log_prune:
        nobody = 0.0
        for h in range(groups.first[g], groups.first[g + 1]):
            if start[h] == start[h + 1]:
                nobody += math.exp(groups.logw[h])
                continue
            t = items[start[h]]
            for o in range(options.start[t], options.start[t + 1]):
                if options.meas[o] == DIED:
                    nobody += math.exp(groups.logw[h] + options.logw[o])
        to.logw[0] = math.log(nobody) if nobody > 0.0 else -np.inf
    floor, kept = max(best, to.logw[0]) + limits.log_prune, ZERO
    for i in range(n):
        if to.logw[i] >= floor:
            to.option[kept], to.parent[kept], to.logw[kept] = to.option[i], to.parent[i], to.logw[i]
            kept += 1
    if kept == 1:
        to.order.index[0], to.weight[0] = 0, 1.0
        return kept
    greatest_first(to.logw, ZERO, kept, to.order)
    kept = min(kept, limits.hypotheses)
    total, best = 0.0, to.logw[to.order.index[0]]
    for k in range(kept):
        to.weight[k] = 1.0 if k == 0 else math.exp(to.logw[to.order.index[k]] - best)
        total += to.weight[k]
    for k in range(kept):
        to.weight[k] /= total
    return _without_tail(kept, limits.tail, to)


@inlined
def _join(mean: FloatArray, cov: FloatArray, a: int, b: int, share: float) -> None:
    """Make of a the Gaussian with the moments of the mixture of a and, with a share of `share`, b."""
    for i in range(4):
        for j in range(4):
            spread = (mean[b, i] - mean[a, i]) * (mean[b, j] - mean[a, j])
            cov[a, i, j] += share * (cov[b, i, j] - cov[a, i, j] + (1.0 - share) * spread)
    for i in range(4):
        mean[a, i] += share * (mean[b, i] - mean[a, i])


class _Leaders(NamedTuple):
    """Scratch: tracks of a label that stand for those that are like them."""

    mean: Any
    """What it was before it took others on."""
    lower: Any
    factored: Any
    weight: Any
    place: Any
    order: Order


@leaf
def _sizes(groups: Clusters, which: Any, options: Options, most: int) -> Any:
    """Bounds: of tracks and hypotheses in all, and of the children of one group."""
    n_tracks, n_hyps, broadest = 0, 0, 1
    for i in range(which.size):
        tracks = 0
        for k in range(groups.start[groups.first[which[i]]], groups.start[groups.first[which[i] + 1]]):
            tracks += options.start[groups.items[k] + 1] - options.start[groups.items[k]]
        n_tracks += min(tracks, most)
        n_hyps += min(tracks + 1, most)
        broadest = max(broadest, tracks + 1)
    return n_tracks, n_hyps, broadest


@spliced
def _lead(
    n: int,
    kept: int,
    to: Any,
    lead: Any,
    mean: FloatArray,
    cov: FloatArray,
    z: FloatArray,
    meas: Any,
    view: LinearisedMeasurement,
    distance2: float,
    out: Any,
) -> Any:
    """Update the children of a label and join those that are alike.

    Leaders are the tracks n, n + 1 ... and nobody, who is like no one. Returns how many they are, and tracks.
    """
    count, at = ZERO, n
    for k in range(kept):
        c, weight = to.order.index[k], to.weight[k]
        if to.option[c] == _NOBODY:
            lead.weight[count], lead.place[count] = weight, _NOBODY
            count += 1
            continue
        o, p = to.option[c], to.parent[c]
        updated(mean, cov, p, meas[o], z, view, out.mean, out.cov, at)
        leader = -1
        for d in range(count):
            if lead.place[d] == _NOBODY or distance2 <= 0.0:
                continue
            if not lead.factored[d]:
                if far(out.mean, at, lead.mean, d, out.cov, lead.place[d], distance2):
                    continue
                factor(out.cov, lead.place[d], lead.lower, d)
                lead.factored[d] = True
            if near(out.mean, at, lead.mean, d, lead.lower, d, distance2):
                leader = d
                break
        if leader >= 0:
            lead.weight[leader] += weight
            _join(out.mean, out.cov, lead.place[leader], at, weight / lead.weight[leader])
            continue
        for j in range(4):
            lead.mean[count, j] = out.mean[at, j]
        out.parent[at], out.option[at] = p, o
        lead.weight[count], lead.place[count], lead.factored[count] = weight, at, False
        count += 1
        at += 1
    return count, at


@inlined
def _account(kept: int, to: Any, meas: Any, track_label: Any, made: SingletonUpdate) -> None:
    """Add to `made` what the kept children of a label tell."""
    for k in range(kept):
        c = to.order.index[k]
        if to.option[c] != _NOBODY:
            weight, j, label = to.weight[k], meas[to.option[c]], track_label[to.parent[c]]
            made.there[label] += weight
            if j >= 0:
                made.explained[j] += weight
                made.detected[label] += weight


@leaf
def _alone(
    groups: Clusters,
    which: Any,
    options: Options,
    mean: FloatArray,
    cov: FloatArray,
    track_label: Any,
    z: FloatArray,
    view: LinearisedMeasurement,
    limits: Limits,
    distance2: float,
    made: SingletonUpdate,
    to: Any,
    lead: Any,
    out: Tracks,
) -> Any:
    """Work them all; returns how many groups, hypotheses and tracks go on."""
    meas, first, start, items, logw = (
        options.meas,
        out.groups.first,
        out.groups.start,
        out.groups.items,
        out.groups.logw,
    )
    first[0] = start[0] = n_groups = n = h = ZERO
    for i in range(which.size):
        if i + _AHEAD < which.size:
            likely = meas[options.start[groups.items[groups.start[groups.first[which[i + _AHEAD]]]]]]
            if likely >= 0:
                fetch_early(z, likely)
        kept, existence = _weigh(groups, which[i], options, limits, to), 0.0
        for k in range(kept):
            if to.option[to.order.index[k]] != _NOBODY:
                existence += to.weight[k]
        if made.there.size > 0:
            _account(kept, to, meas, track_label, made)
        if existence == 0.0 or existence < limits.existence:
            continue
        count, n = _lead(n, kept, to, lead, mean, cov, z, meas, view, distance2, out)
        if count == 1:
            logw[h] = lead.weight[0]
            items[start[h]], start[h + 1], first[n_groups + 1] = n - 1, start[h] + 1, h + 1
            n_groups, h = n_groups + 1, h + 1
            continue
        greatest_first(lead.weight, ZERO, count, lead.order)
        for k in range(count):
            d = lead.order.index[k]
            logw[h], start[h + 1] = lead.weight[d], start[h]
            if lead.place[d] != _NOBODY:
                items[start[h]] = lead.place[d]
                start[h + 1] += 1
            h += 1
        n_groups += 1
        first[n_groups] = h
    take_logarithms(logw[:h])
    return n_groups, h, n


@kernel
def alone(
    groups: Clusters,
    which: Any,
    options: Options,
    mean: FloatArray,
    cov: FloatArray,
    track_label: Any,
    z: FloatArray,
    view: LinearisedMeasurement,
    limits: Limits,
    distance2: float,
    spare: int,
    made: SingletonUpdate,
) -> Tracks:
    """Predict and update the groups `which`, each of one label that competes with nobody.

    Probabilities are added to `made`, where it has room. The means and covariances have room for `spare` rows
    more.
    """
    n_tracks, n_hyps, most = _sizes(groups, which, options, limits.hypotheses)
    to = _Children(
        np.empty(most, np.int64),
        np.empty(most, np.int64),
        np.empty(most),
        room_to_order(most),
        np.empty(most),
    )
    lead = _Leaders(
        np.empty((most, 4)),
        np.empty((most, 4, 4)),
        np.empty(most, np.bool_),
        np.empty(most),
        np.empty(most, np.int64),
        room_to_order(most),
    )
    out_first, out_start = np.empty(which.size + 1, np.int64), np.empty(n_hyps + 1, np.int64)
    out_groups = Clusters(out_first, out_start, np.empty(n_hyps, np.int64), np.empty(n_hyps))
    parent, option = np.empty(n_tracks, np.int64), np.empty(n_tracks, np.int64)
    rows = n_tracks + spare
    out = Tracks(out_groups, parent, option, np.empty((rows, 4)), np.empty((rows, 4, 4)))
    n_groups, h, n = _alone(
        groups,
        which,
        options,
        mean,
        cov,
        track_label,
        z,
        view,
        limits,
        distance2,
        made,
        to,
        lead,
        out,
    )
    n_items = out_start[h]
    return Tracks(
        Clusters(
            head(out_first, n_groups + 1),
            head(out_start, h + 1),
            head(out_groups.items, n_items),
            head(out_groups.logw, h),
        ),
        head(parent, n),
        head(option, n),
        out.mean,
        out.cov,
    )
