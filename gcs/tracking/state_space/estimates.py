"""State extraction for states of any dimension (see `glmb.extraction`, whose result it returns)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.jit import kernel
from gcs.model import FloatArray, IntArray
from gcs.tracking.glmb.extraction import MIN_SHARE, Estimates
from gcs.tracking.glmb.marginals import Marginals, compute_marginals

if TYPE_CHECKING:
    from gcs.tracking.glmb.hypotheses import Clusters
    from gcs.tracking.glmb.recursion import Posterior

_SAME_STATE_QUANTILE = 0.99


@kernel
def label_marginals(clusters: Clusters, track_label: IntArray, n_labels: int) -> Marginals:
    """Return the marginals of the clusters."""
    return compute_marginals(clusters, track_label, n_labels)


def extract_estimates(posterior: Posterior, min_existence: float) -> Estimates:
    """Return the labels in the MAP estimate, or with an existence of at least `min_existence`."""
    from scipy.special import chdtri

    n_labels = posterior.labels.shape[0]
    marginals = label_marginals(posterior.clusters, posterior.track_label, n_labels)
    estimated = np.zeros(n_labels, np.bool_)
    label_of = posterior.track_label[marginals.estimated]
    estimated[label_of] = True
    track = marginals.representative
    track[label_of] = marginals.estimated
    reported = np.flatnonzero(estimated | (marginals.existence >= min_existence))
    reported = reported[np.lexsort(posterior.labels[reported].T[::-1])]
    d = posterior.mean.shape[1]
    max_distance2 = float(chdtri(d, 1.0 - _SAME_STATE_QUANTILE))
    states = [_average(posterior, marginals.probability, int(track[i]), max_distance2) for i in reported]
    return Estimates(
        posterior.labels[reported],
        np.reshape([mean for mean, _ in states], (-1, d)),
        np.reshape([cov for _, cov in states], (-1, d, d)),
        marginals.existence[reported],
        estimated[reported],
        marginals.cardinality,
    )


def _average(
    posterior: Posterior, probability: FloatArray, t: int, max_distance2: float
) -> tuple[FloatArray, FloatArray]:
    """Return the moments of track t and of the tracks of its label that may have the same state."""
    first, end = np.searchsorted(posterior.track_label, posterior.track_label[t] + np.arange(2))
    some = first + np.flatnonzero(probability[first:end] >= MIN_SHARE * probability[t])
    mean = posterior.mean[some]
    cov = posterior.cov[some]
    off = mean - posterior.mean[t]
    within = (off * np.linalg.solve(cov + posterior.cov[t], off[:, :, None])[:, :, 0]).sum(axis=1)
    same = (within < max_distance2) | (some == t)
    share = probability[some[same]] / probability[some[same]].sum()
    centre = share @ mean[same]
    off = mean[same] - centre
    spread = cov[same] + off[:, :, None] * off[:, None, :]
    return centre, np.tensordot(share, spread, 1)
