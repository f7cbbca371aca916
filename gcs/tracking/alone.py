"""Compiled association of labels that compete with nobody: a whole scan's work on each in one pass.

In a large scene most labels want no detection that another wants. Such a label's hypotheses hold one of its
tracks, or none (it is not there); their children are all options of all tracks, and nothing needs to be
searched. So what `hypotheses.children`, `kernels.update`, `merging.merge_alike` and `partition.part` do for
groups of many labels, one after the other over arrays of everything, is done here label by label while its
few numbers are at hand: weigh the children, drop the hopeless, update, join those that became alike, forget
the label if it is improbable.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gcs.compiling import inlined, kernel
from gcs.tracking.hypotheses import DIED, Groups, Limits, Options
from gcs.tracking.kernels import updated
from gcs.tracking.merging import distance2_to, factor
from gcs.tracking.ordering import greatest_first, head

if TYPE_CHECKING:
    from gcs.model import FloatArray
    from gcs.tracking.sensors import View

_NOBODY = -1
_FEW = 12


class Tracks(NamedTuple):
    """Tracks after a scan: which option of which track each was, its Gaussian, and who holds it."""

    groups: Groups
    parent: Any
    option: Any
    mean: Any
    cov: Any

    def and_of(self, other: Tracks) -> Tracks:
        """Return these and the other tracks, which come behind them."""
        groups = Groups(
            np.concatenate([self.groups.first, self.groups.first[-1] + other.groups.first[1:]]),
            np.concatenate([self.groups.start, self.groups.start[-1] + other.groups.start[1:]]),
            np.concatenate([self.groups.items, self.parent.size + other.groups.items]),
            np.concatenate([self.groups.logw, other.groups.logw]),
        )
        return Tracks(groups, *(np.concatenate(pair) for pair in zip(self[1:], other[1:], strict=True)))


class _Children(NamedTuple):
    """Scratch: the children of one group; a child is an option of a track, or nobody."""

    option: Any
    parent: Any
    logw: Any
    order: Any
    """The ones kept, best first."""


@inlined
def _weigh(groups: Groups, g: int, options: Options, limits: Limits, to: Any) -> int:
    """Fill `to` with the children of group g; return how many are kept."""
    start, items = groups.start, groups.items
    nobody, n, best = 0.0, 1, -np.inf
    for h in range(groups.first[g], groups.first[g + 1]):
        if start[h] == start[h + 1]:
            nobody += math.exp(groups.logw[h])
            continue
        t = items[start[h]]
        for o in range(options.start[t], options.start[t + 1]):
            if options.meas[o] == DIED:
                nobody += math.exp(groups.logw[h] + options.logw[o])
                continue
            to.option[n], to.parent[n], to.logw[n] = o, t, groups.logw[h] + options.logw[o]
            best = max(best, to.logw[n])
            n += 1
    to.option[0], to.parent[0] = _NOBODY, _NOBODY
    to.logw[0] = math.log(nobody) if nobody > 0.0 else -np.inf
    floor, kept = max(best, to.logw[0]) + limits.log_prune, 0
    for i in range(n):
        if to.logw[i] >= floor:
            to.option[kept], to.parent[kept], to.logw[kept] = to.option[i], to.parent[i], to.logw[i]
            kept += 1
    if kept <= _FEW:
        for i in range(kept):
            j = i
            while j > 0 and to.logw[to.order[j - 1]] < to.logw[i]:
                to.order[j] = to.order[j - 1]
                j -= 1
            to.order[j] = i
    else:
        best_first = greatest_first(to.logw, 0, kept)
        for i in range(kept):
            to.order[i] = best_first[i]
    return min(kept, limits.hypotheses)


@inlined
def _join(mean: FloatArray, cov: FloatArray, a: int, b: int, share: float) -> None:
    """Make of a the Gaussian with the moments of the mixture of a and, with a share of `share`, b."""
    for i in range(4):
        for j in range(4):
            spread = (mean[b, i] - mean[a, i]) * (mean[b, j] - mean[a, j])
            cov[a, i, j] += share * (cov[b, i, j] - cov[a, i, j] + (1.0 - share) * spread)
    for i in range(4):
        mean[a, i] += share * (mean[b, i] - mean[a, i])


@kernel
def alone(
    groups: Groups,
    which: Any,
    options: Options,
    mean: FloatArray,
    cov: FloatArray,
    track_label: Any,
    z: FloatArray,
    view: View,
    limits: Limits,
    distance2: float,
    explained: FloatArray,
    detected: FloatArray,
    there: FloatArray,
) -> Tracks:
    """Predict and update the groups `which`, each of one label that competes with nobody.

    To `explained` (detections,), `detected` and `there` (labels,) are added the probabilities that a track
    made each detection, that each label was detected, and that it is there.
    """
    first, start, meas = groups.first, groups.start, options.meas
    n_tracks, n_hyps, most = 0, 0, 1
    for i in range(which.size):
        children = 1
        for k in range(start[first[which[i]]], start[first[which[i] + 1]]):
            children += options.start[groups.items[k] + 1] - options.start[groups.items[k]]
        n_tracks += min(children, limits.hypotheses) + 1
        n_hyps += min(children, limits.hypotheses)
        most = max(most, children)
    to = _Children(
        np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most), np.empty(most, np.int64)
    )
    # A leader is a track that stands for those that are like it: its mean before it took these on.
    lead_mean, lower, whitened = np.empty((most, 4)), np.empty((most, 4, 4)), np.empty(4)
    lead_weight, factored = np.empty(most), np.empty(most, np.bool_)
    place, by_weight = np.empty(most, np.int64), np.empty(most, np.int64)
    out_first, out_start = np.zeros(which.size + 1, np.int64), np.zeros(n_hyps + 1, np.int64)
    out_items, out_logw = np.empty(n_hyps, np.int64), np.empty(n_hyps)
    parent, option = np.empty(n_tracks, np.int64), np.empty(n_tracks, np.int64)
    mean_out, cov_out = np.empty((n_tracks, 4)), np.empty((n_tracks, 4, 4))
    n_groups, n, h = 0, 0, 0
    for i in range(which.size):
        kept = _weigh(groups, which[i], options, limits, to)
        total, best = 0.0, to.logw[to.order[0]]
        for k in range(kept):
            total += math.exp(to.logw[to.order[k]] - best)
        # Leaders are numbered as they come: the tracks n, n + 1 ..., and nobody, who is like no one.
        count, at, existence = 0, n, 0.0
        for k in range(kept):
            c = to.order[k]
            weight = math.exp(to.logw[c] - best) / total
            if to.option[c] == _NOBODY:
                lead_weight[count], place[count] = weight, _NOBODY
                count += 1
                continue
            o, p = to.option[c], to.parent[c]
            label = track_label[p]
            existence += weight
            there[label] += weight
            if meas[o] >= 0:
                explained[meas[o]] += weight
                detected[label] += weight
            updated(mean, cov, p, meas[o], z, view, mean_out, cov_out, at)
            leader = -1
            for d in range(count):
                if place[d] == _NOBODY or distance2 <= 0.0:
                    continue
                if not factored[d]:
                    factor(cov_out, place[d], lower, d)
                    factored[d] = True
                if distance2_to(mean_out, at, lead_mean, lower, d, whitened) < distance2:
                    leader = d
                    break
            if leader >= 0:
                lead_weight[leader] += weight
                _join(mean_out, cov_out, place[leader], at, weight / lead_weight[leader])
                continue
            for j in range(4):
                lead_mean[count, j] = mean_out[at, j]
            parent[at], option[at] = p, o
            lead_weight[count], place[count], factored[count] = weight, at, False
            count += 1
            at += 1
        if existence < limits.existence or at == n:
            continue
        n = at
        for k in range(count):
            j = k
            while j > 0 and lead_weight[by_weight[j - 1]] < lead_weight[k]:
                by_weight[j] = by_weight[j - 1]
                j -= 1
            by_weight[j] = k
        for k in range(count):
            d = by_weight[k]
            out_logw[h], out_start[h + 1] = math.log(lead_weight[d]), out_start[h]
            if place[d] != _NOBODY:
                out_items[out_start[h]] = place[d]
                out_start[h + 1] += 1
            h += 1
        n_groups += 1
        out_first[n_groups] = h
    return Tracks(
        Groups(
            head(out_first, n_groups + 1),
            head(out_start, h + 1),
            head(out_items, out_start[h]),
            head(out_logw, h),
        ),
        head(parent, n),
        head(option, n),
        mean_out[:n],
        cov_out[:n],
    )
