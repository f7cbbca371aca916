"""Nearly constant velocity: the motion model between scans.

Continuous white-noise acceleration (Bar-Shalom, Li & Kirubarajan 2001, section 6.2.2), per axis with spectral
density q:

    d/dt [p, v] = [v, w],    F(dt) = [[1, dt], [0, 1]],    Q(dt) = q [[dt^3/3, dt^2/2], [dt^2/2, dt]]

F and Q over a + b equal those over a followed by b, so the estimate does not depend on the scan times of
other sensors. ``accel_std_m_s2`` is the standard deviation of the velocity gained in one second: q =
accel_std_m_s2^2 x 1 s, in m^2/s^3.

The piecewise-constant model (ibid., section 6.3.2) has one acceleration from scan to scan:
``Q = accel_std_m_s2^2 [[dt^4/4, dt^3/2], [dt^3/2, dt^2]]``. It is for data that was simulated so, at regular
scans. At dt = 1 s both add the same variance to the velocity.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from gcs.model import FloatArray

Acceleration: TypeAlias = Literal["white", "piecewise"]
"""Continuous white noise, or piecewise constant between scans."""


def transition(dt_s: float) -> FloatArray:
    """Return F(dt), (4, 4), for the state [east, north, v_east, v_north]."""
    matrix = np.eye(4)
    matrix[0, 2] = matrix[1, 3] = dt_s
    return matrix


def process_noise(dt_s: float, accel_std_m_s2: float, acceleration: Acceleration = "white") -> FloatArray:
    """Return Q(dt), (4, 4): 0 for dt = 0; for dt > 0 positive definite, or semidefinite if "piecewise"."""
    density = accel_std_m_s2 * accel_std_m_s2
    if acceleration == "white":
        position, cross, velocity = dt_s**3 / 3.0, dt_s**2 / 2.0, dt_s
    else:
        position, cross, velocity = dt_s**4 / 4.0, dt_s**3 / 2.0, dt_s**2
    matrix = np.zeros((4, 4))
    matrix[0, 0] = matrix[1, 1] = density * position
    matrix[0, 2] = matrix[2, 0] = matrix[1, 3] = matrix[3, 1] = density * cross
    matrix[2, 2] = matrix[3, 3] = density * velocity
    return matrix
