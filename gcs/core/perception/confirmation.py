"""Track confirmation, with hysteresis against clutter and missed detections.

A track is confirmed after `CONFIRMATION_EPOCHS` consecutive epochs in the estimate. It is dropped when its
existence probability falls below `lost_existence`, or after as many epochs out of the estimate: then another
label has its object.

Only epochs count at which a sensor covered the track. Sensors that measure at the same time count once.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

import numpy as np

from gcs.model import Confirmation, Label, Picture, Sensor, Track
from gcs.tracking.models.sensors import covers

CONFIRMATION_EPOCHS = 3


class TrackConfirmation:
    """Confirmed tracks of one kind."""

    def __init__(self, lost_existence: float) -> None:
        self._lost_existence = lost_existence
        self._t_ns = -1
        self._counts: dict[Label, int] = {}
        """Consecutive epochs of each label in the estimate; negative: out of it."""
        self._counts_before: dict[Label, int] = {}
        """The same before the epoch `_t_ns`."""
        self._tracks: dict[Label, Track] = {}
        self._existing: dict[Label, Track] = {}

    @property
    def tracks(self) -> Mapping[Label, Track]:
        """Confirmed tracks by label, as of the last picture."""
        return self._tracks

    @property
    def existing(self) -> Collection[Track]:
        """Tracks above `lost_existence`, confirmed or not."""
        return self._existing.values()

    def is_lost(self, label: Label) -> bool:
        """Return True if a track has ended, or its existence probability is below `lost_existence`."""
        return label not in self._existing

    def update(self, picture: Picture, sensor: Sensor | None = None) -> None:
        """Process the next picture, after a scan of `sensor`; None: of a sensor that covers everything."""
        if picture.scan_t_ns > self._t_ns:
            self._t_ns, self._counts_before = picture.scan_t_ns, self._counts
        tracks = picture.tracks
        positions = np.reshape([track.mean[:2] for track in tracks], (-1, 2))
        is_covered = np.ones(len(tracks), np.bool_) if sensor is None else covers(sensor, positions)
        self._counts = {
            track.label: self._next_count(track) if covered else self._counts.get(track.label, 0)
            for track, covered in zip(tracks, is_covered, strict=True)
        }
        self._existing = {track.label: track for track in tracks if track.existence >= self._lost_existence}
        self._tracks = {track.label: track for track in tracks if self._is_confirmed(track)}

    def persisted(self) -> tuple[Confirmation, ...]:
        """Return the confirmation of each label, for `restore`."""
        return tuple(
            Confirmation(label, count, label in self._tracks) for label, count in sorted(self._counts.items())
        )

    def restore(self, confirmations: Iterable[Confirmation], picture: Picture) -> None:
        """Continue from persisted confirmations, with the tracks of a restored filter."""
        tracks = {track.label: track for track in picture.tracks}
        known = [one for one in confirmations if one.label in tracks]
        self._t_ns = picture.scan_t_ns
        self._counts = self._counts_before = {one.label: one.count for one in known}
        self._existing = {
            label: track for label, track in tracks.items() if track.existence >= self._lost_existence
        }
        self._tracks = {one.label: tracks[one.label] for one in known if one.is_confirmed}

    def _next_count(self, track: Track) -> int:
        before = self._counts_before.get(track.label, 0)
        return max(before, 0) + 1 if track.estimated else min(before, 0) - 1

    def _is_confirmed(self, track: Track) -> bool:
        count = self._counts[track.label]
        if track.label in self._tracks:
            return track.label in self._existing and count > -CONFIRMATION_EPOCHS
        return count >= CONFIRMATION_EPOCHS


class ConsecutiveEpochs:
    """Counts, for each key, the consecutive epochs at which a condition held.

    Of several measurements at one epoch the last one counts.
    """

    def __init__(self) -> None:
        self._counts: dict[int, tuple[int, int, int]] = {}
        """Last epoch, count up to it, and count before it, by key."""

    def count(self, key: int, measured_t_ns: int, *, holds: bool) -> int:
        """Return the number of consecutive epochs up to `measured_t_ns`; 0 if the condition does not hold."""
        epoch_t_ns, count, before = self._counts.get(key, (-1, 0, 0))
        if measured_t_ns > epoch_t_ns:
            before = count
        count = before + 1 if holds else 0
        self._counts[key] = (measured_t_ns, count, before)
        return count

    def forget(self, key: int) -> None:
        """Restart the count of a key."""
        self._counts.pop(key, None)
