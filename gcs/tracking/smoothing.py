"""One object's Kalman filter over a known association history, and smoothers over its result.

Filter: x_k|k-1 = F x, P_k|k-1 = F P F' + Q, then for a detection the gain K = P H' (H P H' + R)^-1 and the
Joseph form. Smoother (Rauch, Tung & Striebel 1965), with the gain G_k = P_k|k F' P_k+1|k^-1:

    x_k|n = x_k|k + G_k (x_k+1|n - x_k+1|k),    P_k|n = P_k|k + G_k (P_k+1|n - P_k+1|k) G_k'

With a fixed lag L the state k is that of n = min(k + L, last): what one knows L scans later.
State order [east, north, v_east, v_north]. H and R are those of `sensors.view`, which is linear around each
track.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gcs.model import FloatArray, Sensor
from gcs.tracking.sensors import measured, view, wrapped


class Step(NamedTuple):
    """One scan of an object's history."""

    F: FloatArray
    """(4, 4) transition from the scan before."""
    Q: FloatArray
    """(4, 4) process noise since the scan before."""
    sensor: Sensor
    """What made the detection."""
    z_m: FloatArray | None
    """(2,) the detection, east/north; None for a miss."""


class Run(NamedTuple):
    """A filter's result over n scans."""

    mean: FloatArray
    """(n, 4)."""
    cov: FloatArray
    """(n, 4, 4)."""
    predicted_mean: FloatArray
    """(n, 4) before each scan's detection."""
    predicted_cov: FloatArray
    """(n, 4, 4)."""


def filtered(mean: FloatArray, cov: FloatArray, steps: Sequence[Step]) -> Run:
    """Filter from the prior (4,), (4, 4) at the time of the first scan; its F and Q do not apply."""
    n = len(steps)
    run = Run(np.empty((n, 4)), np.empty((n, 4, 4)), np.empty((n, 4)), np.empty((n, 4, 4)))
    x, P = mean, cov
    for k, step in enumerate(steps):
        if k:
            x, P = step.F @ x, step.F @ P @ step.F.T + step.Q
        run.predicted_mean[k], run.predicted_cov[k] = x, P
        if step.z_m is not None:
            seen = view(step.sensor, x[None], P[None])
            H, R = np.hstack([seen.A[0], np.zeros((2, 2))]), seen.noise[0]
            innovation = measured(step.sensor, step.z_m[None])[0] - seen.z_hat[0]
            if seen.wraps:
                innovation[1] = wrapped(innovation[1])
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            x = x + K @ innovation
            A = np.eye(4) - K @ H
            P = A @ P @ A.T + K @ R @ K.T
        P = 0.5 * (P + P.T)
        run.mean[k], run.cov[k] = x, P
    return run


def smoothed(run: Run, steps: Sequence[Step], lag_scans: int | None = None) -> tuple[FloatArray, FloatArray]:
    """Means (n, 4) and covariances (n, 4, 4) given all scans, or those up to `lag_scans` later."""
    n = len(steps)
    mean, cov = run.mean.copy(), run.cov.copy()
    if n < 2:
        return mean, cov
    F = np.array([step.F for step in steps[1:]])
    G = np.swapaxes(np.linalg.solve(run.predicted_cov[1:], F @ run.cov[:-1]), 1, 2)
    if lag_scans is None or lag_scans >= n - 1:
        for k in range(n - 2, -1, -1):
            mean[k] += G[k] @ (mean[k + 1] - run.predicted_mean[k + 1])
            cov[k] += G[k] @ (cov[k + 1] - run.predicted_cov[k + 1]) @ G[k].T
        return mean, cov
    for _ in range(lag_scans):
        mean[:-1] = run.mean[:-1] + np.einsum("kij,kj->ki", G, mean[1:] - run.predicted_mean[1:])
        cov[:-1] = run.cov[:-1] + G @ (cov[1:] - run.predicted_cov[1:]) @ np.swapaxes(G, 1, 2)
    return mean, cov
