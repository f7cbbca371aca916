"""Update of singleton labels: a whole scan for each label that competes for no detection, in one pass.

In a large scene most labels compete with no other label. The hypotheses of such a label hold one of its
tracks, or none. Its posterior components are all options of all tracks, and no search is needed. Each label
is weighed, pruned, updated, merged and possibly dropped while its few numbers are in the cache. The result
is that of `joint_association`, `kalman`, `merging` and `factorisation` one after the other, which are the
plain form. With these alone a scan of 1,000 objects takes longer by an eighth, and one of 10,000 by four
fifths (decision 18).

===================  ===========  =======  ==========================================================
array                shape        dtype    meaning (m detections, L labels, K components of a label)
===================  ===========  =======  ==========================================================
p_explained          (m,)         float64  probability that a track made each detection
p_detected           (L,)         float64  probability that each predicted label was detected
p_exists             (L,)         float64  existence of each predicted label
_Components.option   (K,)         int64    option, or _EMPTY for the empty hypothesis
.parent, .logw       (K,)                  track and log-weight of each component
.order, .weight      (K,)                  components kept, best first; their weights sum to 1
_Representatives     (K, ...)              tracks that represent similar ones (see `merging`); `mean` is that
                                           before merging, `row` the row in the result
===================  ===========  =======  ==========================================================
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf, prefetch_row, spliced
from gcs.tracking.glmb.hypotheses import (
    ABSENT,
    AssociationOptions,
    Clusters,
    allocate_clusters,
    trim_clusters,
)
from gcs.tracking.glmb.kalman import Prediction, update_track
from gcs.tracking.glmb.merging import cholesky4, outside_axis_gate, within_gate
from gcs.tracking.glmb.params import Limits
from gcs.tracking.numerics.fast_math import log_in_place
from gcs.tracking.numerics.sorting import SortBuffers, allocate_sort, argsort_descending, head

if TYPE_CHECKING:
    from gcs.model import BoolArray, FloatArray, IntArray
    from gcs.tracking.models.measurement_model import LinearisedMeasurement

_EMPTY = -1
_PREFETCH_LABELS = 2
"""Labels by which a detection is prefetched: detections of neighbours are far apart in memory."""


class DetectionMarginals(NamedTuple):
    """Marginals summed over the clusters of a scan; empty if not requested."""

    p_explained: FloatArray
    p_detected: FloatArray
    p_exists: FloatArray


class Tracks(NamedTuple):
    """Tracks after a scan: option and predicted track of each, Gaussian, and hypotheses."""

    clusters: Clusters
    parent: IntArray
    option: IntArray
    mean: FloatArray
    """One row for each track, and spare rows behind them."""
    cov: FloatArray


class _Components(NamedTuple):
    """Posterior components of one label (see the table above)."""

    option: IntArray
    parent: IntArray
    logw: FloatArray
    order: SortBuffers
    weight: FloatArray


@inlined
def _drop_tail(kept: int, share: float, components: _Components) -> int:
    """Drop the least probable tracks that hold less than `share` of the existence of the label together.

    Their weight goes to the other tracks, so existence does not change. Returns the number of components
    left.
    """
    existence = 0.0
    dropped = 0.0
    n = ZERO
    for k in range(kept):
        if components.option[components.order.index[k]] != _EMPTY:
            existence += components.weight[k]
    last = kept
    while last > 0:
        more = (
            0.0
            if components.option[components.order.index[last - 1]] == _EMPTY
            else components.weight[last - 1]
        )
        if dropped + more > share * existence:
            break
        dropped += more
        last -= 1
    if dropped == 0.0:
        return kept
    for k in range(kept):
        c = components.order.index[k]
        weight = components.weight[k]
        if components.option[c] == _EMPTY:
            components.order.index[n] = c
            components.weight[n] = weight
            n += 1
        elif k < last:
            components.order.index[n] = c
            components.weight[n] = weight * existence / (existence - dropped)
            n += 1
    return n


@inlined
def _weigh_components(
    clusters: Clusters, g: int, options: AssociationOptions, limits: Limits, components: _Components
) -> int:
    """Fill the posterior components of cluster g; return the number kept."""
    start = clusters.start
    items = clusters.items
    n = 1
    best = -np.inf
    max_absent_logw = -np.inf
    n_absent = 0
    for h in range(clusters.first[g], clusters.first[g + 1]):
        if start[h] == start[h + 1]:
            max_absent_logw = max(max_absent_logw, clusters.logw[h])
            n_absent = n_absent + 1
            continue
        t = items[start[h]]
        for o in range(options.start[t], options.start[t + 1]):
            logw = clusters.logw[h] + options.logw[o]
            if options.meas[o] == ABSENT:
                max_absent_logw = max(max_absent_logw, logw)
                n_absent = n_absent + 1
                continue
            components.option[n] = o
            components.parent[n] = t
            components.logw[n] = logw
            best = max(best, logw)
            n += 1
    # Several components say that the object is absent. Their sum is computed only if it can be kept.
    components.option[0] = _EMPTY
    components.parent[0] = _EMPTY
    components.logw[0] = -np.inf
    if n_absent > 0 and max_absent_logw + n_absent > best + limits.log_prune:
        absent_weight = 0.0
        for h in range(clusters.first[g], clusters.first[g + 1]):
            if start[h] == start[h + 1]:
                absent_weight += math.exp(clusters.logw[h])
                continue
            t = items[start[h]]
            for o in range(options.start[t], options.start[t + 1]):
                if options.meas[o] == ABSENT:
                    absent_weight += math.exp(clusters.logw[h] + options.logw[o])
        components.logw[0] = math.log(absent_weight) if absent_weight > 0.0 else -np.inf
    floor = max(best, components.logw[0]) + limits.log_prune
    kept = ZERO
    for i in range(n):
        if components.logw[i] >= floor:
            components.option[kept] = components.option[i]
            components.parent[kept] = components.parent[i]
            components.logw[kept] = components.logw[i]
            kept += 1
    argsort_descending(components.logw, ZERO, kept, components.order)
    kept = min(kept, limits.max_hypotheses)
    total = 0.0
    best = components.logw[components.order.index[0]]
    for k in range(kept):
        components.weight[k] = 1.0 if k == 0 else math.exp(components.logw[components.order.index[k]] - best)
        total += components.weight[k]
    for k in range(kept):
        components.weight[k] /= total
    return _drop_tail(kept, limits.tail_share, components)


@inlined
def _merge_pair(mean: FloatArray, cov: FloatArray, a: int, b: int, share: float) -> None:
    """Give Gaussian a the moments of the mixture of a and b, where b has the weight `share`."""
    for i in range(4):
        for j in range(4):
            spread = (mean[b, i] - mean[a, i]) * (mean[b, j] - mean[a, j])
            cov[a, i, j] += share * (cov[b, i, j] - cov[a, i, j] + (1.0 - share) * spread)
    for i in range(4):
        mean[a, i] += share * (mean[b, i] - mean[a, i])


class _Representatives(NamedTuple):
    """Scratch for merging (see the table above)."""

    mean: FloatArray
    cholesky: FloatArray
    is_factored: BoolArray
    weight: FloatArray
    row: IntArray
    order: SortBuffers


class _Work(NamedTuple):
    """Scratch for one label."""

    components: _Components
    reps: _Representatives


@leaf
def _compute_bounds(
    clusters: Clusters, singletons: IntArray, options: AssociationOptions, max_hypotheses: int
) -> tuple[int, int, int]:
    """Return bounds on all tracks and hypotheses, and on the components of one label."""
    n_tracks = 0
    n_hyps = 0
    max_components = 1
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
    work: _Work,
    predicted: Prediction,
    meas: IntArray,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
    max_distance2: float,
    out: Tracks,
) -> tuple[int, int]:
    """Update the components of a label and merge similar tracks.

    Representatives are tracks n, n + 1 ... and the empty hypothesis. Returns their number and the number of
    tracks.
    """
    components, reps = work
    count = ZERO
    at = n
    for k in range(kept):
        c = components.order.index[k]
        weight = components.weight[k]
        if components.option[c] == _EMPTY:
            reps.weight[count] = weight
            reps.row[count] = _EMPTY
            count += 1
            continue
        o = components.option[c]
        p = components.parent[c]
        update_track(predicted.mean, predicted.cov, p, meas[o], z, meas_model, out.mean, out.cov, at)
        representative = -1
        for d in range(count):
            if reps.row[d] == _EMPTY or max_distance2 <= 0.0:
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
        out.parent[at] = p
        out.option[at] = o
        reps.weight[count] = weight
        reps.row[count] = at
        reps.is_factored[count] = False
        count += 1
        at += 1
    return count, at


@inlined
def _add_marginals(
    kept: int, components: _Components, meas: IntArray, track_label: IntArray, marginals: DetectionMarginals
) -> None:
    """Add the kept components of a label to the marginals."""
    for k in range(kept):
        c = components.order.index[k]
        if components.option[c] != _EMPTY:
            weight = components.weight[k]
            j = meas[components.option[c]]
            label = track_label[components.parent[c]]
            marginals.p_exists[label] += weight
            if j >= 0:
                marginals.p_explained[j] += weight
                marginals.p_detected[label] += weight


@inlined
def _prefetch_detection(
    clusters: Clusters, singletons: IntArray, i: int, options: AssociationOptions, z: FloatArray
) -> None:
    """Prefetch the likeliest detection of singleton i."""
    if i < singletons.size:
        track = clusters.items[clusters.start[clusters.first[singletons[i]]]]
        detection = options.meas[options.start[track]]
        if detection >= 0:
            prefetch_row(z, detection)


@leaf
def _update_singletons(
    predicted: Prediction,
    singletons: IntArray,
    options: AssociationOptions,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
    limits: Limits,
    marginals: DetectionMarginals,
    work: _Work,
    out: Tracks,
) -> tuple[int, int, int]:
    """Update all singletons; return the number of clusters, hypotheses and tracks that are kept."""
    clusters = predicted.clusters
    meas = options.meas
    components, reps = work
    first, start, items, logw = out.clusters
    first[0] = start[0] = n_clusters = n = h = ZERO
    for i in range(singletons.size):
        _prefetch_detection(clusters, singletons, i + _PREFETCH_LABELS, options, z)
        kept = _weigh_components(clusters, singletons[i], options, limits, components)
        existence = 0.0
        for k in range(kept):
            if components.option[components.order.index[k]] != _EMPTY:
                existence += components.weight[k]
        if marginals.p_exists.size > 0:
            _add_marginals(kept, components, meas, predicted.track_label, marginals)
        if existence == 0.0 or existence < limits.min_existence:
            continue
        count, n = _update_and_merge(n, kept, work, predicted, meas, z, meas_model, limits.merge_chi2, out)
        argsort_descending(reps.weight, ZERO, count, reps.order)
        for k in range(count):
            d = reps.order.index[k]
            logw[h] = reps.weight[d]
            start[h + 1] = start[h]
            if reps.row[d] != _EMPTY:
                items[start[h]] = reps.row[d]
                start[h + 1] += 1
            h += 1
        n_clusters += 1
        first[n_clusters] = h
    log_in_place(logw[:h])
    return n_clusters, h, n


@kernel
def update_singletons(
    predicted: Prediction,
    singletons: IntArray,
    options: AssociationOptions,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
    limits: Limits,
    n_spare_rows: int,
    marginals: DetectionMarginals,
) -> Tracks:
    """Update the `singletons`: indices of predicted clusters of one label without competitors.

    `marginals` are added to, unless they are empty. Means and covariances get `n_spare_rows` rows more.
    """
    n_tracks, n_hyps, max_components = _compute_bounds(
        predicted.clusters, singletons, options, limits.max_hypotheses
    )
    components = _Components(
        np.empty(max_components, np.int64),
        np.empty(max_components, np.int64),
        np.empty(max_components),
        allocate_sort(max_components),
        np.empty(max_components),
    )
    reps = _Representatives(
        np.empty((max_components, 4)),
        np.empty((max_components, 4, 4)),
        np.empty(max_components, np.bool_),
        np.empty(max_components),
        np.empty(max_components, np.int64),
        allocate_sort(max_components),
    )
    rows = n_tracks + n_spare_rows
    out = Tracks(
        allocate_clusters(singletons.size, n_hyps, n_hyps),
        np.empty(n_tracks, np.int64),
        np.empty(n_tracks, np.int64),
        np.empty((rows, 4)),
        np.empty((rows, 4, 4)),
    )
    n_clusters, h, n = _update_singletons(
        predicted, singletons, options, z, meas_model, limits, marginals, _Work(components, reps), out
    )
    return Tracks(
        trim_clusters(out.clusters, n_clusters, h),
        head(out.parent, n),
        head(out.option, n),
        out.mean,
        out.cov,
    )
