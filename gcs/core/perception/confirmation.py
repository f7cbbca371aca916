"""Which tracks are believed: hysteresis, so that neither a clutter point nor a missed detection counts.

A track is believed once it was in the estimate for some scans in a row. It is believed no more when its
existence probability falls below `lost_existence`, or when it was out of the estimate for as many scans in
a row: then another label has its object. In between, single scans say little: a clutter point at a place of
birth is in the estimate for one scan, and a good track that was missed may be out of it for one.

What counts is a moment at which somebody looked at the track: sensors that measure at the same moment count
once, and one that looks elsewhere does not count at all.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from gcs.model import Label, Picture, Sensor, Track
from gcs.tracking.models.sensors import covers

SCANS_IN_A_ROW = 3


class TrackConfirmation:
    """The believed tracks of one kind."""

    def __init__(self, lost_existence: float) -> None:
        self._lost_existence = lost_existence
        self._t_ns = -1
        self._row: dict[Label, int] = {}
        """How many moments in a row each label was in the estimate; below 0, out of it."""
        self._row_before: dict[Label, int] = {}
        """The same before the moment `_t_ns`."""
        self._tracks: dict[Label, Track] = {}
        self._alive: dict[Label, Track] = {}

    @property
    def tracks(self) -> Mapping[Label, Track]:
        """Believed tracks by label, as of the last picture."""
        return self._tracks

    @property
    def alive(self) -> Collection[Track]:
        """Tracks that are not dead, believed or not."""
        return self._alive.values()

    def is_lost(self, label: Label) -> bool:
        """Whether a track's existence probability is below `lost_existence`, or it is gone altogether."""
        return label not in self._alive

    def update(self, picture: Picture, sensor: Sensor | None = None) -> None:
        """Take the next picture, after a scan of `sensor`; without one, of a sensor that sees everywhere."""
        if picture.scan_t_ns > self._t_ns:
            self._t_ns, self._row_before = picture.scan_t_ns, self._row
        tracks = picture.tracks
        places = np.reshape([track.mean[:2] for track in tracks], (-1, 2))
        looked_at = np.ones(len(tracks), np.bool_) if sensor is None else covers(sensor, places)
        self._row = {
            track.label: self._next(track) if looked else self._row.get(track.label, 0)
            for track, looked in zip(tracks, looked_at, strict=True)
        }
        self._alive = {track.label: track for track in tracks if track.existence >= self._lost_existence}
        self._tracks = {track.label: track for track in tracks if self._is_believed(track)}

    def _next(self, track: Track) -> int:
        """Count one moment more, whoever else looked at the same moment."""
        before = self._row_before.get(track.label, 0)
        return max(before, 0) + 1 if track.estimated else min(before, 0) - 1

    def _is_believed(self, track: Track) -> bool:
        row = self._row[track.label]
        if track.label in self._tracks:
            return track.label in self._alive and row > -SCANS_IN_A_ROW
        return row >= SCANS_IN_A_ROW
