"""State of a GLMB filter: its posterior after the last scan, as plain data.

Compiled kernels index the arrays of a posterior without bounds checks. So a state is checked completely
before use: it may come from a damaged or foreign file.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gcs.model import IntArray
from gcs.tracking.glmb.recursion import Posterior

_MAX_SCANS: Final = 2**62
_MAX_WEIGHT_ERROR: Final = 1e-6


@dataclass(slots=True)
class GlmbState:
    """Everything that a filter carries from one scan to the next."""

    t_ns: int | None = None
    """Measurement time of the last scan; None before the first."""
    scans: int = 0
    """Number of processed scans."""
    late_scans: int = 0
    """Number of scans refused as older than the last one."""
    bad_detections: int = 0
    """Number of detections refused as not finite."""
    rng: int = 0
    """State of the Gibbs sampler's random generator, 64 bits."""
    posterior: Posterior = field(default_factory=Posterior.empty)

    def without_tracks(self) -> GlmbState:
        """Return a state from which tracks begin again, with new labels."""
        return replace(self, posterior=Posterior.empty())


def check_state(state: GlmbState, *, has_turns: bool) -> None:
    """Check a state of unknown origin.

    Raises
    ------
    ValueError
        If it is no valid state of a filter with or without turns.
    """
    posterior = state.posterior
    labels = posterior.labels
    track_label = posterior.track_label
    n_labels = labels.size // 2
    n_tracks = track_label.size
    _check(0 <= state.scans < _MAX_SCANS and 0 <= state.rng < 2**64, "scans")
    _check_array(labels, np.int64, (n_labels, 2), "labels")
    _check(bool((labels >= 0).all() and (labels[:, 0] < state.scans).all()), "labels")
    _check(len(set(map(tuple, labels.tolist()))) == n_labels, "labels")
    _check_array(track_label, np.int64, (n_tracks,), "track_label")
    _check(_within(track_label, n_labels), "track_label")
    runs = len(list(itertools.groupby(track_label.tolist())))
    _check(runs == len(set(track_label.tolist())), "track_label")
    cov = posterior.cov
    _check_array(posterior.mean, np.float64, (n_tracks, 4), "mean")
    _check_array(cov, np.float64, (n_tracks, 4, 4), "cov")
    _check(bool(np.allclose(cov, cov.transpose(0, 2, 1))), "cov")
    _check(n_tracks == 0 or float(np.linalg.eigvalsh(cov).min()) > 0.0, "cov")
    _check_array(posterior.turn, np.float64, (n_tracks if has_turns else 0, 6), "turn")
    n_certain = n_labels if posterior.is_certain.size else 0
    _check_array(posterior.is_certain, np.bool_, (n_certain,), "is_certain")
    _check_clusters(posterior)


def _check_clusters(posterior: Posterior) -> None:
    first, start, items, logw = posterior.clusters
    for name, values in (("first", first), ("start", start), ("items", items)):
        _check_array(values, np.int64, (values.size,), name)
    n_hyps = start.size - 1
    _check(n_hyps >= 0 and first.size >= 1, "start")
    _check(first[0] == 0 and first[-1] == n_hyps and bool((np.diff(first) > 0).all()), "first")
    _check(start[0] == 0 and start[-1] == len(items) and bool((np.diff(start) >= 0).all()), "start")
    _check(_within(items, posterior.track_label.size), "items")
    _check_array(logw, np.float64, (n_hyps,), "logw")
    _check(bool((logw <= _MAX_WEIGHT_ERROR).all()), "logw")
    owner: dict[int, int] = {}
    for cluster, (begin, end) in enumerate(itertools.pairwise(first.tolist())):
        _check(abs(float(np.exp(logw[begin:end]).sum()) - 1.0) < _MAX_WEIGHT_ERROR, "logw")
        for hypothesis in range(begin, end):
            labels = posterior.track_label[items[start[hypothesis] : start[hypothesis + 1]]].tolist()
            _check(len(set(labels)) == len(labels), "items")
            _check(all(owner.setdefault(label, cluster) == cluster for label in labels), "items")


def _check_array(values: npt.NDArray[Any], dtype: npt.DTypeLike, shape: tuple[int, ...], name: str) -> None:
    """Check that an array is one that kernels were compiled for, and that its numbers are finite."""
    _check(values.shape == shape and values.dtype == dtype and values.flags.c_contiguous, name)
    _check(bool(np.isfinite(values).all()), name)


def _within(values: IntArray, end: int) -> bool:
    return bool(((values >= 0) & (values < end)).all())


def _check(is_valid: bool, name: str) -> None:
    if not is_valid:
        raise ValueError(f"tracker state: {name} is not valid")
