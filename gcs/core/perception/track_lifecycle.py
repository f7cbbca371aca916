"""Confirmation of tracks after some scans, and their loss, with hysteresis against clutter and misses.

A track is confirmed after `CONFIRMATION_EPOCHS` consecutive epochs in the estimate. It is dropped when its
existence probability falls below `lost_existence`, or after as many epochs out of the estimate: then another
label has its object.

Only epochs count at which a sensor covered the track. Sensors that measure at the same time count once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from gcs.core.perception.perception_state import ConfirmationState
from gcs.model import Label, Picture, Sensor, Track
from gcs.tracking.models.sensor_geometry import covers

CONFIRMATION_EPOCHS = 3


class TrackConfirmation:
    """Confirmed tracks of one kind.

    Parameters
    ----------
    lost_existence : float
        Existence probability below which a track is lost.
    tracks : sequence of Track
        Tracks of the last picture.

    Attributes
    ----------
    tracks : mapping
        Confirmed tracks by label, as of the last picture.
    existing : mapping
        Tracks above `lost_existence` by label, confirmed or not.
    """

    def __init__(self, lost_existence: float, state: ConfirmationState, tracks: Sequence[Track] = ()) -> None:
        self._lost_existence = lost_existence
        self._state = state
        self.existing = self._above_lost_existence(tracks)
        confirmed = set(state.confirmed)
        self.tracks: Mapping[Label, Track] = {
            track.label: track for track in tracks if track.label in confirmed
        }

    def is_lost(self, label: Label) -> bool:
        """Return True if a track has ended, or its existence probability is below `lost_existence`."""
        return label not in self.existing

    def update(self, picture: Picture, sensor: Sensor | None = None) -> None:
        """Process the next picture, after a scan of `sensor`; None: of a sensor that covers everything."""
        state = self._state
        tracks = picture.tracks
        if picture.scan_t_ns > state.t_ns:
            state.t_ns = picture.scan_t_ns
            state.counts_before = state.counts
        positions = np.reshape([track.mean[:2] for track in tracks], (-1, 2))
        is_covered = np.ones(len(tracks), np.bool_) if sensor is None else covers(sensor, positions)
        state.counts = {
            track.label: self._next_count(track) if covered else state.counts.get(track.label, 0)
            for track, covered in zip(tracks, is_covered, strict=True)
        }
        self.existing = self._above_lost_existence(tracks)
        self.tracks = {track.label: track for track in tracks if self._is_confirmed(track)}
        state.confirmed = list(self.tracks)

    def _above_lost_existence(self, tracks: Iterable[Track]) -> Mapping[Label, Track]:
        return {track.label: track for track in tracks if track.existence >= self._lost_existence}

    def _next_count(self, track: Track) -> int:
        before = self._state.counts_before.get(track.label, 0)
        return max(before, 0) + 1 if track.estimated else min(before, 0) - 1

    def _is_confirmed(self, track: Track) -> bool:
        count = self._state.counts[track.label]
        if track.label in self.tracks:
            return track.label in self.existing and count > -CONFIRMATION_EPOCHS
        return count >= CONFIRMATION_EPOCHS
