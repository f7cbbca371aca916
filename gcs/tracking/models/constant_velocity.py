"""Nearly constant velocity: the motion model between scans.

F(dt) = [[1, dt], [0, 1]] for each axis [p, v]. Two models of the process noise; both may be used, and add:

Continuous white-noise acceleration of spectral density q, in m^2/s^3 (Bar-Shalom, Li & Kirubarajan 2001,
section 6.2.2; `noise_diff_coeff` of Stone Soup's `ConstantVelocity`):

    Q(dt) = q [[dt^3/3, dt^2/2], [dt^2/2, dt]]

F and Q over a + b equal those over a followed by b, so the estimate does not depend on the scan times of
other sensors.

Piecewise-constant acceleration: one draw from scan to scan, of standard deviation sigma, in m/s^2 (ibid.,
section 6.3.2; `sigma_v` in the code of Vo and Vo):

    Q(dt) = sigma^2 [[dt^4/4, dt^3/2], [dt^3/2, dt^2]]

It is for data that was simulated so, at regular scans. At dt = 1 s both add the same variance to the velocity
for q = sigma^2 x 1 s.
"""

from __future__ import annotations

import numpy as np

from gcs.model import FloatArray


def transition(dt_s: float) -> FloatArray:
    """Return F(dt), (4, 4), for the state [east, north, v_east, v_north]."""
    matrix = np.eye(4)
    matrix[0, 2] = matrix[1, 3] = dt_s
    return matrix


def process_noise(dt_s: float, accel_psd_m2_s3: float) -> FloatArray:
    """Return Q(dt), (4, 4), of white-noise acceleration: 0 for dt = 0, else positive definite."""
    return accel_psd_m2_s3 * _both_axes(dt_s**3 / 3.0, dt_s**2 / 2.0, dt_s)


def piecewise_process_noise(dt_s: float, accel_std_m_s2: float) -> FloatArray:
    """Return Q(dt), (4, 4), of piecewise-constant acceleration: positive semidefinite."""
    return accel_std_m_s2 * accel_std_m_s2 * _both_axes(dt_s**4 / 4.0, dt_s**3 / 2.0, dt_s**2)


def _both_axes(position: float, cross: float, velocity: float) -> FloatArray:
    matrix = np.zeros((4, 4))
    matrix[0, 0] = matrix[1, 1] = position
    matrix[0, 2] = matrix[2, 0] = matrix[1, 3] = matrix[3, 1] = cross
    matrix[2, 2] = matrix[3, 3] = velocity
    return matrix
