"""Mahalanobis distances between reported positions, tracks and detections."""

from __future__ import annotations

import numpy as np

from gcs.model import FloatArray


def squared_distances(points: FloatArray, means: FloatArray, S: FloatArray) -> FloatArray:
    """Return squared Mahalanobis distances (m, n) of points (m, 2) from means (n, 2) under S (n, 2, 2)."""
    return paired_squared_distances(points[:, None], means, S)


def paired_squared_distances(points: FloatArray, means: FloatArray, S: FloatArray) -> FloatArray:
    """Return the squared distance (n,) of each point (n, 2) from its own mean (n, 2) under S (n, 2, 2)."""
    x = points[..., 0] - means[:, 0]
    y = points[..., 1] - means[:, 1]
    s00 = S[:, 0, 0]
    s01 = S[:, 0, 1]
    s11 = S[:, 1, 1]
    with np.errstate(invalid="ignore", over="ignore"):  # NaN positions are near nothing
        return np.asarray((s11 * x * x - 2.0 * s01 * x * y + s00 * y * y) / (s00 * s11 - s01 * s01))
