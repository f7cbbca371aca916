"""State extraction: the estimate of each label, averaged over the tracks that agree on its state.

The density of a label is a mixture over association histories. Its mean is the best estimate where histories
differ in a few detections. It is wrong where histories follow different objects: a mean between two objects
is at neither. So a label's estimate averages its representative track (`marginals`) and the tracks that may
have the same state: their difference is within the 99 % gate of both covariances. The covariance is that of
this mixture.

Reported labels are those in the estimate or with enough existence, in the order of birth.

============  ============  =======  =========================================================
Estimates     shape         dtype    meaning (n reported labels)
============  ============  =======  =========================================================
label         (n, 2)        int64    scan of birth, index of the birth in that scan
mean          (n, 4)        float64  east, north, v_east, v_north
cov           (n, 4, 4)     float64
existence     (n,)          float64  existence probability
estimated     (n,)          bool     True if the label is in the MAP-cardinality estimate
cardinality   (k,)          float64  probability of each number of objects
============  ============  =======  =========================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from gcs.jit import ZERO, Call, inlined, kernel, leaf
from gcs.tracking.glmb.hypotheses import Clusters
from gcs.tracking.glmb.marginals import Marginals, compute_marginals
from gcs.tracking.glmb.merging import cholesky4, within_gate
from gcs.tracking.numerics.sorting import SortBuffers, allocate_sort, argsort_descending

if TYPE_CHECKING:
    from gcs.model import BoolArray, FloatArray, IntArray

SAME_STATE_CHI2: Final = 13.28
"""99 % quantile of the chi-square distribution with four degrees of freedom."""
_NOT_REPORTED_KEY: Final = -(2**63)
"""Sort key of labels that are not reported."""
MIN_SHARE: Final = 1e-3
"""Tracks below this probability, relative to the representative one, do not change the average."""


class Estimates(NamedTuple):
    """Estimates of the reported labels as arrays (see the table above)."""

    label: IntArray
    mean: FloatArray
    cov: FloatArray
    existence: FloatArray
    estimated: BoolArray
    cardinality: FloatArray


class _Average(NamedTuple):
    """Scratch for one label.

    The state of its representative track; of another track the covariance of the difference, and its factor;
    and the sum of the differences.
    """

    centre: FloatArray
    total_cov: FloatArray
    cholesky: FloatArray
    shift: FloatArray


@leaf
def _average_states(
    probability: FloatArray,
    track_label: IntArray,
    representative: IntArray,
    mean: FloatArray,
    cov: FloatArray,
    average: _Average,
    out_mean: FloatArray,
    out_cov: FloatArray,
) -> None:
    centre, total_cov, cholesky, shift = average
    for row in range(representative.size):
        t = representative[row]
        for i in range(4):
            centre[0, i] = mean[t, i]
            shift[i] = 0.0
            for j in range(4):
                out_cov[row, i, j] = cov[t, i, j]
        first = t
        end = t + 1
        while first > 0 and track_label[first - 1] == track_label[t]:
            first -= 1
        while end < track_label.size and track_label[end] == track_label[t]:
            end += 1
        weight = 1.0
        for u in range(first, end):
            if u == t or probability[u] < MIN_SHARE * probability[t]:
                continue
            if (mean[u, 0] - centre[0, 0]) ** 2 > SAME_STATE_CHI2 * (cov[t, 0, 0] + cov[u, 0, 0]):
                continue
            for i in range(4):
                for j in range(4):
                    total_cov[0, i, j] = cov[t, i, j] + cov[u, i, j]
            cholesky4(total_cov, 0, cholesky, 0)
            if not within_gate(mean, u, centre, 0, cholesky, 0, SAME_STATE_CHI2):
                continue
            share = probability[u] / probability[t]
            weight += share
            for i in range(4):
                shift[i] += share * (mean[u, i] - centre[0, i])
                for j in range(4):
                    spread = (mean[u, i] - centre[0, i]) * (mean[u, j] - centre[0, j])
                    out_cov[row, i, j] += share * (cov[u, i, j] + spread)
        for i in range(4):
            out_mean[row, i] = centre[0, i] + shift[i] / weight
        if weight == 1.0:
            continue
        for i in range(4):
            for j in range(4):
                out_cov[row, i, j] = out_cov[row, i, j] / weight - shift[i] * shift[j] / weight**2


@inlined
def average_states(
    probability: FloatArray,
    track_label: IntArray,
    representative: IntArray,
    mean: FloatArray,
    cov: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return means (n, 4) and covariances (n, 4, 4) of labels with the tracks `representative` (n,).

    `probability` of each track is that of `marginals`; tracks of a label are adjacent.
    """
    out_mean = np.empty((representative.size, 4))
    out_cov = np.empty((representative.size, 4, 4))
    average = _Average(np.empty((1, 4)), np.empty((1, 4, 4)), np.empty((1, 4, 4)), np.empty(4))
    _average_states(probability, track_label, representative, mean, cov, average, out_mean, out_cov)
    return out_mean, out_cov


@leaf
def _select_labels(
    marginals: Marginals,
    track_label: IntArray,
    labels: IntArray,
    min_existence: float,
    estimated: BoolArray,
    key: IntArray,
    order: SortBuffers,
) -> int:
    """Sort the labels to report by birth, and fill which are estimated; return how many to report."""
    for i in range(marginals.estimated.size):
        track = marginals.estimated[i]
        marginals.representative[track_label[track]] = track
        estimated[track_label[track]] = True
    count = ZERO
    for label in range(estimated.size):
        # Labels that are not reported are sorted last.
        key[label] = _NOT_REPORTED_KEY
        if estimated[label] or marginals.existence[label] >= min_existence:
            key[label] = -(labels[label, 0] << 32) - labels[label, 1]
            count += 1
    argsort_descending(key, ZERO, key.size, order)
    return count


@leaf
def _fill_estimates(
    marginals: Marginals,
    labels: IntArray,
    estimated: BoolArray,
    order: SortBuffers,
    track: IntArray,
    out: tuple[IntArray, FloatArray, BoolArray],
) -> None:
    label_out, existence_out, estimated_out = out
    for i in range(track.size):
        label = order.index[i]
        track[i] = marginals.representative[label]
        label_out[i, 0] = labels[label, 0]
        label_out[i, 1] = labels[label, 1]
        existence_out[i] = marginals.existence[label]
        estimated_out[i] = estimated[label]


@kernel
def extract_estimates(
    clusters: Clusters,
    track_label: IntArray,
    labels: IntArray,
    mean: FloatArray,
    cov: FloatArray,
    min_existence: float,
) -> Estimates:
    """Return the estimates of labels in the MAP estimate or with an existence of at least `min_existence`."""
    marginals = compute_marginals(clusters, track_label, labels.shape[0])
    n_labels = labels.shape[0]
    estimated = np.zeros(n_labels, np.bool_)
    order = allocate_sort(n_labels)
    n = _select_labels(
        marginals, track_label, labels, min_existence, estimated, np.empty(n_labels, np.int64), order
    )
    track = np.empty(n, np.int64)
    out = (np.empty((n, 2), np.int64), np.empty(n), np.empty(n, np.bool_))
    _fill_estimates(marginals, labels, estimated, order, track, out)
    means, covs = average_states(marginals.probability, track_label, track, mean, cov)
    return Estimates(out[0], means, covs, out[1], out[2], marginals.cardinality)


def warm_up_calls() -> list[Call]:
    """Return one call of every kernel, with the types of a tracker."""
    zeros = np.zeros(1, np.int64)
    ids = np.zeros((1, 2), np.int64)
    clusters = Clusters.example()
    return [(extract_estimates, clusters, zeros, ids, np.zeros((1, 4)), np.eye(4).reshape(1, 4, 4), 1e-3)]
