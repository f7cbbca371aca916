"""How an object moves between scans: constant velocity disturbed by white-noise acceleration.

Continuous model (Bar-Shalom, Li & Kirubarajan 2001, section 6.2.2), per axis with white acceleration w(t) of
spectral density q:

    d/dt [p, v] = [v, w],    F(dt) = [[1, dt], [0, 1]],    Q(dt) = q [[dt^3/3, dt^2/2], [dt^2/2, dt]]

It is the continuous form and not the piecewise-constant one because scans of several sensors come at
irregular times: here F and Q over a + b are exactly those over a followed by b, so the picture does not
depend on how often somebody looked. The parameter is the standard deviation that the velocity gains in one
second, ``accel_std_m_s2``, so q = accel_std_m_s2^2 x 1 s (m^2/s^3).
"""

from __future__ import annotations

import numpy as np

from gcs.model import FloatArray


def transition(dt_s: float) -> FloatArray:
    """F(dt), (4, 4), for the state [east, north, v_east, v_north]."""
    matrix = np.eye(4)
    matrix[0, 2] = matrix[1, 3] = dt_s
    return matrix


def process_noise(dt_s: float, accel_std_m_s2: float) -> FloatArray:
    """Q(dt), (4, 4), positive definite for dt > 0 and zero for dt = 0."""
    density = accel_std_m_s2 * accel_std_m_s2
    matrix = np.zeros((4, 4))
    matrix[0, 0] = matrix[1, 1] = density * dt_s**3 / 3.0
    matrix[0, 2] = matrix[2, 0] = matrix[1, 3] = matrix[3, 1] = density * dt_s**2 / 2.0
    matrix[2, 2] = matrix[3, 3] = density * dt_s
    return matrix
