"""How an object moves between scans: constant velocity disturbed by white-noise acceleration.

Continuous model (Bar-Shalom, Li & Kirubarajan 2001, section 6.2.2), per axis with white acceleration w(t) of
spectral density q:

    d/dt [p, v] = [v, w],    F(dt) = [[1, dt], [0, 1]],    Q(dt) = q [[dt^3/3, dt^2/2], [dt^2/2, dt]]

It is the continuous form and not the piecewise-constant one because scans of several sensors come at
irregular times: here F and Q over a + b are exactly those over a followed by b, so the picture does not
depend on how often somebody looked. The parameter is the standard deviation that the velocity gains in one
second, ``accel_std_m_s2``, so q = accel_std_m_s2^2 x 1 s (m^2/s^3).

Much of the literature simulates the piecewise-constant form instead (ibid., section 6.3.2), one draw of the
acceleration for each scan: ``Q = accel_std_m_s2^2 [[dt^4/4, dt^3/2], [dt^3/2, dt^2]]``. It is here for data
that was made so, at regular scans; at dt = 1 s both add the same to the velocity.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from gcs.model import FloatArray

Acceleration: TypeAlias = Literal["white", "piecewise"]
"""White noise in continuous time, or one constant draw from scan to scan."""


def transition(dt_s: float) -> FloatArray:
    """F(dt), (4, 4), for the state [east, north, v_east, v_north]."""
    matrix = np.eye(4)
    matrix[0, 2] = matrix[1, 3] = dt_s
    return matrix


def process_noise(dt_s: float, accel_std_m_s2: float, acceleration: Acceleration = "white") -> FloatArray:
    """Q(dt), (4, 4), zero for dt = 0; positive definite for dt > 0, semidefinite when "piecewise"."""
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
