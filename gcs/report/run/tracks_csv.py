"""Tracks of a run as CSV (`gcs report`): one row for each track and scan."""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path
from typing import Any, Self

from gcs.errors import RecordingError
from gcs.model import NS_PER_S, Picture, track_name

HEADER = ("k", "t", "kind", "label", "x", "y", "vx", "vy", "existence", "estimated")
"""Scan number of its kind; seconds since the start; metres east and north; m/s."""


class TracksCsv:
    """Writes pictures to a file; without a path, nothing.

    Raises
    ------
    RecordingError
        If the file cannot be written; also by `add_picture`.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._scans: Counter[str] = Counter()
        self._file: Any = None

    def __enter__(self) -> Self:
        if self._path is not None:
            try:
                self._file = self._path.open("w", newline="", encoding="utf-8")
            except OSError as error:
                raise RecordingError(str(self._path), f"cannot be written: {error.strerror}") from None
            self._rows = csv.writer(self._file)
            self._rows.writerow(HEADER)
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def add_picture(self, picture: Picture, start_t_ns: int) -> None:
        """Write every track of a picture."""
        k = self._scans[picture.kind]
        self._scans[picture.kind] += 1
        if self._file is None:
            return
        t_s = f"{(picture.scan_t_ns - start_t_ns) / NS_PER_S:.3f}"
        try:
            for track in picture.tracks:
                self._rows.writerow((
                    k, t_s, picture.kind, track_name(picture.kind, track.label),
                    *(f"{value:.4f}" for value in track.mean), f"{track.existence:.6f}", int(track.estimated),
                ))  # fmt: skip
        except OSError as error:
            raise RecordingError(str(self._path), f"cannot be written: {error.strerror}") from None
