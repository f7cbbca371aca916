"""Detections of several sensors, of range and bearing too, are tracked together."""

import json

import numpy as np
import pytest
from helpers.detection_sets import RADARS, scores, seen_by_both
from typer.testing import CliRunner

from gcs.cli import app


def with_radars(folder, *arguments):
    return scores(
        folder / "set.csv", "--model", folder / "model.toml", "--truth", folder / "truth.npz", *arguments
    )


def test_a_radar_and_a_camera_are_tracked_together_by_a_model_file(radars):
    result = with_radars(radars)
    assert result["scans"] == 40
    assert result["ospa_mean_m"] < 6.0
    assert result["cardinality_error_mean"] == 0.0


def test_what_a_radar_measured_may_be_in_radians_and_its_scans_at_any_time(radars):
    before = with_radars(radars)
    text, _ = seen_by_both(np.random.default_rng(3), "bearing_rad", "t_s")
    (radars / "set.csv").write_text(text)
    after = with_radars(radars)
    assert after["ospa_mean_m"] == pytest.approx(before["ospa_mean_m"], rel=1e-3)


@pytest.mark.parametrize(("time", "has_scan"), [("k", True), ("t_s", False)])
def test_a_missing_row_is_an_empty_scan_by_number_and_no_scan_by_time(radars, time, has_scan):
    text, _ = seen_by_both(np.random.default_rng(3), time=time)
    (radars / "set.csv").write_text("\n".join(s for s in text.splitlines() if ",camera," not in s) + "\n")
    west, camera = RADARS.split('name = "camera"')
    surely = camera.replace("detection_probability = 0.9", "detection_probability = 0.999")
    (radars / "model.toml").write_text(west + 'name = "camera"' + surely)
    assert (with_radars(radars)["cardinality_error_mean"] > 0.1) == has_scan


def test_detections_are_counted_by_sensor(radars):
    done = CliRunner().invoke(app, ["info", str(radars / "set.csv"), "--json"])
    contents = json.loads(done.stdout.splitlines()[-1])
    assert contents["sensors"] == ["west", "camera"]
    assert contents["scans"] == 40
    assert contents["not_finite"] == 0
