"""Compiled: the state in which a label is shown, averaged over the histories that mean the same place.

A label's density is a mixture over association histories. Its mean is the best guess where the histories
differ in a detection or two (which of them is clutter), and a place where nobody is where they differ in
which object they follow. So a label is shown as an average: of the history that the best joint hypothesis has
of it, and those that may well be the same state, which differ from it by less than 99 % of differences would
by the covariances of both. That has the least expected square error; its covariance is the mixture's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from gcs.compiling import kernel, leaf
from gcs.tracking.merging import factor, near

if TYPE_CHECKING:
    from gcs.model import FloatArray

SAME_CHI2: Final = 13.28
"""99 % of the chi-square distribution with four degrees of freedom."""
_LEAST_SHARE: Final = 1e-3
"""Histories less probable than this, against the one that is shown, are passed over: they move nothing."""


@leaf
def _averaged(
    probability: FloatArray,
    track_label: Any,
    shown: Any,
    mean: FloatArray,
    cov: FloatArray,
    centre: FloatArray,
    total_cov: FloatArray,
    lower: FloatArray,
    shift: FloatArray,
    out_mean: FloatArray,
    out_cov: FloatArray,
) -> None:
    for row in range(shown.size):
        t = shown[row]
        for i in range(4):
            centre[0, i], shift[i] = mean[t, i], 0.0
            for j in range(4):
                out_cov[row, i, j] = cov[t, i, j]
        first, end = t, t + 1
        while first > 0 and track_label[first - 1] == track_label[t]:
            first -= 1
        while end < track_label.size and track_label[end] == track_label[t]:
            end += 1
        weight = 1.0
        for u in range(first, end):
            share = probability[u] / probability[t]
            if u == t or share < _LEAST_SHARE:
                continue
            if (mean[u, 0] - centre[0, 0]) ** 2 > SAME_CHI2 * (cov[t, 0, 0] + cov[u, 0, 0]):
                continue
            for i in range(4):
                for j in range(4):
                    total_cov[0, i, j] = cov[t, i, j] + cov[u, i, j]
            factor(total_cov, 0, lower, 0)
            if not near(mean, u, centre, 0, lower, 0, SAME_CHI2):
                continue
            weight += share
            for i in range(4):
                shift[i] += share * (mean[u, i] - centre[0, i])
                for j in range(4):
                    spread = (mean[u, i] - centre[0, i]) * (mean[u, j] - centre[0, j])
                    out_cov[row, i, j] += share * (cov[u, i, j] + spread)
        for i in range(4):
            out_mean[row, i] = centre[0, i] + shift[i] / weight
            for j in range(4):
                out_cov[row, i, j] = out_cov[row, i, j] / weight - shift[i] * shift[j] / weight**2


@kernel
def averaged(
    probability: FloatArray, track_label: Any, shown: Any, mean: FloatArray, cov: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Means (n, 4) and covariances (n, 4, 4) of labels by the tracks `shown` (n,) that stand for them.

    `probability` of each track (see `summing.probabilities`); a label's tracks stand together.
    """
    out_mean, out_cov = np.empty((shown.size, 4)), np.empty((shown.size, 4, 4))
    centre, total_cov, lower = np.empty((1, 4)), np.empty((1, 4, 4)), np.empty((1, 4, 4))
    _averaged(
        probability, track_label, shown, mean, cov, centre, total_cov, lower, np.empty(4), out_mean, out_cov
    )
    return out_mean, out_cov


def warm_up_calls() -> list[tuple[Any, ...]]:
    """One call of every kernel, types as in a tracker."""
    zeros = np.zeros(1, np.int64)
    return [(averaged, np.ones(1), zeros, zeros, np.zeros((1, 4)), np.eye(4).reshape(1, 4, 4))]
