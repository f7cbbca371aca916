"""Which tracks are believed: hysteresis, so that neither a clutter point nor a missed detection counts.

A track is believed when its existence probability stayed at or above `confirm_existence` for some scans in a
row, and until it falls below `dead_existence`. In between it is a matter of time: a single clutter point at a
place of birth is above 0.5 for one scan, and a single missed detection takes a good track below it for one.
"""

from __future__ import annotations

from collections.abc import Mapping

from gcs.model import Label, Picture, Track

CONFIRM_SCANS = 3


class Beliefs:
    """The believed tracks of one kind."""

    def __init__(self, confirm_existence: float, dead_existence: float) -> None:
        self._confirm_existence = confirm_existence
        self._dead_existence = dead_existence
        self._scans_above: dict[Label, int] = {}
        self._tracks: dict[Label, Track] = {}

    @property
    def tracks(self) -> Mapping[Label, Track]:
        """Believed tracks by label, as of the last picture."""
        return self._tracks

    def update(self, picture: Picture) -> None:
        """Take the next picture."""
        tracks: dict[Label, Track] = {}
        scans_above: dict[Label, int] = {}
        for track in picture.tracks:
            above = track.existence >= self._confirm_existence
            count = self._scans_above.get(track.label, 0) + 1 if above else 0
            scans_above[track.label] = count
            kept = track.label in self._tracks and track.existence >= self._dead_existence
            if kept or count >= CONFIRM_SCANS:
                tracks[track.label] = track
        self._tracks, self._scans_above = tracks, scans_above
