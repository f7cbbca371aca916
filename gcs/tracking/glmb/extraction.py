"""Compiled: the state in which a label is shown, averaged over the histories that mean the same place.

A label's density is a mixture over association histories. Its mean is the best guess where the histories
differ in a detection or two (which of them is clutter), and a place where nobody is where they differ in
which object they follow. So a label is shown as an average: of the history that the best joint hypothesis has
of it, and those that may well be the same state, which differ from it by less than 99 % of differences would
by the covariances of both. That has the least expected square error; its covariance is the mixture's.

Which labels are shown, and in which order: those that are probable enough or in the estimate, as born.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf
from gcs.tracking.glmb.hypotheses import Clusters
from gcs.tracking.glmb.marginals import Marginals, compute_marginals
from gcs.tracking.glmb.merging import cholesky4, within_gate
from gcs.tracking.numerics.sorting import SortBuffers, allocate_sort, argsort_descending

if TYPE_CHECKING:
    from gcs.model import FloatArray

SAME_STATE_CHI2: Final = 13.28
"""99 % of the chi-square distribution with four degrees of freedom."""
_NOT_REPORTED_KEY: Final = -(2**63)
"""What is not shown is sorted by this."""
_MIN_SHARE: Final = 1e-3
"""Histories less probable than this, against the one that is shown, are passed over: they move nothing."""


class Estimates(NamedTuple):
    """A picture as arrays, a row for each of its labels, in their order."""

    label: Any
    """(n, 2) scan of birth and index there, int64."""
    mean: Any
    """(n, 4)."""
    cov: Any
    """(n, 4, 4)."""
    existence: Any
    """(n,)."""
    estimated: Any
    """(n,) whether it is in the MAP-cardinality estimate."""
    cardinality: Any
    """(k,) probability of each number of objects."""


@leaf
def _average_states(
    probability: FloatArray,
    track_label: Any,
    extract_estimates: Any,
    mean: FloatArray,
    cov: FloatArray,
    centre: FloatArray,
    total_cov: FloatArray,
    cholesky: FloatArray,
    shift: FloatArray,
    out_mean: FloatArray,
    out_cov: FloatArray,
) -> None:
    for row in range(extract_estimates.size):
        t = extract_estimates[row]
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
            if u == t or probability[u] < _MIN_SHARE * probability[t]:
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
    probability: FloatArray, track_label: Any, extract_estimates: Any, mean: FloatArray, cov: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Means (n, 4) and covariances (n, 4, 4) of labels by the tracks `shown` (n,) that stand for them.

    `probability` of each track (see `summing.probabilities`); a label's tracks stand together.
    """
    out_mean, out_cov = np.empty((extract_estimates.size, 4)), np.empty((extract_estimates.size, 4, 4))
    centre, total_cov, cholesky = np.empty((1, 4)), np.empty((1, 4, 4)), np.empty((1, 4, 4))
    _average_states(
        probability,
        track_label,
        extract_estimates,
        mean,
        cov,
        centre,
        total_cov,
        cholesky,
        np.empty(4),
        out_mean,
        out_cov,
    )
    return out_mean, out_cov


@leaf
def _select_labels(
    marginals: Marginals,
    track_label: Any,
    labels: Any,
    min_existence: float,
    estimated: Any,
    key: Any,
    order: SortBuffers,
) -> int:
    """Put the labels to be shown in order, and fill which are estimated; return how many are shown."""
    for i in range(marginals.estimated.size):
        track = marginals.estimated[i]
        marginals.representative[track_label[track]], estimated[track_label[track]] = track, True
    count = ZERO
    for label in range(estimated.size):
        # Those that are not shown stand behind all others.
        key[label] = _NOT_REPORTED_KEY
        if estimated[label] or marginals.existence[label] >= min_existence:
            key[label] = -(labels[label, 0] << 32) - labels[label, 1]
            count += 1
    argsort_descending(key, ZERO, key.size, order)
    return count


@leaf
def _fill_estimates(
    marginals: Marginals, labels: Any, estimated: Any, order: SortBuffers, track: Any, out: Any
) -> None:
    label_out, existence_out, estimated_out = out
    for i in range(track.size):
        label = order.index[i]
        track[i] = marginals.representative[label]
        label_out[i, 0], label_out[i, 1] = labels[label, 0], labels[label, 1]
        existence_out[i], estimated_out[i] = marginals.existence[label], estimated[label]


@kernel
def extract_estimates(
    clusters: Clusters, track_label: Any, labels: Any, mean: FloatArray, cov: FloatArray, min_existence: float
) -> Estimates:
    """Labels in the estimate, and those with an existence of at least `least`."""
    marginals = compute_marginals(clusters, track_label, labels.shape[0])
    n_labels = labels.shape[0]
    estimated, order = np.zeros(n_labels, np.bool_), allocate_sort(n_labels)
    n = _select_labels(
        marginals, track_label, labels, min_existence, estimated, np.empty(n_labels, np.int64), order
    )
    track, out = np.empty(n, np.int64), (np.empty((n, 2), np.int64), np.empty(n), np.empty(n, np.bool_))
    _fill_estimates(marginals, labels, estimated, order, track, out)
    means, covs = average_states(marginals.probability, track_label, track, mean, cov)
    return Estimates(out[0], means, covs, out[1], out[2], marginals.cardinality)


def warm_up_calls() -> list[tuple[Any, ...]]:
    """One call of every kernel, types as in a tracker."""
    zeros, ids, clusters = np.zeros(1, np.int64), np.zeros((1, 2), np.int64), Clusters.example()
    return [(extract_estimates, clusters, zeros, ids, np.zeros((1, 4)), np.eye(4).reshape(1, 4, 4), 1e-3)]
