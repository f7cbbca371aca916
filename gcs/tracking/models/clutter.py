"""Clutter intensity from known objects: detections of objects that another tracker tracks.

An object with existence r and Gaussian position N(p; m, P) is detected with probability p_D and noise R.
Detections of all objects have the intensity (Mahler 2007, section 4.3: first moment of a multi-Bernoulli set)

    lambda(z) = p_D sum_i r_i N(z; m_i, P_i + R(z))
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.jit import Call, kernel

if TYPE_CHECKING:
    from gcs.model import FloatArray

_MAX_CHI2 = 1500.0
"""Squared Mahalanobis distance from which exp(-d2 / 2) is 0 in float64."""


@kernel
def intensity_per_m2(
    mean: FloatArray, cov: FloatArray, existence: FloatArray, z: FloatArray, noise: FloatArray
) -> FloatArray:
    """Return the intensity (m,) at positions z (m, 2) with `noise` (m, 2, 2), for p_D = 1.

    Means are (n, 2), covariances (n, 2, 2), existence probabilities (n,).
    """
    density = np.zeros(z.shape[0])
    for j in range(z.shape[0]):
        total = 0.0
        for i in range(mean.shape[0]):
            x = z[j, 0] - mean[i, 0]
            y = z[j, 1] - mean[i, 1]
            s00 = cov[i, 0, 0] + noise[j, 0, 0]
            s11 = cov[i, 1, 1] + noise[j, 1, 1]
            if x * x > _MAX_CHI2 * s00 or y * y > _MAX_CHI2 * s11:
                continue
            s01 = cov[i, 0, 1] + noise[j, 0, 1]
            det = s00 * s11 - s01 * s01
            d2 = (s11 * x * x - 2.0 * s01 * x * y + s00 * y * y) / det
            total += existence[i] * math.exp(-0.5 * d2) / math.sqrt(det)
        density[j] = total / (2.0 * math.pi)
    return density


def warm_up_calls() -> list[Call]:
    """Return one call of every kernel, with the types of a tracker."""
    cov = np.eye(2).reshape(1, 2, 2)
    return [(intensity_per_m2, np.zeros((1, 2)), cov, np.ones(1), np.zeros((1, 2)), cov)]
