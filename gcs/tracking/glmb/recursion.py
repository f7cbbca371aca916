"""The GLMB recursion: one compiled call takes the posterior from one scan to the next.

Source: B.-N. Vo, B.-T. Vo & H. Hoang, "An Efficient Implementation of the Generalized Labeled
Multi-Bernoulli Filter", IEEE Trans. Signal Processing 65(8), 2017, doi:10.1109/TSP.2016.2641392.

The density of the labelled set X, with labels L(X), is a mixture of hypotheses. Each is a label set I with
one association history xi:

    pi(X) = Delta(X) sum_(I, xi) w^(I, xi) delta_I(L(X)) prod_((x, l) in X) p^(xi)(x, l)

A scan Z = {z_1 ... z_m} gives each label l of I, and each label that may be born, one value gamma(l): -2 for
dead or not born, -1 for missed, j >= 0 for detected as z_j. gamma is *positive 1-1*: no two labels have the
same j >= 0. A posterior component is a hypothesis with such a gamma:

    w^(I, xi, gamma)  propto  w^(I, xi) prod_l eta_l(gamma(l))                            (recursion)

    eta_l(-2) = 1 - p_S                       (birth: 1 - r_B)
    eta_l(-1) = p_S (1 - p_D P(x in field of view))
    eta_l(j)  = p_S p_D N(z_j; z_hat, S) / kappa(z_j),    S = A P A' + R                  (birth: r_B for p_S)

    p^(xi, j) = the Kalman update of the predicted p^(xi) with z_j

The Gibbs sampler visits components of one hypothesis. It draws gamma(l) for one label after the other, given
all other labels (section III-C):

    P(gamma(l) = a | gamma(other labels))  propto  eta_l(a)  if a < 0 or no other label has a      (Gibbs)
                                                   0         otherwise

Ranked assignment of the same eta, by branch and bound, finds the best components of a small hypothesis
exactly (`joint_association`). Gating limits j to the detections in the gate of each track (`gating`).

======================  ==========================================================================
symbol                  array
======================  ==========================================================================
w^(I, xi)               ``exp(clusters.logw)``, sums to 1 in each cluster
(I, xi)                 ``clusters.items[start[h]:start[h + 1]]``: tracks, each one (l, xi)
p^(xi)(., l)            ``mean``, ``cov`` of the track (one Gaussian)
gamma(l), log eta_l     ``options.meas``, ``options.logw``: from ``options.start[t]`` on, the best first
z_j, log kappa(z_j)     ``OrderedMeasurements.z``, ``.log_clutter``
z_hat, A, R, P(...)     ``LinearisedMeasurement.z_hat``, ``.A``, ``.noise``, ``.p_in_fov``
log p_S, log(1 - p_S)   ``Prediction.log_survival``, ``.log_death``
======================  ==========================================================================

The density is kept as a product over clusters of labels that compete for detections (M. Beard, B.-T. Vo &
B.-N. Vo, "A Solution for Large-Scale Multi-Object Tracking", IEEE Trans. Signal Processing 68, 2020,
doi:10.1109/TSP.2020.2986136). The recursion runs in each cluster.

Steps of a scan: predict and add births (`kalman`), order detections (`scan_detections`), linearise the sensor
(`models.measurement_model`), list association options (`gating`), and associate and update (`scan_update`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gcs.jit import Call, kernel, leaf
from gcs.model import BoolArray, FloatArray, IntArray, KeyArray
from gcs.tracking.clusters.cluster_product import merge_clusters
from gcs.tracking.clusters.factorisation import renumber, split_clusters
from gcs.tracking.clusters.singleton import DetectionMarginals, update_singletons
from gcs.tracking.glmb.gating import association_options
from gcs.tracking.glmb.hypotheses import AssociationOptions, Clusters
from gcs.tracking.glmb.joint_association import update_clusters
from gcs.tracking.glmb.kalman import Interval, Prediction, predict_with_births
from gcs.tracking.glmb.marginals import track_probabilities
from gcs.tracking.glmb.merging import merge_similar_tracks
from gcs.tracking.glmb.params import BirthComponents, GlmbParams, Limits
from gcs.tracking.glmb.scan_detections import Measurements, order_measurements
from gcs.tracking.glmb.scan_update import PosteriorTracks, joint_update
from gcs.tracking.models import coordinated_turn, measurement_model
from gcs.tracking.models.coordinated_turn import TurnModel
from gcs.tracking.models.survival import Survival

# Probabilities above which a label counts in the estimate of a sensor's detection probability.
_CERTAIN_EXISTENCE = 0.95
_CERTAIN_IN_FOV = 0.999


class Posterior(NamedTuple):
    """State of a tracker after a scan; n tracks of L labels.

    =============  =========  =======  =====================================================
    clusters       Clusters            hypotheses; their items are tracks
    track_label    (n,)       int64    row of `labels`; tracks of a label are adjacent
    labels         (L, 2)     int64    scan of birth, index of the birth in that scan
    mean           (n, 4)     float64  east, north, v_east, v_north
    cov            (n, 4, 4)  float64
    turn           (n, 6)     float64  turn rates (`coordinated_turn`); (0, 6) without turns
    is_certain     (L,)       bool     existed almost surely; (0,) unless summarised
    =============  =========  =======  =====================================================
    """

    clusters: Clusters
    track_label: IntArray
    labels: IntArray
    mean: FloatArray
    cov: FloatArray
    turn: FloatArray
    is_certain: BoolArray

    @classmethod
    def empty(cls) -> Posterior:
        """Return the state before the first scan: no labels."""
        none = np.zeros(1, np.int64)
        ids = np.empty(0, np.int64)
        return cls(
            Clusters(none, none, ids, np.empty(0)),
            ids,
            np.empty((0, 2), np.int64),
            np.empty((0, 4)),
            np.empty((0, 4, 4)),
            np.empty((0, 6)),
            np.empty(0, np.bool_),
        )


class DetectionSummary(NamedTuple):
    """What the tracks explain of a scan, for adaptive births and sensor estimation."""

    explained: FloatArray
    """(m,) float64, probability that a track made each detection; 1 for an unusable detection."""
    detected: float
    """Expected number of detected objects, among those that certainly existed and were in view."""
    in_view: float
    """Number of objects that certainly existed and were in view."""


class UpdateResult(NamedTuple):
    """Result of a scan; n tracks, m usable detections.

    ==========  ================  =======  ================================================================
    posterior   Posterior
    summary     DetectionSummary           filled if summarised
    n_unusable  int                        detections that are not finite
    parent      (n,)              int64    track before the scan; births are numbered behind these
    meas        (n,)              int64    row of `position_m`, or MISSED
    logw        (n,)              float64  log eta of that
    position_m  (m, 2)            float64  usable detections, east and north
    ==========  ================  =======  ================================================================
    """

    posterior: Posterior
    summary: DetectionSummary
    n_unusable: int
    parent: IntArray
    meas: IntArray
    logw: FloatArray
    position_m: FloatArray


@leaf
def _summarise_detections(
    is_certain: BoolArray,
    track_label: IntArray,
    p_in_fov: FloatArray,
    label_in_fov: FloatArray,
    marginals: DetectionMarginals,
    rows: IntArray,
    explained: FloatArray,
) -> tuple[float, float]:
    """Fill `explained`; return the detected and the in-view number of the `is_certain` labels."""
    label_in_fov[:] = 1.0
    for t in range(track_label.size):
        label_in_fov[track_label[t]] = min(label_in_fov[track_label[t]], p_in_fov[t])
    in_view = detected = 0.0
    for label in range(is_certain.size):
        if is_certain[label] and label_in_fov[label] > _CERTAIN_IN_FOV:
            in_view += 1.0
            detected += marginals.p_detected[label]
    explained[:] = 1.0
    for i in range(rows.size):
        explained[rows[i]] = min(marginals.p_explained[i], 1.0)
    return detected, in_view


@leaf
def _gather_outputs(
    updated: PosteriorTracks,
    options: AssociationOptions,
    labels: IntArray,
    p_exists: FloatArray,
    out: tuple[IntArray, FloatArray, IntArray, BoolArray],
) -> None:
    """Fill detection and weight of each track, and the labels that are kept with their certainty."""
    meas, logw, labels_out, is_certain = out
    for i in range(updated.option.size):
        meas[i] = options.meas[updated.option[i]]
        logw[i] = options.logw[updated.option[i]]
    for i in range(updated.kept_labels.size):
        label = updated.kept_labels[i]
        labels_out[i, 0] = labels[label, 0]
        labels_out[i, 1] = labels[label, 1]
    for i in range(is_certain.size):
        is_certain[i] = p_exists[updated.kept_labels[i]] > _CERTAIN_EXISTENCE


@kernel
def update_step(
    prior: Posterior,
    interval: Interval,
    scan: Measurements,
    sensor: measurement_model.SensorModel,
    limits: Limits,
    turns: TurnModel,
    is_summarised: bool,
    rng: KeyArray,
) -> UpdateResult:
    """Predict and update the posterior with one scan; `rng` (1,) uint64 advances."""
    mean = prior.mean
    cov = prior.cov
    turn = prior.turn
    has_turns = turns.rate_std_rad_s > 0.0
    if has_turns:
        births = interval.births
        if interval.dt_s > 0.0:
            mean, cov, turn = coordinated_turn.predict(
                mean, cov, turn, interval.Q, interval.dt_s, turns.rate_std_rad_s, turns.time_s
            )
        turn = coordinated_turn.append_births(turn, births.log_survival.size, turns.rate_std_rad_s)
        # The motion is predicted; survival and births are left.
        interval = Interval(0.0, np.zeros((4, 4)), interval.survival, interval.scan, births)
    predicted = predict_with_births(prior.clusters, prior.track_label, prior.labels, mean, cov, interval)
    measured = order_measurements(scan)
    meas_model = measurement_model.linearise(sensor, predicted.mean, predicted.cov)
    start, meas, logw = association_options(
        predicted.cov, predicted.log_survival, predicted.log_death, measured.z, meas_model,
        measured.log_clutter, limits.gate_chi2,
    )  # fmt: skip
    options = AssociationOptions(start, meas, logw)
    n_labels = predicted.labels.shape[0]
    sizes = (measured.rows.size, n_labels, scan.z.shape[0]) if is_summarised else (0, 0, 0)
    marginals = DetectionMarginals(np.zeros(sizes[0]), np.zeros(sizes[1]), np.zeros(sizes[1]))
    updated = joint_update(predicted, options, measured.z, meas_model, limits, rng, marginals)
    explained = np.empty(sizes[2])
    detected = 0.0
    in_view = 0.0
    if is_summarised:
        detected, in_view = _summarise_detections(
            prior.is_certain, predicted.track_label, meas_model.p_in_fov, np.empty(n_labels), marginals,
            measured.rows, explained,
        )  # fmt: skip
    n = updated.parent.size
    n_kept = updated.kept_labels.size
    out = (
        np.empty(n, np.int64),
        np.empty(n),
        np.empty((n_kept, 2), np.int64),
        np.empty(n_kept * is_summarised, np.bool_),
    )
    _gather_outputs(updated, options, predicted.labels, marginals.p_exists, out)
    if has_turns:
        turn = coordinated_turn.update(predicted.cov, turn, updated.parent, out[0], measured.z, meas_model)
    return UpdateResult(
        Posterior(updated.clusters, updated.label, out[2], updated.mean[:n], updated.cov[:n], turn, out[3]),
        DetectionSummary(explained, detected, in_view),
        scan.z.shape[0] - measured.rows.size,
        updated.parent,
        out[0],
        out[1],
        measured.position_m,
    )


def warm_up_calls() -> list[Call]:
    """Return one call of the kernel of a scan, with the types of a tracker."""
    births = BirthComponents.from_births(())
    origin = np.zeros((1, 2))
    interval = Interval(1.0, np.eye(4), Survival(0.0, 0.0, 0.0, 0.0, 1.0), 0, births)
    scan = Measurements(origin, origin, np.zeros(1))
    sensor = measurement_model.SensorModel(
        False, np.eye(2).reshape(1, 2, 2), np.zeros((2, 2)), np.zeros(2), 0.0, 0.9,
        np.zeros((0, 0), np.float32), np.zeros(3),
    )  # fmt: skip
    rng = np.zeros(1, np.uint64)
    limits = GlmbParams(1.0).limits()
    turns = TurnModel(0.0, 1.0)
    return [(update_step, Posterior.empty(), interval, scan, sensor, limits, turns, False, rng)]


def warm_up_parts() -> list[Call]:
    """Return one call of each kernel that `update_step` calls, with the same types.

    Two processes compile this list from both ends (see `gcs.jit`), so the kernels in the middle are short.
    """
    ones = np.ones(1)
    zeros = np.zeros(1, np.int64)
    z = np.zeros((1, 2))
    limits = GlmbParams(1.0).limits()
    mean = np.zeros((1, 4))
    cov = np.eye(4).reshape(1, 4, 4)
    matrix = np.eye(2).reshape(1, 2, 2)
    meas_model = measurement_model.LinearisedMeasurement(z, matrix, matrix, ones, 0.9, has_bearing=False)
    clusters = Clusters.example()
    options = AssociationOptions(np.arange(2), zeros, ones)
    marginals = DetectionMarginals(ones, ones, ones)
    predicted = Prediction(clusters, zeros, np.zeros((1, 2), np.int64), mean, cov, ones, ones)
    return [
        (update_clusters, clusters, options, 1, limits, np.zeros(1, np.uint64)),
        (merge_clusters, clusters, options, zeros, 1, limits),
        (renumber, clusters, 1),
        (track_probabilities, clusters, 1),
        (update_singletons, predicted, zeros, options, z, meas_model, limits, 1, marginals),
        (merge_similar_tracks, clusters, mean, cov, zeros, 0.1),
        (split_clusters, clusters, zeros, 1, limits),
    ]
