"""Nearly coordinated turn: the turn rate as a fifth state beside position and velocity.

Coordinated turn with unknown rate w (Bar-Shalom, Li & Kirubarajan 2001, section 11.7), counter-clockwise:

    p' = p + (sin(w dt) v + (1 - cos(w dt)) J v) / w
    v' = cos(w dt) v + sin(w dt) J v,    J v = (-v_n, v_e)

with white acceleration as in `constant_velocity`. The rate is a stationary Ornstein-Uhlenbeck process with
standard deviation sigma and time constant tau: w' = exp(-dt/tau) w, since aircraft roll into turns and out of
them.

This is an extended Kalman filter on [p, v, w] in blocks. Mean (4,) and covariance (4, 4) are those of all
other kernels. Each track has a row of ``turn`` (n, 6) float64: w, its variance, and its covariance with the
other four states. So association and update do not depend on the turn model. Where tracks merge, the
covariance with w is limited to keep the joint covariance positive definite.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.jit import Call, inlined, kernel, leaf
from gcs.model import FloatArray, IntArray
from gcs.tracking.models.measurement_model import LinearisedMeasurement, wrap_angle

_SMALL_ANGLE = 1e-4
_MAX_SQUARED_CORRELATION = 0.98
"""Between the turn rate and the other four states."""


class TurnModel(NamedTuple):
    """Model of the turn rate."""

    rate_std_rad_s: float
    """Standard deviation of the turn rate; 0 for straight motion."""
    time_s: float
    """Time constant of a turn."""


@inlined
def _arc(w: float, dt: float) -> tuple[float, float, float, float]:
    """Return sin(w dt)/w, (1 - cos(w dt))/w, and their derivatives by w."""
    a = w * dt
    if abs(a) < _SMALL_ANGLE:
        return dt, 0.5 * a * dt, -a * dt * dt / 3.0, 0.5 * dt * dt
    s = math.sin(a)
    c = math.cos(a)
    return s / w, (1.0 - c) / w, (dt * c * w - s) / (w * w), (dt * s * w - (1.0 - c)) / (w * w)


@inlined
def _linearise(w: float, vx: float, vy: float, dt: float, F: FloatArray, g: FloatArray) -> None:
    """Write the Jacobians of the four states by themselves (F) and by w (g)."""
    along, across, d_along, d_aside = _arc(w, dt)
    s = math.sin(w * dt)
    c = math.cos(w * dt)
    F[0, 2] = F[1, 3] = along
    F[0, 3] = -across
    F[1, 2] = across
    F[2, 2] = F[3, 3] = c
    F[2, 3] = -s
    F[3, 2] = s
    g[0] = d_along * vx - d_aside * vy
    g[1] = d_aside * vx + d_along * vy
    g[2] = -dt * (s * vx + c * vy)
    g[3] = dt * (c * vx - s * vy)


@inlined
def _limit_correlation(cov: FloatArray, turn: FloatArray, t: int) -> None:
    """Shrink the covariance with w to what positive definiteness allows."""
    lower = np.empty((4, 4))
    whitened = np.empty(4)
    total = 0.0
    for i in range(4):
        value = turn[t, 2 + i]
        for j in range(i + 1):
            element = cov[t, i, j]
            for k in range(j):
                element -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(max(element, 1e-12)) if i == j else element / lower[j, j]
        for k in range(i):
            value -= lower[i, k] * whitened[k]
        whitened[i] = value / lower[i, i]
        total += whitened[i] ** 2
    max_total = _MAX_SQUARED_CORRELATION * turn[t, 1]
    if total > max_total:
        shrink = math.sqrt(max_total / total)
        for i in range(4):
            turn[t, 2 + i] *= shrink


@kernel
def predict(
    mean: FloatArray,
    cov: FloatArray,
    turn: FloatArray,
    Q: FloatArray,
    dt: float,
    rate_std_rad_s: float,
    rate_time_s: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Predict every track: means (n, 4), covariances (n, 4, 4), turns (n, 6).

    `Q` is that of `constant_velocity`.
    """
    n = mean.shape[0]
    mean_out = np.empty((n, 4))
    cov_out = np.empty((n, 4, 4))
    turn_out = np.empty((n, 6))
    F = np.eye(4)
    FP = np.empty((4, 4))
    Fc = np.empty(4)
    g = np.empty(4)
    lateral = np.zeros((4, 4))
    cross = np.zeros(4)
    keep = math.exp(-dt / rate_time_s)
    stationary = rate_std_rad_s * rate_std_rad_s
    # The noise of the rate also turns the velocity: a triple integral of white noise.
    short = min(dt, rate_time_s)
    q = 2.0 * stationary / rate_time_s
    for t in range(n):
        _limit_correlation(cov, turn, t)
        w = turn[t, 0]
        variance = turn[t, 1]
        _linearise(w, mean[t, 2], mean[t, 3], dt, F, g)
        for i in range(4):
            predicted = 0.0
            coupled = 0.0
            for j in range(4):
                predicted += F[i, j] * mean[t, j]
                coupled += F[i, j] * turn[t, 2 + j]
                total = 0.0
                for k in range(4):
                    total += F[i, k] * cov[t, k, j]
                FP[i, j] = total
            mean_out[t, i] = predicted
            Fc[i] = coupled
        for i in range(2):  # lateral: J v at the end
            side_i = -mean_out[t, 3] if i == 0 else mean_out[t, 2]
            cross[i] = q * short**3 / 6.0 * side_i
            cross[2 + i] = q * short**2 / 2.0 * side_i
            for j in range(2):
                side = side_i * (-mean_out[t, 3] if j == 0 else mean_out[t, 2])
                lateral[i, j] = q * short**5 / 20.0 * side
                lateral[i, 2 + j] = lateral[2 + i, j] = q * short**4 / 8.0 * side
                lateral[2 + i, 2 + j] = q * short**3 / 3.0 * side
        for i in range(4):
            for j in range(i + 1):
                total = Q[i, j] + lateral[i, j] + Fc[i] * g[j] + g[i] * Fc[j] + variance * g[i] * g[j]
                for k in range(4):
                    total += FP[i, k] * F[j, k]
                cov_out[t, i, j] = cov_out[t, j, i] = total
            turn_out[t, 2 + i] = keep * (Fc[i] + variance * g[i]) + cross[i]
        turn_out[t, 0] = keep * w
        turn_out[t, 1] = keep * keep * variance + stationary * (1.0 - keep * keep)
        _limit_correlation(cov_out, turn_out, t)
    return mean_out, cov_out, turn_out


@kernel
def update(
    cov: FloatArray,
    turn: FloatArray,
    parent: IntArray,
    meas: IntArray,
    z: FloatArray,
    meas_model: LinearisedMeasurement,
) -> FloatArray:
    """Return the turns (n, 6) of the updates in `kalman.update_tracks`; `cov` and `turn` are predicted."""
    n = parent.size
    out = np.empty((n, 6))
    step = 0 if meas_model.A.shape[0] == 1 else 1
    PH = np.empty((4, 2))
    for i in range(n):
        p = parent[i]
        j = meas[i]
        for r in range(6):
            out[i, r] = turn[p, r]
        if j < 0:
            continue
        u = p * step
        H = meas_model.A[u]
        R = meas_model.noise[u]
        for r in range(4):
            for k in range(2):
                PH[r, k] = cov[p, r, 0] * H[k, 0] + cov[p, r, 1] * H[k, 1]
        a = H[0, 0] * PH[0, 0] + H[0, 1] * PH[1, 0] + R[0, 0]
        b = H[0, 0] * PH[0, 1] + H[0, 1] * PH[1, 1] + R[0, 1]
        c = H[1, 0] * PH[0, 1] + H[1, 1] * PH[1, 1] + R[1, 1]
        det = a * c - b * b
        h0 = H[0, 0] * turn[p, 2] + H[0, 1] * turn[p, 3]
        h1 = H[1, 0] * turn[p, 2] + H[1, 1] * turn[p, 3]
        g0 = (h0 * c - h1 * b) / det
        g1 = (h1 * a - h0 * b) / det
        dx = z[j, 0] - meas_model.z_hat[p, 0]
        dy = z[j, 1] - meas_model.z_hat[p, 1]
        if meas_model.has_bearing:
            dy = wrap_angle(dy)
        out[i, 0] += g0 * dx + g1 * dy
        out[i, 1] = max(out[i, 1] - g0 * h0 - g1 * h1, 1e-3 * turn[p, 1])
        for r in range(4):
            out[i, 2 + r] -= PH[r, 0] * g0 + PH[r, 1] * g1
    return out


@kernel
def jacobians(mean: FloatArray, dt: FloatArray, rate_time_s: float) -> FloatArray:
    """Return the Jacobians (n, 5, 5) of [p, v, w] over each `dt` (n,) at `mean` (n, 5)."""
    out = np.zeros((mean.shape[0], 5, 5))
    F = np.eye(4)
    g = np.empty(4)
    for k in range(mean.shape[0]):
        _linearise(mean[k, 4], mean[k, 2], mean[k, 3], dt[k], F, g)
        for i in range(4):
            out[k, i, 4] = g[i]
            for j in range(4):
                out[k, i, j] = F[i, j]
        out[k, 4, 4] = math.exp(-dt[k] / rate_time_s)
    return out


@leaf
def _append_births(turn: FloatArray, stationary: float, out: FloatArray) -> None:
    for t in range(out.shape[0]):
        for i in range(6):
            out[t, i] = turn[t, i] if t < turn.shape[0] else 0.0
        if t >= turn.shape[0]:
            out[t, 1] = stationary


@inlined
def append_births(turn: FloatArray, n: int, rate_std_rad_s: float) -> FloatArray:
    """Append the turns of n births, at the stationary distribution."""
    out = np.empty((turn.shape[0] + n, 6))
    _append_births(turn, rate_std_rad_s * rate_std_rad_s, out)
    return out


def warm_up_calls() -> list[Call]:
    """Return one call of every kernel that Python calls, with the types of a tracker."""
    return [(jacobians, np.zeros((1, 5)), np.ones(1), 5.0)]
