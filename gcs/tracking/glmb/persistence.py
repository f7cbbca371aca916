"""Posterior of a GLMB filter as a plain record, and back.

Compiled kernels index these arrays without bounds checks. So a record is checked completely before use: it
may come from a damaged or foreign recording.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gcs.model import FloatArray, PersistedFilter, read_only
from gcs.tracking.glmb.hypotheses import Clusters
from gcs.tracking.glmb.recursion import Posterior

_MAX_SCANS: Final = 2**62
_MAX_WEIGHT_ERROR: Final = 1e-6


def persisted(t_ns: int | None, scans: int, rng: int, posterior: Posterior) -> PersistedFilter:
    """Return the record of a posterior."""
    clusters = posterior.clusters
    return PersistedFilter(
        t_ns,
        scans,
        rng,
        first=tuple(clusters.first.tolist()),
        start=tuple(clusters.start.tolist()),
        items=tuple(clusters.items.tolist()),
        logw=read_only(clusters.logw),
        track_label=tuple(posterior.track_label.tolist()),
        labels=tuple((k, i) for k, i in posterior.labels.tolist()),
        mean=read_only(posterior.mean),
        cov=read_only(posterior.cov),
        turn=read_only(posterior.turn),
        is_certain=tuple(posterior.is_certain.tolist()),
    )


def posterior(state: PersistedFilter, *, has_turns: bool) -> Posterior:
    """Return the posterior of a record.

    Raises
    ------
    ValueError
        If the record is no valid posterior.
    """
    _check(0 <= state.scans < _MAX_SCANS and 0 <= state.rng < 2**64, "scans")
    n_labels, n_tracks = len(state.labels), len(state.track_label)
    labels = _integers(state.labels).reshape(n_labels, 2)
    _check(bool((labels >= 0).all() and (labels[:, 0] < state.scans).all()), "labels")
    _check(len(set(state.labels)) == n_labels, "labels")
    track_label = _integers(state.track_label)
    _check(_within(track_label, n_labels), "track_label")
    runs = len(list(itertools.groupby(state.track_label)))
    _check(runs == len(set(state.track_label)), "track_label")
    mean = _floats(state.mean, (n_tracks, 4), "mean")
    cov = _floats(state.cov, (n_tracks, 4, 4), "cov")
    _check(bool(np.allclose(cov, cov.transpose(0, 2, 1))), "cov")
    _check(n_tracks == 0 or float(np.linalg.eigvalsh(cov).min()) > 0.0, "cov")
    turn = _floats(state.turn, (n_tracks if has_turns else 0, 6), "turn")
    _check(len(state.is_certain) in (0, n_labels), "is_certain")
    return Posterior(
        _clusters(state, track_label),
        track_label,
        labels,
        mean,
        cov,
        turn,
        np.array(state.is_certain, dtype=np.bool_),
    )


def _clusters(state: PersistedFilter, track_label: npt.NDArray[np.int64]) -> Clusters:
    first, start, items = _integers(state.first), _integers(state.start), _integers(state.items)
    n_hyps = len(start) - 1
    _check(n_hyps >= 0 and len(first) >= 1, "start")
    _check(first[0] == 0 and first[-1] == n_hyps and bool((np.diff(first) > 0).all()), "first")
    _check(start[0] == 0 and start[-1] == len(items) and bool((np.diff(start) >= 0).all()), "start")
    _check(_within(items, len(track_label)), "items")
    logw = _floats(state.logw, (n_hyps,), "logw")
    _check(bool((logw <= _MAX_WEIGHT_ERROR).all()), "logw")
    owner: dict[int, int] = {}
    for cluster, (begin, end) in enumerate(itertools.pairwise(first.tolist())):
        _check(abs(float(np.exp(logw[begin:end]).sum()) - 1.0) < _MAX_WEIGHT_ERROR, "logw")
        for hypothesis in range(begin, end):
            labels = track_label[items[start[hypothesis] : start[hypothesis + 1]]].tolist()
            _check(len(set(labels)) == len(labels), "items")
            _check(all(owner.setdefault(label, cluster) == cluster for label in labels), "items")
    return Clusters(first, start, items, logw)


def _integers(values: Sequence[Any]) -> npt.NDArray[np.int64]:
    try:
        return np.array(values, dtype=np.int64)
    except OverflowError:
        raise ValueError("tracker state: a number is too large") from None


def _floats(values: FloatArray, shape: tuple[int, ...], name: str) -> FloatArray:
    """Return a writable copy; JSON has no shape for empty arrays."""
    _check(values.size == 0 if 0 in shape else values.shape == shape, name)
    _check(bool(np.isfinite(values).all()), name)
    return np.array(values, dtype=np.float64).reshape(shape)


def _within(values: npt.NDArray[np.int64], end: int) -> bool:
    return bool(((values >= 0) & (values < end)).all())


def _check(is_valid: bool, name: str) -> None:
    if not is_valid:
        raise ValueError(f"tracker state: {name} is not valid")
