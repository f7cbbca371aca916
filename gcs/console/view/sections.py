"""Sections of the feed that are computed; the others are records of `gcs.model` as they are."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from gcs.console.view.page_records import FieldOfView, Tracks
from gcs.model import Picture, Scan, track_name

MAX_DETECTIONS: Final = 20_000
"""Detections of one scan that a page gets."""


def tracks(picture: Picture) -> Tracks:
    """Return the tracks of one kind."""
    found = picture.tracks
    means: Any = np.array([track.mean for track in found]).reshape(-1, 4)
    covs = np.array([track.cov for track in found]).reshape(-1, 4, 4)
    return Tracks(
        names=[track_name(picture.kind, track.label) for track in found],
        means=means.round(1).tolist(),
        covs=covs[:, [0, 0, 1], [0, 1, 1]].round(1).tolist(),
        existence=[round(track.existence, 3) for track in found],
        estimated=[track.estimated for track in found],
    )


def detections(scan: Scan) -> list[int]:
    """Return the detections of a scan, east and north in turns."""
    found: list[int] = scan.z_m[:MAX_DETECTIONS].round(0).astype(int).ravel().tolist()
    return found


def fields_of_view(scans: list[Scan]) -> dict[str, FieldOfView]:
    """Return the field of view of the sensor of each scan."""
    return {one.sensor.name: FieldOfView(one.sensor.field_of_view_m, one.sensor.polar) for one in scans}
