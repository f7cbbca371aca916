"""An analyst would count one track where there are two: 0.1 and 0.10 are one number."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from gcs.model import Kind, Picture, Track, read_only
from gcs.report.run.tracks_csv import TracksCsv


@pytest.mark.parametrize(("kind", "labels"), [("targets", ["T0.1", "T0.10"]), ("agents", ["A0.1", "A0.10"])])
def test_labels_stay_apart_when_read_as_numbers(tmp_path: Path, kind: Kind, labels: list[str]) -> None:
    tracks = tuple(
        Track((0, index), read_only(np.zeros(4)), read_only(np.eye(4)), 0.9, True) for index in (1, 10)
    )
    with TracksCsv(tmp_path / "tracks.csv") as rows:
        rows.add_picture(Picture(0, 0, kind, tracks, read_only([1.0])), 0)
    with (tmp_path / "tracks.csv").open(newline="") as file:
        found = [row["label"] for row in csv.DictReader(file)]
    assert found == labels
    for label in found:
        with pytest.raises(ValueError, match="could not convert"):
            float(label)
