"""Kalman prediction and update of tracks in kernels, and the appending of births.

A track is one label with one association history and has one Gaussian. Hypotheses share tracks, so each
prediction and update is computed once (Vo, Vo & Hoang 2017, section IV). Products with matrix elements that
are known to be 0 or 1 are left out, which changes no bit.

================  ===========  =======  =====================================================
Prediction        shape        dtype    meaning (n tracks, L labels, births last)
================  ===========  =======  =====================================================
clusters          Clusters              each birth is a cluster of its own
track_label       (n,)         int64    label of each track
labels            (L, 2)       int64    scan of birth, index of the birth in that scan
mean, cov         (n, 4 (4))   float64  predicted Gaussians
log_survival      (n,)         float64  log p_S; of a birth log r_B
log_death         (n,)         float64  log(1 - p_S); of a birth log(1 - r_B)
================  ===========  =======  =====================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, leaf, spliced
from gcs.tracking.glmb.gating import innovation_cov
from gcs.tracking.glmb.hypotheses import Clusters, allocate_clusters, append_clusters
from gcs.tracking.models.measurement_model import LinearisedMeasurement, wrap_angle
from gcs.tracking.models.survival import Survival

if TYPE_CHECKING:
    from gcs.model import FloatArray, IntArray
    from gcs.tracking.glmb.params import BirthComponents


class Prediction(NamedTuple):
    """Predicted tracks and births (see the table above)."""

    clusters: Clusters
    track_label: IntArray
    labels: IntArray
    mean: FloatArray
    cov: FloatArray
    log_survival: FloatArray
    log_death: FloatArray


class Interval(NamedTuple):
    """The time since the last scan: motion, survival and births."""

    dt_s: float
    Q: FloatArray
    """(4, 4) process noise (see `constant_velocity`)."""
    survival: Survival
    scan: int
    """Number of this scan."""
    births: BirthComponents


@leaf
def predict_track(
    mean: FloatArray,
    cov: FloatArray,
    t: int,
    dt_s: float,
    Q: FloatArray,
    mean_out: FloatArray,
    cov_out: FloatArray,
) -> None:
    """Predict track t by `dt_s` at constant velocity, with process noise `Q` (`constant_velocity`)."""
    for i in range(2):
        mean_out[t, i] = mean[t, i] + dt_s * mean[t, i + 2]
        mean_out[t, i + 2] = mean[t, i + 2]
        for j in range(i + 1):
            at_start = cov[t, i, j] + dt_s * cov[t, i + 2, j]
            rate = cov[t, i, j + 2] + dt_s * cov[t, i + 2, j + 2]
            cov_out[t, i, j] = cov_out[t, j, i] = Q[i, j] + at_start + rate * dt_s
        for j in range(2):
            cross = Q[i + 2, j] + cov[t, i + 2, j] + cov[t, i + 2, j + 2] * dt_s
            cov_out[t, i + 2, j] = cov_out[t, j, i + 2] = cross
        for j in range(2, i + 3):
            cov_out[t, i + 2, j] = cov_out[t, j, i + 2] = Q[i + 2, j] + cov[t, i + 2, j]


@leaf
def _predict_tracks(mean: FloatArray, cov: FloatArray, interval: Interval, out: Prediction) -> None:
    for t in range(mean.shape[0]):
        predict_track(mean, cov, t, interval.dt_s, interval.Q, out.mean, out.cov)
        survival = interval.survival
        if max(out.cov[t, 0, 0], out.cov[t, 1, 1]) > survival.max_variance_m2:
            out.log_survival[t] = survival.log_survival_lost
            out.log_death[t] = survival.log_death_lost
        else:
            out.log_survival[t] = survival.log_survival
            out.log_death[t] = survival.log_death


@leaf
def _append_births(
    clusters: Clusters,
    track_label: IntArray,
    labels: IntArray,
    scan: int,
    births: BirthComponents,
    out: Prediction,
) -> None:
    """Append the births to the predicted tracks, each with a cluster of its own."""
    out.clusters.first[0] = out.clusters.start[0] = 0
    n_clusters, n_hyps, n_items = append_clusters(clusters, ZERO, ZERO, ZERO, ZERO, out.clusters)
    n = track_label.size
    n_labels = labels.shape[0]
    for i in range(n):
        out.track_label[i] = track_label[i]
    for i in range(n_labels):
        out.labels[i, 0] = labels[i, 0]
        out.labels[i, 1] = labels[i, 1]
    for b in range(births.mean.shape[0]):
        out.clusters.first[n_clusters + b + 1] = n_hyps + b + 1
        out.clusters.start[n_hyps + b + 1] = n_items + b + 1
        out.clusters.logw[n_hyps + b] = 0.0
        out.clusters.items[n_items + b] = n + b
        out.track_label[n + b] = n_labels + b
        out.labels[n_labels + b, 0] = scan
        out.labels[n_labels + b, 1] = b
        out.log_survival[n + b] = births.log_survival[b]
        out.log_death[n + b] = births.log_death[b]
        for i in range(4):
            out.mean[n + b, i] = births.mean[b, i]
            for j in range(4):
                out.cov[n + b, i, j] = births.cov[b, i, j]


@inlined
def predict_with_births(
    clusters: Clusters,
    track_label: IntArray,
    labels: IntArray,
    mean: FloatArray,
    cov: FloatArray,
    interval: Interval,
) -> Prediction:
    """Predict all tracks and append the births of this scan."""
    n = track_label.size
    n_births = interval.births.mean.shape[0]
    n_labels = labels.shape[0]
    out = Prediction(
        allocate_clusters(
            clusters.first.size - 1 + n_births, clusters.logw.size + n_births, clusters.items.size + n_births
        ),
        np.empty(n + n_births, np.int64),
        np.empty((n_labels + n_births, 2), np.int64),
        np.empty((n + n_births, 4)),
        np.empty((n + n_births, 4, 4)),
        np.empty(n + n_births),
        np.empty(n + n_births),
    )
    _predict_tracks(mean, cov, interval, out)
    _append_births(clusters, track_label, labels, interval.scan, interval.births, out)
    return out


@inlined
def _gain_row(
    x: float, y: float, meas_model: LinearisedMeasurement, u: int, a: float, b: float, c: float, det: float
) -> tuple[float, float]:
    """Return a row of K = P H' S^-1 from two elements of that row of P, and S = [[a, b], [b, c]]."""
    e = x * meas_model.A[u, 0, 0] + y * meas_model.A[u, 0, 1]
    f = x * meas_model.A[u, 1, 0] + y * meas_model.A[u, 1, 1]
    return (e * c - f * b) / det, (f * a - e * b) / det


@inlined
def _residual_row(
    row: int, k0: float, k1: float, meas_model: LinearisedMeasurement, u: int
) -> tuple[float, float]:
    """Return the first two elements of a row of I - K H; the others are those of I."""
    return (
        (1.0 if row == 0 else 0.0) - (k0 * meas_model.A[u, 0, 0] + k1 * meas_model.A[u, 1, 0]),
        (1.0 if row == 1 else 0.0) - (k0 * meas_model.A[u, 0, 1] + k1 * meas_model.A[u, 1, 1]),
    )


@inlined
def _add_noise_term(
    total: float, k0: float, k1: float, meas_model: LinearisedMeasurement, u: int, l0: float, l1: float
) -> float:
    """Add an element of K R K' to `total`, from two rows of K."""
    r = meas_model.noise
    return total + k0 * r[u, 0, 0] * l0 + k0 * r[u, 0, 1] * l1 + k1 * r[u, 1, 0] * l0 + k1 * r[u, 1, 1] * l1


@spliced
def update_track(
    mean: FloatArray,
    cov: FloatArray,
    p: int,
    j: int,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
    mean_out: FloatArray,
    cov_out: FloatArray,
    i: int,
) -> None:
    """Write to row i the Kalman update of track p with detection j (or MISSED), in Joseph form.

    With H = [A, 0], P' = (I - K H) P (I - K H)' + K R K' stays positive definite for any ratio of P to R.
    It is written out by element: loops over so small matrices take four times as long.
    """
    if j < 0:
        for r in range(4):
            mean_out[i, r] = mean[p, r]
            for s in range(4):
                cov_out[i, r, s] = cov[p, r, s]
        return
    u = 0 if meas_model.A.shape[0] == 1 else p
    a, b, c = innovation_cov(cov, p, meas_model, u)
    det = a * c - b * b
    dx = z[j, 0] - meas_model.z_hat[p, 0]
    dy = z[j, 1] - meas_model.z_hat[p, 1]
    if meas_model.has_bearing:
        dy = wrap_angle(dy)
    p00 = cov[p, 0, 0]
    p10 = cov[p, 1, 0]
    p11 = cov[p, 1, 1]
    p20 = cov[p, 2, 0]
    p21 = cov[p, 2, 1]
    p22 = cov[p, 2, 2]
    p30 = cov[p, 3, 0]
    p31 = cov[p, 3, 1]
    p32 = cov[p, 3, 2]
    p33 = cov[p, 3, 3]
    k00, k01 = _gain_row(p00, p10, meas_model, u, a, b, c, det)
    k10, k11 = _gain_row(p10, p11, meas_model, u, a, b, c, det)
    k20, k21 = _gain_row(p20, p21, meas_model, u, a, b, c, det)
    k30, k31 = _gain_row(p30, p31, meas_model, u, a, b, c, det)
    mean_out[i, 0] = mean[p, 0] + k00 * dx + k01 * dy
    mean_out[i, 1] = mean[p, 1] + k10 * dx + k11 * dy
    mean_out[i, 2] = mean[p, 2] + k20 * dx + k21 * dy
    mean_out[i, 3] = mean[p, 3] + k30 * dx + k31 * dy
    a00, a01 = _residual_row(0, k00, k01, meas_model, u)
    a10, a11 = _residual_row(1, k10, k11, meas_model, u)
    a20, a21 = _residual_row(2, k20, k21, meas_model, u)
    a30, a31 = _residual_row(3, k30, k31, meas_model, u)
    # (I - K H) P: two columns, and of the others the elements below the diagonal.
    b00 = a00 * p00 + a01 * p10
    b01 = a00 * p10 + a01 * p11
    b10 = a10 * p00 + a11 * p10
    b11 = a10 * p10 + a11 * p11
    b20 = a20 * p00 + a21 * p10 + p20
    b21 = a20 * p10 + a21 * p11 + p21
    b30 = a30 * p00 + a31 * p10 + p30
    b31 = a30 * p10 + a31 * p11 + p31
    b22 = a20 * p20 + a21 * p21 + p22
    b32 = a30 * p20 + a31 * p21 + p32
    b33 = a30 * p30 + a31 * p31 + p33
    q = cov_out
    q[i, 0, 0] = _add_noise_term(b00 * a00 + b01 * a01, k00, k01, meas_model, u, k00, k01)
    q[i, 1, 0] = q[i, 0, 1] = _add_noise_term(b10 * a00 + b11 * a01, k10, k11, meas_model, u, k00, k01)
    q[i, 1, 1] = _add_noise_term(b10 * a10 + b11 * a11, k10, k11, meas_model, u, k10, k11)
    q[i, 2, 0] = q[i, 0, 2] = _add_noise_term(b20 * a00 + b21 * a01, k20, k21, meas_model, u, k00, k01)
    q[i, 2, 1] = q[i, 1, 2] = _add_noise_term(b20 * a10 + b21 * a11, k20, k21, meas_model, u, k10, k11)
    q[i, 2, 2] = _add_noise_term(b20 * a20 + b21 * a21 + b22, k20, k21, meas_model, u, k20, k21)
    q[i, 3, 0] = q[i, 0, 3] = _add_noise_term(b30 * a00 + b31 * a01, k30, k31, meas_model, u, k00, k01)
    q[i, 3, 1] = q[i, 1, 3] = _add_noise_term(b30 * a10 + b31 * a11, k30, k31, meas_model, u, k10, k11)
    q[i, 3, 2] = q[i, 2, 3] = _add_noise_term(b30 * a20 + b31 * a21 + b32, k30, k31, meas_model, u, k20, k21)
    q[i, 3, 3] = _add_noise_term(b30 * a30 + b31 * a31 + b33, k30, k31, meas_model, u, k30, k31)


@leaf
def _update_tracks(
    mean: FloatArray,
    cov: FloatArray,
    parent: IntArray,
    meas: IntArray,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
    mean_out: FloatArray,
    cov_out: FloatArray,
) -> None:
    for i in range(parent.size):
        update_track(mean, cov, parent[i], meas[i], z, meas_model, mean_out, cov_out, i)


@inlined
def update_tracks(
    mean: FloatArray,
    cov: FloatArray,
    parent: IntArray,
    meas: IntArray,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
) -> tuple[FloatArray, FloatArray]:
    """Return means and covariances of the updates of tracks `parent` with detections `meas` (or MISSED)."""
    mean_out = np.empty((parent.size, 4))
    cov_out = np.empty((parent.size, 4, 4))
    _update_tracks(mean, cov, parent, meas, z, meas_model, mean_out, cov_out)
    return mean_out, cov_out
