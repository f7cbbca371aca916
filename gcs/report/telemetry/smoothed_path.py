"""Smoothed path of a vehicle from reported positions, and jumps of its GPS.

filterpy's Kalman filter follows the reports with nearly constant velocity. A report is a jump if its
normalised innovation squared (NIS, chi-square with 2 degrees of freedom) exceeds a false-alarm probability of
1e-6. With two reports a second that is from about 15 m on. The path starts again at a jump, so a glitch is
two jumps, out and back. An RTS pass smooths each piece.

Times are the vehicle's boot clock: reports that wait on a link arrive together. A boot clock that does not
advance starts a piece without a test.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from gcs.model import FloatArray, read_only
from gcs.tracking.models import constant_velocity

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

_POSITION_STD_M: Final = 2.0
"""GLOBAL_POSITION_INT is a filtered position; GPS errors of a second are mostly common to it."""
_ACCEL_PSD_M2_S3: Final = 25.0
"""Of `constant_velocity`; aeroplanes turn with up to 10 m/s2."""
_SPEED_STD_M_S: Final = 30.0
_MAX_NIS: Final = -2.0 * math.log(1e-6)


class Jump(NamedTuple):
    """A position that the motion up to it does not explain."""

    report: int
    """Number of the report."""
    size_m: float
    """Distance from the predicted position."""


class SmoothedPath(NamedTuple):
    """A path by an RTS smoother, in pieces between jumps."""

    points_m: FloatArray
    """(n, 2) east, north."""
    length_m: float
    """Without jumps."""
    jumps: tuple[Jump, ...]


def smooth_path(boot_s: FloatArray, points_m: FloatArray) -> SmoothedPath:
    """Smooth reported positions (n, 2) at boot times (n,), and find their jumps."""
    points = np.array(points_m)
    length_m = 0.0
    jumps = []
    velocity = np.zeros(2)
    velocity_cov = np.eye(2) * _SPEED_STD_M_S**2
    first = 0
    while first < len(points):
        kalman = _filter(points_m[first], velocity, velocity_cov)
        steps = [(kalman.x, kalman.P, kalman.F, kalman.Q)]
        velocity = np.zeros(2)
        velocity_cov = np.eye(2) * _SPEED_STD_M_S**2
        end = first + 1
        while end < len(points) and boot_s[end] > boot_s[end - 1]:
            dt_s = boot_s[end] - boot_s[end - 1]
            F = constant_velocity.transition(dt_s)
            Q = constant_velocity.process_noise(dt_s, _ACCEL_PSD_M2_S3)
            kalman.predict(F=F, Q=Q)
            innovation = points_m[end] - kalman.x[:2]
            nis = innovation @ np.linalg.solve(kalman.P[:2, :2] + kalman.R, innovation)
            if nis > _MAX_NIS:
                jumps.append(Jump(end, float(np.hypot(*innovation))))
                velocity = kalman.x[2:]
                velocity_cov = kalman.P[2:, 2:]
                break
            kalman.update(points_m[end])
            steps.append((kalman.x, kalman.P, F, Q))
            end += 1
        means, covs, Fs, Qs = zip(*steps, strict=True)
        points[first:end] = kalman.rts_smoother(np.array(means), np.array(covs), Fs, Qs)[0][:, :2]
        length_m += float(np.hypot(*np.diff(points[first:end], axis=0).T).sum())
        first = end
    return SmoothedPath(read_only(points), length_m, tuple(jumps))


def _filter(point_m: FloatArray, velocity_m_s: FloatArray, velocity_cov: FloatArray) -> KalmanFilter:
    """Return a filter at the first report of a piece."""
    from filterpy.kalman import KalmanFilter  # with all of scipy.stats: not at the start of a flight

    kalman = KalmanFilter(4, 2)
    kalman.H = np.eye(2, 4)
    kalman.R = np.eye(2) * _POSITION_STD_M**2
    kalman.x = np.array([*point_m, *velocity_m_s])
    kalman.P[:2, :2] = kalman.R
    kalman.P[2:, 2:] = velocity_cov
    return kalman
