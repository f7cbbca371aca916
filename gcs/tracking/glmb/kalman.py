"""Compiled single-object numerics over flat arrays: predict and update.

Everything here works per *track* (one label with one association history, one Gaussian), never per
hypothesis: hypotheses share tracks, so each prediction and update is computed once (Vo, Vo & Hoang 2017,
section IV). What is known to be 0 or 1 in the matrices is not multiplied: that halves the time of a scan's
predictions and updates, and changes no bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gcs.jit import inlined, leaf, spliced
from gcs.tracking.glmb.gating import innovation
from gcs.tracking.glmb.hypotheses import Clusters, room_for_groups
from gcs.tracking.models.measurement import LinearisedMeasurement, wrapped

if TYPE_CHECKING:
    from gcs.model import FloatArray
    from gcs.tracking.glmb.params import BirthComponents


class Prediction(NamedTuple):
    """Tracks as they are expected at a scan, those just born behind the others, and what they make up."""

    groups: Clusters
    track_label: Any
    """(n,) which label each is of."""
    labels: Any
    """(labels, 2) scan of birth and index there."""
    mean: Any
    cov: Any
    log_live: Any
    """(n,) log of the probability to live, or to appear."""
    log_die: Any
    """(n,) and not to."""


class Chances(NamedTuple):
    """Logs of what happens to tracks between scans."""

    live: float
    die: float
    lost_live: float
    """Of tracks given up."""
    lost_die: float
    lost_m2: float
    """Variance along the worse axis beyond which a track is given up."""


@leaf
def moved(
    mean: FloatArray, cov: FloatArray, t: int, dt_s: float, Q: FloatArray, mean_out: FloatArray, cov_out: Any
) -> None:
    """Kalman prediction of track t, F and `Q` of `motion`."""
    for i in range(2):
        mean_out[t, i] = mean[t, i] + dt_s * mean[t, i + 2]
        mean_out[t, i + 2] = mean[t, i + 2]
        for j in range(i + 1):
            near = cov[t, i, j] + dt_s * cov[t, i + 2, j]
            far = cov[t, i, j + 2] + dt_s * cov[t, i + 2, j + 2]
            cov_out[t, i, j] = cov_out[t, j, i] = Q[i, j] + near + far * dt_s
        for j in range(2):
            cross = Q[i + 2, j] + cov[t, i + 2, j] + cov[t, i + 2, j + 2] * dt_s
            cov_out[t, i + 2, j] = cov_out[t, j, i + 2] = cross
        for j in range(2, i + 3):
            cov_out[t, i + 2, j] = cov_out[t, j, i + 2] = Q[i + 2, j] + cov[t, i + 2, j]


@leaf
def _predict(
    mean: FloatArray, cov: FloatArray, dt_s: float, Q: FloatArray, chances: Chances, to: Any
) -> None:
    for t in range(mean.shape[0]):
        moved(mean, cov, t, dt_s, Q, to.mean, to.cov)
        to.log_live[t], to.log_die[t] = chances.live, chances.die
        if max(to.cov[t, 0, 0], to.cov[t, 1, 1]) > chances.lost_m2:
            to.log_live[t], to.log_die[t] = chances.lost_live, chances.lost_die


@leaf
def _append(groups: Clusters, track_label: Any, labels: Any, scan: int, born: Any, to: Prediction) -> None:
    """Put those just born behind the others, each a group of its own."""
    n_groups, n_hyps, n_items = groups.first.size - 1, groups.logw.size, groups.items.size
    n, n_labels = track_label.size, labels.shape[0]
    to.groups.first[0] = to.groups.start[0] = 0
    for i in range(n_groups):
        to.groups.first[i + 1] = groups.first[i + 1]
    for i in range(n_hyps):
        to.groups.start[i + 1], to.groups.logw[i] = groups.start[i + 1], groups.logw[i]
    for i in range(n_items):
        to.groups.items[i] = groups.items[i]
    for i in range(n):
        to.track_label[i] = track_label[i]
    for i in range(n_labels):
        to.labels[i, 0], to.labels[i, 1] = labels[i, 0], labels[i, 1]
    for b in range(born.mean.shape[0]):
        to.groups.first[n_groups + b + 1], to.groups.start[n_hyps + b + 1] = n_hyps + b + 1, n_items + b + 1
        to.groups.logw[n_hyps + b], to.groups.items[n_items + b] = 0.0, n + b
        to.track_label[n + b] = n_labels + b
        to.labels[n_labels + b, 0], to.labels[n_labels + b, 1] = scan, b
        to.log_live[n + b], to.log_die[n + b] = born.log_live[b], born.log_die[b]
        for i in range(4):
            to.mean[n + b, i] = born.mean[b, i]
            for j in range(4):
                to.cov[n + b, i, j] = born.cov[b, i, j]


@inlined
def foresee(
    groups: Clusters,
    track_label: Any,
    labels: Any,
    mean: FloatArray,
    cov: FloatArray,
    dt_s: float,
    Q: FloatArray,
    chances: Chances,
    scan: int,
    born: BirthComponents,
) -> Prediction:
    """Predict all tracks by `dt_s`, and add those that may have been born by this scan."""
    n, more, n_labels = track_label.size, born.mean.shape[0], labels.shape[0]
    out = Prediction(
        room_for_groups(groups.first.size - 1 + more, groups.logw.size + more, groups.items.size + more),
        np.empty(n + more, np.int64),
        np.empty((n_labels + more, 2), np.int64),
        np.empty((n + more, 4)),
        np.empty((n + more, 4, 4)),
        np.empty(n + more),
        np.empty(n + more),
    )
    _predict(mean, cov, dt_s, Q, chances, out)
    _append(groups, track_label, labels, scan, born, out)
    return out


@inlined
def _gain(
    x: float, y: float, view: LinearisedMeasurement, u: int, a: float, b: float, c: float, det: float
) -> Any:
    """One row of K = P H' S^-1, from the first two elements of that row of P and from S."""
    e = x * view.A[u, 0, 0] + y * view.A[u, 0, 1]
    f = x * view.A[u, 1, 0] + y * view.A[u, 1, 1]
    return (e * c - f * b) / det, (f * a - e * b) / det


@inlined
def _left(row: int, k0: float, k1: float, view: LinearisedMeasurement, u: int) -> Any:
    """One row of I - K H, its first two elements; the others are those of I."""
    return (
        (1.0 if row == 0 else 0.0) - (k0 * view.A[u, 0, 0] + k1 * view.A[u, 1, 0]),
        (1.0 if row == 1 else 0.0) - (k0 * view.A[u, 0, 1] + k1 * view.A[u, 1, 1]),
    )


@inlined
def _noisy(
    total: float, k0: float, k1: float, view: LinearisedMeasurement, u: int, l0: float, l1: float
) -> Any:
    """Add an element of K noise K', from two rows of K."""
    r = view.noise
    return total + k0 * r[u, 0, 0] * l0 + k0 * r[u, 0, 1] * l1 + k1 * r[u, 1, 0] * l0 + k1 * r[u, 1, 1] * l1


@spliced
def updated(
    mean: FloatArray,
    cov: FloatArray,
    p: int,
    j: int,
    z: FloatArray,
    view: LinearisedMeasurement,
    mean_out: FloatArray,
    cov_out: FloatArray,
    i: int,
) -> None:
    """Put at i the Kalman update of track p with detection j (or MISSED), in Joseph form.

    With H = [A, 0]: P' = (I - K H) P (I - K H)' + K noise K' stays positive definite whatever the ratio of P
    to the noise. Element by element, because loops over so small matrices take four times as long.
    """
    if j < 0:
        for r in range(4):
            mean_out[i, r] = mean[p, r]
            for s in range(4):
                cov_out[i, r, s] = cov[p, r, s]
        return
    u = 0 if view.A.shape[0] == 1 else p
    a, b, c = innovation(cov, p, view, u)
    det = a * c - b * b
    dx, dy = z[j, 0] - view.z_hat[p, 0], z[j, 1] - view.z_hat[p, 1]
    if view.wraps:
        dy = wrapped(dy)
    p00, p10, p11 = cov[p, 0, 0], cov[p, 1, 0], cov[p, 1, 1]
    p20, p21, p22 = cov[p, 2, 0], cov[p, 2, 1], cov[p, 2, 2]
    p30, p31, p32, p33 = cov[p, 3, 0], cov[p, 3, 1], cov[p, 3, 2], cov[p, 3, 3]
    k00, k01 = _gain(p00, p10, view, u, a, b, c, det)
    k10, k11 = _gain(p10, p11, view, u, a, b, c, det)
    k20, k21 = _gain(p20, p21, view, u, a, b, c, det)
    k30, k31 = _gain(p30, p31, view, u, a, b, c, det)
    mean_out[i, 0] = mean[p, 0] + k00 * dx + k01 * dy
    mean_out[i, 1] = mean[p, 1] + k10 * dx + k11 * dy
    mean_out[i, 2] = mean[p, 2] + k20 * dx + k21 * dy
    mean_out[i, 3] = mean[p, 3] + k30 * dx + k31 * dy
    a00, a01 = _left(0, k00, k01, view, u)
    a10, a11 = _left(1, k10, k11, view, u)
    a20, a21 = _left(2, k20, k21, view, u)
    a30, a31 = _left(3, k30, k31, view, u)
    # What is needed of (I - K H) P: two columns, and below the diagonal the others.
    b00, b01 = a00 * p00 + a01 * p10, a00 * p10 + a01 * p11
    b10, b11 = a10 * p00 + a11 * p10, a10 * p10 + a11 * p11
    b20, b21 = a20 * p00 + a21 * p10 + p20, a20 * p10 + a21 * p11 + p21
    b30, b31 = a30 * p00 + a31 * p10 + p30, a30 * p10 + a31 * p11 + p31
    b22, b32 = a20 * p20 + a21 * p21 + p22, a30 * p20 + a31 * p21 + p32
    b33 = a30 * p30 + a31 * p31 + p33
    q = cov_out
    q[i, 0, 0] = _noisy(b00 * a00 + b01 * a01, k00, k01, view, u, k00, k01)
    q[i, 1, 0] = q[i, 0, 1] = _noisy(b10 * a00 + b11 * a01, k10, k11, view, u, k00, k01)
    q[i, 1, 1] = _noisy(b10 * a10 + b11 * a11, k10, k11, view, u, k10, k11)
    q[i, 2, 0] = q[i, 0, 2] = _noisy(b20 * a00 + b21 * a01, k20, k21, view, u, k00, k01)
    q[i, 2, 1] = q[i, 1, 2] = _noisy(b20 * a10 + b21 * a11, k20, k21, view, u, k10, k11)
    q[i, 2, 2] = _noisy(b20 * a20 + b21 * a21 + b22, k20, k21, view, u, k20, k21)
    q[i, 3, 0] = q[i, 0, 3] = _noisy(b30 * a00 + b31 * a01, k30, k31, view, u, k00, k01)
    q[i, 3, 1] = q[i, 1, 3] = _noisy(b30 * a10 + b31 * a11, k30, k31, view, u, k10, k11)
    q[i, 3, 2] = q[i, 2, 3] = _noisy(b30 * a20 + b31 * a21 + b32, k30, k31, view, u, k20, k21)
    q[i, 3, 3] = _noisy(b30 * a30 + b31 * a31 + b33, k30, k31, view, u, k30, k31)


@leaf
def _update(
    mean: FloatArray,
    cov: FloatArray,
    parent: Any,
    meas: Any,
    z: FloatArray,
    view: LinearisedMeasurement,
    mean_out: FloatArray,
    cov_out: FloatArray,
) -> None:
    for i in range(parent.size):
        updated(mean, cov, parent[i], meas[i], z, view, mean_out, cov_out, i)


@inlined
def update(
    mean: FloatArray, cov: FloatArray, parent: Any, meas: Any, z: FloatArray, view: LinearisedMeasurement
) -> tuple[FloatArray, FloatArray]:
    """Kalman update of each track `parent[i]` with detection `meas[i]` (or MISSED)."""
    mean_out, cov_out = np.empty((parent.size, 4)), np.empty((parent.size, 4, 4))
    _update(mean, cov, parent, meas, z, view, mean_out, cov_out)
    return mean_out, cov_out
