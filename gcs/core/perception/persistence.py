"""Trackers as persisted state, and back."""

from __future__ import annotations

import numpy as np

from gcs.core.perception.records import ConfirmationState, TrackersState, TrackerState
from gcs.core.perception.tracking_model import BIRTH_AGAIN_PROBABILITY, BIRTH_PROBABILITY
from gcs.model import Confirmation, PersistedFilter, PersistedTracker, PersistedTrackers, read_only
from gcs.tracking.glmb.hypotheses import Clusters
from gcs.tracking.glmb.recursion import Posterior
from gcs.tracking.glmb.state import GlmbState


def persisted(state: TrackersState) -> PersistedTrackers:
    """Return the trackers after the last scan."""
    sensors = tuple(sorted(state.sensors_at_epoch))
    return PersistedTrackers(_tracker(state.agents), _tracker(state.targets), state.measured_t_ns, sensors)


def _tracker(state: TrackerState) -> PersistedTracker:
    probabilities = (BIRTH_AGAIN_PROBABILITY if one else BIRTH_PROBABILITY for one in state.is_born)
    counts, confirmed = sorted(state.confirmation.counts.items()), set(state.confirmation.confirmed)
    confirmations = tuple(Confirmation(label, count, label in confirmed) for label, count in counts)
    return PersistedTracker(_filter(state.filter), tuple(probabilities), confirmations)


def _filter(state: GlmbState) -> PersistedFilter:
    posterior, clusters = state.posterior, state.posterior.clusters
    return PersistedFilter(
        state.t_ns,
        state.scans,
        state.rng,
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


def restored(state: PersistedTracker) -> TrackerState:
    """Return the state of a tracker; its constructor checks it.

    Raises
    ------
    ValueError
        If a number is too large, or an array has a wrong size.
    """
    kept = state.filter
    try:
        first, start, items = (np.array(one, np.int64) for one in (kept.first, kept.start, kept.items))
        posterior = Posterior(
            Clusters(first, start, items, np.array(kept.logw)),
            np.array(kept.track_label, np.int64),
            np.array(kept.labels, np.int64).reshape(-1, 2),
            np.array(kept.mean).reshape(-1, 4),
            np.array(kept.cov).reshape(-1, 4, 4),
            np.array(kept.turn).reshape(-1, 6),
            np.array(kept.is_certain, np.bool_),
        )
    except (OverflowError, ValueError):
        raise ValueError("tracker state: an array is not valid") from None
    counts = {one.label: one.count for one in state.confirmations}
    return TrackerState(
        filter=GlmbState(kept.t_ns, kept.scans, rng=kept.rng, posterior=posterior),
        confirmation=ConfirmationState(
            -1 if kept.t_ns is None else kept.t_ns,
            counts,
            counts,
            [one.label for one in state.confirmations if one.is_confirmed],
        ),
        is_born=[probability == BIRTH_AGAIN_PROBABILITY for probability in state.birth_probabilities],
        born_t_ns=-1 if kept.t_ns is None else kept.t_ns,
    )
