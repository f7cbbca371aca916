"""Which tracks are believed: hysteresis, so that neither a clutter point nor a missed detection counts.

A track is believed once it was in the estimate for some scans in a row. It is believed no more when its
existence probability falls below `dead_existence`, or when it was out of the estimate for as many scans in
a row: then another label has its object. In between, single scans say little: a clutter point at a place of
birth is in the estimate for one scan, and a good track that was missed may be out of it for one.
"""

from __future__ import annotations

from collections.abc import Mapping

from gcs.model import Label, Picture, Track

SCANS_IN_A_ROW = 3


class Beliefs:
    """The believed tracks of one kind."""

    def __init__(self, dead_existence: float) -> None:
        self._dead_existence = dead_existence
        self._scans_in: dict[Label, int] = {}
        self._scans_out: dict[Label, int] = {}
        self._tracks: dict[Label, Track] = {}
        self._alive: set[Label] = set()

    @property
    def tracks(self) -> Mapping[Label, Track]:
        """Believed tracks by label, as of the last picture."""
        return self._tracks

    def is_dead(self, label: Label) -> bool:
        """Whether a track's existence probability is below `dead_existence`, or it is gone altogether."""
        return label not in self._alive

    def update(self, picture: Picture) -> None:
        """Take the next picture."""
        labels = {track.label: track for track in picture.tracks}
        self._scans_in = {t: self._scans_in.get(t, 0) + 1 for t, track in labels.items() if track.estimated}
        self._scans_out = {
            t: self._scans_out.get(t, 0) + 1 for t, track in labels.items() if not track.estimated
        }
        self._alive = {t for t, track in labels.items() if track.existence >= self._dead_existence}
        self._tracks = {label: track for label, track in labels.items() if self._is_believed(track)}

    def _is_believed(self, track: Track) -> bool:
        if track.label in self._tracks:
            return track.label in self._alive and self._scans_out.get(track.label, 0) < SCANS_IN_A_ROW
        return self._scans_in.get(track.label, 0) >= SCANS_IN_A_ROW
