"""One object's Kalman filter over a known association history, and smoothers over its result.

Filter: x_k|k-1 = F x, P_k|k-1 = F P F' + Q, then for a detection the gain K = P H' (H P H' + R)^-1 and the
Joseph form. Smoother (Rauch, Tung & Striebel 1965), with the gain G_k = P_k|k F' P_k+1|k^-1:

    x_k|n = x_k|k + G_k (x_k+1|n - x_k+1|k),    P_k|n = P_k|k + G_k (P_k+1|n - P_k+1|k) G_k'

With a fixed lag L the state k is that of n = min(k + L, last): what one knows L scans later.
State order [east, north, v_east, v_north], and the turn rate as a fifth where objects turn: then the filter
is that of `turning`, and the smoother takes the turn to be linear around the filtered states (an extended
one). H and R are those of `views.view`, which is linear around each track.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gcs.model import FloatArray, Sensor
from gcs.tracking import turning
from gcs.tracking.sensors import measured
from gcs.tracking.turning import Turns
from gcs.tracking.views import view, wrapped


class Step(NamedTuple):
    """One scan of an object's history."""

    dt_s: float
    """Time since the scan before."""
    F: FloatArray
    """(4, 4) transition from the scan before, straight ahead."""
    Q: FloatArray
    """(4, 4) process noise since the scan before."""
    sensor: Sensor
    """What made the detection."""
    z_m: FloatArray | None
    """(2,) the detection, east/north; None for a miss."""


class Run(NamedTuple):
    """A filter's result over n scans; d is 4, or 5 where objects turn."""

    mean: FloatArray
    """(n, d)."""
    cov: FloatArray
    """(n, d, d)."""
    predicted_mean: FloatArray
    """(n, d) before each scan's detection."""
    predicted_cov: FloatArray
    """(n, d, d)."""
    F: FloatArray
    """(n - 1, d, d) how each state but the first changes with the one before."""


def filtered(mean: FloatArray, cov: FloatArray, steps: Sequence[Step], turns: Turns | None = None) -> Run:
    """Filter from the prior (4,), (4, 4) at the time of the first scan; its F and Q do not apply."""
    n, x, P = len(steps), mean, cov
    if turns is not None:
        x, P = np.append(mean, 0.0), np.pad(cov, (0, 1))
        P[4, 4] = turns.rate_std_rad_s**2
    d = x.size
    means, covs = np.empty((2, n, d)), np.empty((2, n, d, d))
    for k, step in enumerate(steps):
        if k:
            x, P = _predicted(x, P, step, turns)
        means[0, k], covs[0, k] = x, P
        if step.z_m is not None:
            x, P = _updated(x, P, step.sensor, step.z_m)
        P = 0.5 * (P + P.T)
        means[1, k], covs[1, k] = x, P
    if turns is None:
        F = np.reshape([step.F for step in steps[1:]], (-1, 4, 4))
    else:
        F = turning.jacobians(means[1, :-1], np.array([step.dt_s for step in steps[1:]]), turns.time_s)
    return Run(means[1], covs[1], means[0], covs[0], F)


def smoothed(run: Run, lag_scans: int | None = None) -> tuple[FloatArray, FloatArray]:
    """Means (n, d) and covariances (n, d, d) given all scans, or those up to `lag_scans` later."""
    n = len(run.mean)
    mean, cov = run.mean.copy(), run.cov.copy()
    if n < 2:
        return mean, cov
    G = np.swapaxes(np.linalg.solve(run.predicted_cov[1:], run.F @ run.cov[:-1]), 1, 2)
    if lag_scans is None or lag_scans >= n - 1:
        for k in range(n - 2, -1, -1):
            mean[k] += G[k] @ (mean[k + 1] - run.predicted_mean[k + 1])
            cov[k] += G[k] @ (cov[k + 1] - run.predicted_cov[k + 1]) @ G[k].T
        return mean, cov
    for _ in range(lag_scans):
        mean[:-1] = run.mean[:-1] + np.einsum("kij,kj->ki", G, mean[1:] - run.predicted_mean[1:])
        cov[:-1] = run.cov[:-1] + G @ (cov[1:] - run.predicted_cov[1:]) @ np.swapaxes(G, 1, 2)
    return mean, cov


def _predicted(
    x: FloatArray, P: FloatArray, step: Step, turns: Turns | None
) -> tuple[FloatArray, FloatArray]:
    if turns is None:
        return step.F @ x, step.F @ P @ step.F.T + step.Q
    if step.dt_s <= 0.0:
        return x, P
    turn = np.array([[x[4], P[4, 4], *P[4, :4]]])
    mean, cov, turn = turning.predict(
        x[None, :4].copy(), P[None, :4, :4].copy(), turn, step.Q, step.dt_s, *turns
    )
    P = np.pad(cov[0], (0, 1))
    P[4, :4] = P[:4, 4] = turn[0, 2:]
    P[4, 4] = turn[0, 1]
    return np.append(mean[0], turn[0, 0]), P


def _updated(x: FloatArray, P: FloatArray, sensor: Sensor, z_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    seen = view(sensor, x[None, :4].copy(), P[None, :4, :4].copy())  # a birth's are read-only: another type
    H, R = np.pad(seen.A[0], ((0, 0), (0, x.size - 2))), seen.noise[0]
    innovation = measured(sensor, z_m[None])[0] - seen.z_hat[0]
    if seen.wraps:
        innovation[1] = wrapped.py_func(innovation[1])
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    A = np.eye(x.size) - K @ H
    return x + K @ innovation, A @ P @ A.T + K @ R @ K.T
