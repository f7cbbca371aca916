"""Gate of detections around a position: which are near, is it in view, what tells that of an object there.

With detection probability p_D, expected clutter and other objects within the gate,

    P(hit | absent)  = 1 - exp(-clutter - p_D others)
    P(hit | present) = 1 - (1 - p_D) (1 - P(hit | absent))
"""

from __future__ import annotations

import math
from itertools import chain
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gcs.model import BoolArray, FloatArray, Sensor
from gcs.tracking.models.sensor_geometry import MAX_DETECTION_PROBABILITY, clutter_per_m2, covers

Indices: TypeAlias = npt.NDArray[np.int64]

GATE_CHI2 = 25.0
_TINY = 1e-12


def near(positions: FloatArray, S: FloatArray, points: FloatArray) -> tuple[Indices, Indices]:
    """Return the pairs of positions (n, 2) and points (m, 2) within a gate, as (k,) indices of each.

    `S` (n, 2, 2) is the covariance of a point around each position.
    """
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    if not len(positions) or not len(finite):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    reach_m = np.sqrt(GATE_CHI2 * np.linalg.eigvalsh(S)[:, -1]) * (1.0 + 1e-9)
    found = cKDTree(points[finite]).query_ball_point(positions, reach_m, return_sorted=True)
    rows = np.repeat(np.arange(len(positions)), [len(row) for row in found])
    columns = finite[np.fromiter(chain.from_iterable(found), np.int64, len(rows))]
    x, y = (points[columns] - positions[rows]).T
    s00 = S[rows, 0, 0]
    s01 = S[rows, 0, 1]
    s11 = S[rows, 1, 1]
    d2 = (s11 * x * x - 2.0 * s01 * x * y + s00 * y * y) / (s00 * s11 - s01 * s01)
    return rows[d2 <= GATE_CHI2], columns[d2 <= GATE_CHI2]


def are_hit(positions: FloatArray, S: FloatArray, z_m: FloatArray) -> list[bool]:
    """Return True for each position (n, 2) with a detection in its gate."""
    counts = np.bincount(near(positions, S, z_m)[0], minlength=len(positions))
    is_hit: list[bool] = counts.astype(np.bool_).tolist()
    return is_hit


def clutter_in_gates(sensor: Sensor, positions: FloatArray, S: FloatArray) -> list[float]:
    """Return the mean number of false detections in the gate of each position (n, 2)."""
    area_m2 = math.pi * GATE_CHI2 * np.sqrt(np.linalg.det(S))
    clutter: list[float] = (clutter_per_m2(sensor, positions) * area_m2).tolist()
    return clutter


def covers_gates(sensor: Sensor, positions: FloatArray, S: FloatArray) -> BoolArray:
    """Return a mask of the positions that a sensor covers, with three standard deviations around them."""
    margin_m = 3.0 * np.sqrt(np.linalg.eigvalsh(S)[:, -1]) if len(positions) else np.zeros(0)
    is_covered = np.ones(len(positions), np.bool_)
    for east, north in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        is_covered &= covers(sensor, positions + margin_m[:, None] * np.array([east, north]))
    return np.asarray(is_covered)


def absence_log_ratio(sensor: Sensor, clutter: float, others: int, *, is_hit: bool) -> float:
    """Return the log-likelihood ratio of absence and presence of an object, by one scan."""
    p_d = min(float(sensor.detection_probability), MAX_DETECTION_PROBABILITY)
    if not is_hit:
        return -math.log1p(-p_d)
    p_absent = -math.expm1(-clutter - p_d * others)
    p_present = 1.0 - (1.0 - p_d) * (1.0 - p_absent)
    return math.log(max(p_absent, _TINY) / max(p_present, _TINY))
