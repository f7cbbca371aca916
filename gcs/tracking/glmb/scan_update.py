"""Update by a scan: from predicted tracks, by association, to the posterior tracks.

Singleton labels, which compete for no detection, are updated by themselves (`clusters.singleton`). All other
labels are associated jointly in their clusters (`joint_association`). Results are concatenated, singletons
first.

================  =============  =======  =====================================================
PosteriorTracks   shape          dtype    meaning (n tracks)
================  =============  =======  =====================================================
parent            (n,)           int64    predicted track
option            (n,)           int64    option that it took
label             (n,)           int64    row of `kept_labels`
kept_labels       (labels,)      int64    predicted labels that are kept
mean              (>= n, 4)      float64  rows beyond n are unused
cov               (>= n, 4, 4)   float64
================  =============  =======  =====================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, leaf
from gcs.tracking.clusters.cluster_product import merge_clusters
from gcs.tracking.clusters.factorisation import renumber, split_clusters
from gcs.tracking.clusters.singleton import DetectionMarginals, Tracks, update_singletons
from gcs.tracking.glmb.hypotheses import AssociationOptions, Clusters, allocate_clusters, append_clusters
from gcs.tracking.glmb.joint_association import update_clusters
from gcs.tracking.glmb.kalman import Prediction, update_tracks
from gcs.tracking.glmb.marginals import track_probabilities
from gcs.tracking.glmb.merging import merge_similar_tracks
from gcs.tracking.glmb.params import Limits

if TYPE_CHECKING:
    from gcs.model import FloatArray, IntArray, KeyArray
    from gcs.tracking.models.measurement_model import LinearisedMeasurement


class JointTracks(NamedTuple):
    """Tracks of clusters with several labels; items are rows of `kept`."""

    clusters: Clusters
    parent: IntArray
    option: IntArray
    mean: FloatArray
    cov: FloatArray
    kept: IntArray
    """Rows of the four arrays above that are kept."""


class PosteriorTracks(NamedTuple):
    """All tracks after a scan (see the table above)."""

    clusters: Clusters
    parent: IntArray
    option: IntArray
    label: IntArray
    kept_labels: IntArray
    mean: FloatArray
    cov: FloatArray


@leaf
def _concatenate(singletons: Tracks, joint: JointTracks, track_label: IntArray, out: PosteriorTracks) -> int:
    """Fill `out`, and the spare rows of `singletons`; return the number of kept labels."""
    out.clusters.first[0] = out.clusters.start[0] = n_labels = ZERO
    g, h, size = append_clusters(singletons.clusters, ZERO, ZERO, ZERO, ZERO, out.clusters)
    n = singletons.parent.size
    append_clusters(joint.clusters, g, h, size, n, out.clusters)
    for t in range(n + joint.kept.size):
        if t < n:
            parent = singletons.parent[t]
            out.option[t] = singletons.option[t]
        else:
            u = joint.kept[t - n]
            parent = joint.parent[u]
            out.option[t] = joint.option[u]
            for i in range(4):
                singletons.mean[t, i] = joint.mean[u, i]
                for j in range(4):
                    singletons.cov[t, i, j] = joint.cov[u, i, j]
        label = track_label[parent]
        if n_labels == 0 or out.kept_labels[n_labels - 1] != label:
            out.kept_labels[n_labels] = label
            n_labels += 1
        out.parent[t] = parent
        out.label[t] = n_labels - 1
    return n_labels


@inlined
def concatenate(singletons: Tracks, joint: JointTracks, track_label: IntArray) -> PosteriorTracks:
    """Concatenate the tracks, with the Gaussians in the spare rows of `singletons`.

    Tracks of a label are adjacent in both.
    """
    single_clusters = singletons.clusters
    n = singletons.parent.size + joint.kept.size
    clusters = allocate_clusters(
        single_clusters.first.size + joint.clusters.first.size - 2,
        single_clusters.logw.size + joint.clusters.logw.size,
        single_clusters.items.size + joint.clusters.items.size,
    )
    parent = np.empty(n, np.int64)
    option = np.empty(n, np.int64)
    label = np.empty(n, np.int64)
    kept_labels = np.empty(n, np.int64)
    count = _concatenate(
        singletons,
        joint,
        track_label,
        PosteriorTracks(clusters, parent, option, label, kept_labels, singletons.mean, singletons.cov),
    )
    return PosteriorTracks(
        clusters, parent, option, label, kept_labels[:count], singletons.mean, singletons.cov
    )


@leaf
def _look_up_options(
    options: AssociationOptions,
    track_label: IntArray,
    option: IntArray,
    parent: IntArray,
    meas: IntArray,
    label: IntArray,
) -> None:
    """Fill track, detection and label of each of some ascending options."""
    t = 0
    for i in range(option.size):
        while options.start[t + 1] <= option[i]:
            t += 1
        parent[i] = t
        meas[i] = options.meas[option[i]]
        label[i] = track_label[t]


@leaf
def _add_marginals(
    probability: FloatArray, meas: IntArray, label: IntArray, marginals: DetectionMarginals
) -> None:
    """Add the probabilities of tracks to the marginals of their labels and detections."""
    for i in range(meas.size):
        marginals.p_exists[label[i]] += probability[i]
        if meas[i] >= 0:
            marginals.p_explained[meas[i]] += probability[i]
            marginals.p_detected[label[i]] += probability[i]


@inlined
def joint_update(
    predicted: Prediction,
    options: AssociationOptions,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
    limits: Limits,
    rng: KeyArray,
    marginals: DetectionMarginals,
) -> PosteriorTracks:
    """Return the `PosteriorTracks` of a scan.

    `rng` (1,) uint64 advances. `marginals` are added to, unless they are empty.
    """
    track_label = predicted.track_label
    singletons, joint_clusters = merge_clusters(predicted.clusters, options, track_label, z.shape[0], limits)
    joint_clusters, option = renumber(
        update_clusters(joint_clusters, options, z.shape[0], limits, rng), options.meas.size
    )
    tracks = update_singletons(predicted, singletons, options, z, meas_model, limits, option.size, marginals)
    parent = np.empty_like(option)
    meas = np.empty_like(option)
    label = np.empty_like(option)
    _look_up_options(options, track_label, option, parent, meas, label)
    mean, cov = update_tracks(predicted.mean, predicted.cov, parent, meas, z, meas_model)
    if marginals.p_exists.size > 0:
        _add_marginals(track_probabilities(joint_clusters, meas.size), meas, label, marginals)
    joint_clusters = merge_similar_tracks(joint_clusters, mean, cov, label, limits.merge_chi2)
    n_labels = predicted.labels.shape[0]
    joint_clusters, kept = renumber(split_clusters(joint_clusters, label, n_labels, limits), option.size)
    return concatenate(tracks, JointTracks(joint_clusters, parent, option, mean, cov, kept), track_label)
