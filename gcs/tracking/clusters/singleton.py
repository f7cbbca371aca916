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

from gcs.jit import ZERO, inlined, kernel, leaf, prefetch_row, spliced
from gcs.tracking.glmb.hypotheses import DIED, AssociationOptions, Clusters, Limits
from gcs.tracking.glmb.kalman import update_track
from gcs.tracking.glmb.merging import cholesky4, outside_axis_gate, within_gate
from gcs.tracking.numerics.fast_math import log_in_place
from gcs.tracking.numerics.sorting import SortBuffers, allocate_sort, argsort_descending, head

if TYPE_CHECKING:
    from gcs.model import FloatArray
    from gcs.tracking.models.measurement import LinearisedMeasurement

_ABSENT = -1
_PREFETCH_LABELS = 2
"""How many labels before its turn a label's detection is fetched: those of neighbours are far apart."""


class DetectionMarginals(NamedTuple):
    """Probabilities that add up over the groups of a scan; empty where nobody asks for them."""

    p_explained: Any
    """(detections,) that some track made each."""
    p_detected: Any
    """(labels,) that each label, before the scan, was detected."""
    p_exists: Any
    """(labels,) that it is there."""


class Tracks(NamedTuple):
    """Tracks after a scan: which option of which track each was, its Gaussian, and who holds it."""

    clusters: Clusters
    parent: Any
    option: Any
    mean: Any
    """A row for each, and room for more behind them."""
    cov: Any


class _Components(NamedTuple):
    """Scratch: the children of one group; a child is an option of a track, or nobody."""

    option: Any
    parent: Any
    logw: Any
    order: SortBuffers
    """The ones kept, best first."""
    weight: Any
    """Of the ones kept, in that order; they add up to 1."""


@inlined
def _drop_tail(kept: int, share: float, components: Any) -> Any:
    """Drop the least probable children that hold less than a share of the label's existence together.

    Their weight goes to its others, so the label exists as probably as before. Returns how many are left.
    """
    existence, dropped, n = 0.0, 0.0, ZERO
    for k in range(kept):
        if components.option[components.order.index[k]] != _ABSENT:
            existence += components.weight[k]
    last = kept
    while last > 0:
        more = (
            0.0
            if components.option[components.order.index[last - 1]] == _ABSENT
            else components.weight[last - 1]
        )
        if dropped + more > share * existence:
            break
        dropped += more
        last -= 1
    if dropped == 0.0:
        return kept
    for k in range(kept):
        c, weight = components.order.index[k], components.weight[k]
        if components.option[c] == _ABSENT:
            components.order.index[n], components.weight[n] = c, weight
            n += 1
        elif k < last:
            components.order.index[n], components.weight[n] = c, weight * existence / (existence - dropped)
            n += 1
    return n


@inlined
def _weigh_components(
    clusters: Clusters, g: int, options: AssociationOptions, limits: Limits, components: Any
) -> Any:
    """Fill `to` with the children of group g; return how many are kept."""
    start, items = clusters.start, clusters.items
    n, best, max_absent_logw, n_absent = 1, -np.inf, -np.inf, 0
    for h in range(clusters.first[g], clusters.first[g + 1]):
        if start[h] == start[h + 1]:
            max_absent_logw, n_absent = max(max_absent_logw, clusters.logw[h]), n_absent + 1
            continue
        t = items[start[h]]
        for o in range(options.start[t], options.start[t + 1]):
            logw = clusters.logw[h] + options.logw[o]
            if options.meas[o] == DIED:
                max_absent_logw, n_absent = max(max_absent_logw, logw), n_absent + 1
                continue
            components.option[n], components.parent[n], components.logw[n] = o, t, logw
            best = max(best, logw)
            n += 1
    # Nobody is there in several ways; they are added up only where that can be worth keeping.
    components.option[0], components.parent[0], components.logw[0] = _ABSENT, _ABSENT, -np.inf
    if n_absent > 0 and max_absent_logw + n_absent > best + limits.log_prune:
        absent_weight = 0.0
        for h in range(clusters.first[g], clusters.first[g + 1]):
            if start[h] == start[h + 1]:
                absent_weight += math.exp(clusters.logw[h])
                continue
            t = items[start[h]]
            for o in range(options.start[t], options.start[t + 1]):
                if options.meas[o] == DIED:
                    absent_weight += math.exp(clusters.logw[h] + options.logw[o])
        components.logw[0] = math.log(absent_weight) if absent_weight > 0.0 else -np.inf
    floor, kept = max(best, components.logw[0]) + limits.log_prune, ZERO
    for i in range(n):
        if components.logw[i] >= floor:
            components.option[kept], components.parent[kept], components.logw[kept] = (
                components.option[i],
                components.parent[i],
                components.logw[i],
            )
            kept += 1
    if kept == 1:
        components.order.index[0], components.weight[0] = 0, 1.0
        return kept
    argsort_descending(components.logw, ZERO, kept, components.order)
    kept = min(kept, limits.max_hypotheses)
    total, best = 0.0, components.logw[components.order.index[0]]
    for k in range(kept):
        components.weight[k] = 1.0 if k == 0 else math.exp(components.logw[components.order.index[k]] - best)
        total += components.weight[k]
    for k in range(kept):
        components.weight[k] /= total
    return _drop_tail(kept, limits.tail_share, components)


@inlined
def _merge_pair(mean: FloatArray, cov: FloatArray, a: int, b: int, share: float) -> None:
    """Make of a the Gaussian with the moments of the mixture of a and, with a share of `share`, b."""
    for i in range(4):
        for j in range(4):
            spread = (mean[b, i] - mean[a, i]) * (mean[b, j] - mean[a, j])
            cov[a, i, j] += share * (cov[b, i, j] - cov[a, i, j] + (1.0 - share) * spread)
    for i in range(4):
        mean[a, i] += share * (mean[b, i] - mean[a, i])


class _Representatives(NamedTuple):
    """Scratch: tracks of a label that stand for those that are like them."""

    mean: Any
    """What it was before it took others on."""
    cholesky: Any
    is_factored: Any
    weight: Any
    row: Any
    order: SortBuffers


@leaf
def _compute_bounds(
    clusters: Clusters, singletons: Any, options: AssociationOptions, max_hypotheses: int
) -> Any:
    """Bounds: of tracks and hypotheses in all, and of the children of one group."""
    n_tracks, n_hyps, max_components = 0, 0, 1
    for i in range(singletons.size):
        tracks = 0
        for k in range(
            clusters.start[clusters.first[singletons[i]]], clusters.start[clusters.first[singletons[i] + 1]]
        ):
            tracks += options.start[clusters.items[k] + 1] - options.start[clusters.items[k]]
        n_tracks += min(tracks, max_hypotheses)
        n_hyps += min(tracks + 1, max_hypotheses)
        max_components = max(max_components, tracks + 1)
    return n_tracks, n_hyps, max_components


@spliced
def _update_and_merge(
    n: int,
    kept: int,
    components: Any,
    reps: Any,
    mean: FloatArray,
    cov: FloatArray,
    z: FloatArray,
    meas: Any,
    meas_model: LinearisedMeasurement,
    max_distance2: float,
    out: Any,
) -> Any:
    """Update the children of a label and join those that are alike.

    Leaders are the tracks n, n + 1 ... and nobody, who is like no one. Returns how many they are, and tracks.
    """
    count, at = ZERO, n
    for k in range(kept):
        c, weight = components.order.index[k], components.weight[k]
        if components.option[c] == _ABSENT:
            reps.weight[count], reps.row[count] = weight, _ABSENT
            count += 1
            continue
        o, p = components.option[c], components.parent[c]
        update_track(mean, cov, p, meas[o], z, meas_model, out.mean, out.cov, at)
        representative = -1
        for d in range(count):
            if reps.row[d] == _ABSENT or max_distance2 <= 0.0:
                continue
            if not reps.is_factored[d]:
                if outside_axis_gate(out.mean, at, reps.mean, d, out.cov, reps.row[d], max_distance2):
                    continue
                cholesky4(out.cov, reps.row[d], reps.cholesky, d)
                reps.is_factored[d] = True
            if within_gate(out.mean, at, reps.mean, d, reps.cholesky, d, max_distance2):
                representative = d
                break
        if representative >= 0:
            reps.weight[representative] += weight
            _merge_pair(out.mean, out.cov, reps.row[representative], at, weight / reps.weight[representative])
            continue
        for j in range(4):
            reps.mean[count, j] = out.mean[at, j]
        out.parent[at], out.option[at] = p, o
        reps.weight[count], reps.row[count], reps.is_factored[count] = weight, at, False
        count += 1
        at += 1
    return count, at


@inlined
def _add_marginals(
    kept: int, components: Any, meas: Any, track_label: Any, marginals: DetectionMarginals
) -> None:
    """Add to `made` what the kept children of a label tell."""
    for k in range(kept):
        c = components.order.index[k]
        if components.option[c] != _ABSENT:
            weight, j, label = (
                components.weight[k],
                meas[components.option[c]],
                track_label[components.parent[c]],
            )
            marginals.p_exists[label] += weight
            if j >= 0:
                marginals.p_explained[j] += weight
                marginals.p_detected[label] += weight


@leaf
def _update_singletons(
    clusters: Clusters,
    singletons: Any,
    options: AssociationOptions,
    mean: FloatArray,
    cov: FloatArray,
    track_label: Any,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
    limits: Limits,
    max_distance2: float,
    marginals: DetectionMarginals,
    components: Any,
    reps: Any,
    out: Tracks,
) -> Any:
    """Work them all; returns how many groups, hypotheses and tracks go on."""
    meas, first, start, items, logw = (
        options.meas,
        out.clusters.first,
        out.clusters.start,
        out.clusters.items,
        out.clusters.logw,
    )
    first[0] = start[0] = n_clusters = n = h = ZERO
    for i in range(singletons.size):
        if i + _PREFETCH_LABELS < singletons.size:
            next_detection = meas[
                options.start[
                    clusters.items[clusters.start[clusters.first[singletons[i + _PREFETCH_LABELS]]]]
                ]
            ]
            if next_detection >= 0:
                prefetch_row(z, next_detection)
        kept, existence = _weigh_components(clusters, singletons[i], options, limits, components), 0.0
        for k in range(kept):
            if components.option[components.order.index[k]] != _ABSENT:
                existence += components.weight[k]
        if marginals.p_exists.size > 0:
            _add_marginals(kept, components, meas, track_label, marginals)
        if existence == 0.0 or existence < limits.min_existence:
            continue
        count, n = _update_and_merge(
            n, kept, components, reps, mean, cov, z, meas, meas_model, max_distance2, out
        )
        if count == 1:
            logw[h] = reps.weight[0]
            items[start[h]], start[h + 1], first[n_clusters + 1] = n - 1, start[h] + 1, h + 1
            n_clusters, h = n_clusters + 1, h + 1
            continue
        argsort_descending(reps.weight, ZERO, count, reps.order)
        for k in range(count):
            d = reps.order.index[k]
            logw[h], start[h + 1] = reps.weight[d], start[h]
            if reps.row[d] != _ABSENT:
                items[start[h]] = reps.row[d]
                start[h + 1] += 1
            h += 1
        n_clusters += 1
        first[n_clusters] = h
    log_in_place(logw[:h])
    return n_clusters, h, n


@kernel
def update_singletons(
    clusters: Clusters,
    singletons: Any,
    options: AssociationOptions,
    mean: FloatArray,
    cov: FloatArray,
    track_label: Any,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
    limits: Limits,
    max_distance2: float,
    n_spare_rows: int,
    marginals: DetectionMarginals,
) -> Tracks:
    """Predict and update the groups `which`, each of one label that competes with nobody.

    Probabilities are added to `made`, where it has room. The means and covariances have room for `spare` rows
    more.
    """
    n_tracks, n_hyps, max_hypotheses = _compute_bounds(clusters, singletons, options, limits.max_hypotheses)
    components = _Components(
        np.empty(max_hypotheses, np.int64),
        np.empty(max_hypotheses, np.int64),
        np.empty(max_hypotheses),
        allocate_sort(max_hypotheses),
        np.empty(max_hypotheses),
    )
    reps = _Representatives(
        np.empty((max_hypotheses, 4)),
        np.empty((max_hypotheses, 4, 4)),
        np.empty(max_hypotheses, np.bool_),
        np.empty(max_hypotheses),
        np.empty(max_hypotheses, np.int64),
        allocate_sort(max_hypotheses),
    )
    out_first, out_start = np.empty(singletons.size + 1, np.int64), np.empty(n_hyps + 1, np.int64)
    out_groups = Clusters(out_first, out_start, np.empty(n_hyps, np.int64), np.empty(n_hyps))
    parent, option = np.empty(n_tracks, np.int64), np.empty(n_tracks, np.int64)
    rows = n_tracks + n_spare_rows
    out = Tracks(out_groups, parent, option, np.empty((rows, 4)), np.empty((rows, 4, 4)))
    n_clusters, h, n = _update_singletons(
        clusters,
        singletons,
        options,
        mean,
        cov,
        track_label,
        z,
        meas_model,
        limits,
        max_distance2,
        marginals,
        components,
        reps,
        out,
    )
    n_items = out_start[h]
    return Tracks(
        Clusters(
            head(out_first, n_clusters + 1),
            head(out_start, h + 1),
            head(out_groups.items, n_items),
            head(out_groups.logw, h),
        ),
        head(parent, n),
        head(option, n),
        out.mean,
        out.cov,
    )
