"""`gcs track` as a user runs it: detections in, estimates and scores out."""

import csv
import json
import sys

import numpy as np
import pytest
from bench_baselines import compare
from helpers.detection_sets import KEYS, MODEL, SCANS, made, run, scores
from helpers.ridged import ridge, terrain_table
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config import read_text
from gcs.io.detections.track_input import load
from gcs.io.recording.recorder import Recorder
from gcs.model import NS_PER_S, Scan, Sensor, Truth, TruthObject, Viewpoint, read_only


def test_a_set_with_its_own_model_is_tracked_written_scored_and_drawn(files):
    result = scores(files / "set.npz", "-o", files / "e.csv", "--plot", files / "p.png")
    assert result["scans"] == SCANS
    assert result["ospa_mean_m"] < 15.0
    assert result["ospa_mean_m"] <= result["ospa2_mean_m"] + 5.0
    assert result["id_switches"] == 0
    assert 0.0 < result["scan_ms_mean"] <= result["scan_ms_p99"]
    with (files / "e.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["k", "label", "x", "y", "vx", "vy", "existence"]
    first = [row for row in rows if row["label"] == "1"]
    assert [int(row["k"]) for row in first] == list(range(1, SCANS + 1))
    last = {key: float(first[-1][key]) for key in first[-1]}
    assert np.hypot(last["x"] - 150.0, last["y"] - 60.0) < 40.0
    assert np.hypot(last["vx"] - 15.0, last["vy"] - 2.0) < 15.0
    assert 0.9 < last["existence"] <= 1.0
    assert (files / "p.png").read_bytes()[:4] == b"\x89PNG"


def test_smoothing_beats_recovering_beats_filtering(files):
    smoothed, recovered, filtered = (
        scores(files / "set.npz", "--estimator", name)["ospa2_mean_m"]
        for name in ("smoothed", "recovered", "filtered")
    )
    assert smoothed < recovered < filtered


def test_a_lag_trades_delay_for_accuracy_between_the_two_ends(files):
    smoothed = ("--estimator", "smoothed")
    filtered = scores(files / "set.npz", "--estimator", "filtered")["ospa_mean_m"]
    soon, late, all_ = (
        scores(files / "set.npz", *smoothed, *lag)["ospa_mean_m"]
        for lag in (("--lag-scans", 2), ("--lag-scans", 99), ())
    )
    assert all_ == pytest.approx(late)
    assert all_ < soon < filtered
    refused = run(files / "set.npz", "--lag-scans", 2)
    assert refused.exit_code
    assert "--estimator smoothed" in " ".join(refused.output.split())


def test_who_appears_between_two_scans_has_moved_on_by_the_second(files):
    (files / "fast.toml").write_text(
        MODEL.replace("scans = 30", "scans = 30\ndt_s = 2.0").replace(
            "y_m = 300.0", "y_m = 300.0\nvx_m_s = 9.0"
        )
    )
    birth = load(files / "set.csv", files / "fast.toml", None).model.births[1]
    rng = np.random.default_rng(3)
    n = 200_000
    velocity = rng.normal([9.0, 0.0], 10.0, (n, 2))
    place = rng.normal([0.0, 300.0], 10.0, (n, 2)) + velocity * rng.uniform(0.0, 2.0, (n, 1))
    drawn = np.column_stack([place, velocity])
    np.testing.assert_allclose(birth.mean, drawn.mean(axis=0), atol=0.2)
    np.testing.assert_allclose(birth.cov, np.cov(drawn.T), rtol=0.02, atol=2.0)


def test_csv_with_a_model_of_either_kind_is_the_same_as_the_set(files):
    expected = scores(files / "set.npz")
    for model in ("set.npz", "model.toml"):
        given_truth = ("--truth", files / "truth.csv")
        result = scores(files / "set.csv", "--model", files / model, *given_truth)
        assert result["ospa_mean_m"] == pytest.approx(expected["ospa_mean_m"], abs=1e-4)
    unknown = scores(files / "set.csv", "--model", files / "model.toml")
    assert [unknown[key] for key in KEYS[1:6]] == [None] * 5


def test_the_tracker_never_reads_truth_and_origins(files):
    arrays = made()
    arrays["meas"][:, 3] = 7.0
    arrays["truth"][:, 2:] = 0.0
    np.savez(files / "blind.npz", **arrays)
    for name in ("set", "blind"):
        assert run(files / f"{name}.npz", "-o", files / f"{name}.out").exit_code == 0
    assert (files / "set.out").read_bytes() == (files / "blind.out").read_bytes()


@pytest.mark.parametrize("estimator", ["filtered", "smoothed"])
def test_the_tracker_is_better_than_nearest_neighbour(files, estimator):
    found = compare(load(files / "set.npz", None, None), estimator)
    assert found["true-association"].ospa_mean_m < found["GLMB"].ospa_mean_m < found["nearest"].ospa_mean_m


def test_a_scan_without_detections_is_a_scan(files):
    arrays = made()
    arrays["meas"] = arrays["meas"][arrays["meas"][:, 0] % 5 != 0]
    np.savez(files / "holes.npz", **arrays)
    assert scores(files / "holes.npz")["scans"] == SCANS


def test_a_recording_is_tracked_with_the_announced_sensor_models(tmp_path):
    text, _ = read_text("prescribed")
    rng = np.random.default_rng(3)
    place = np.array([700.0, 600.0])
    text = text.split("\n[[births]]", 1)[0] + f"\n[[births]]\neast_m = {place[0]}\nnorth_m = {place[1]}\n"
    with Recorder(tmp_path / "run", text, {}) as recorder:
        for k in range(20):
            t_ns = k * NS_PER_S
            detector = Sensor("radar", 0.98, 1e-6, read_only(np.eye(2) * 9.0), (0.0, 0.0, 2000.0, 2000.0))
            recorder.record_event(Scan(t_ns + 5, t_ns, detector, read_only([place + rng.normal(0, 3, 2)])))
            recorder.record_truth(Truth(t_ns, (TruthObject("targets", 1, *place.tolist(), True),)))
    result = scores(tmp_path / "run")
    assert result["scans"] == 20
    assert result["ospa_mean_m"] < 10.0
    assert result["cardinality_error_mean"] == 0.0


@pytest.mark.parametrize(("height_agl_m", "is_kept"), [(10.0, True), (None, False)])
def test_a_recorded_target_behind_a_ridge_is_kept(tmp_path, height_agl_m, is_kept):
    text, _ = read_text("prescribed")
    text = text.split("\n[[births]]", 1)[0] + "\n[[births]]\neast_m = 960.0\nnorth_m = 600.0\n"
    viewpoint = None if height_agl_m is None else Viewpoint(300.0, 600.0, height_agl_m, is_agl=True)
    detector = Sensor(
        "radar", 0.98, 1e-6, read_only(np.eye(2) * 9.0), (0.0, 0.0, 2000.0, 2000.0), viewpoint=viewpoint
    )
    rng = np.random.default_rng(3)
    with Recorder(tmp_path / "run", text + terrain_table(ridge(), 50.0, 90.0), {}) as recorder:
        for k in range(20):
            place = np.array([960.0 + 5.0 * k, 600.0])
            seen = [place + rng.normal(0, 3, 2)] if place[0] < 1005.0 else []
            z_m = read_only(np.reshape(seen, (-1, 2)))
            recorder.record_event(Scan(k * NS_PER_S + 5, k * NS_PER_S, detector, z_m))
            recorder.record_truth(Truth(k * NS_PER_S, (TruthObject("targets", 1, *place.tolist(), True),)))
    assert (scores(tmp_path / "run")["cardinality_error_mean"] < 0.1) == is_kept


ANYWHERE = MODEL.split("[[births]]")[0] + "[anywhere]\nper_s = 0.1\n"


def test_without_places_of_birth_objects_are_found_where_they_appear(tmp_path):
    arrays, model = made(), tmp_path / "model.toml"
    np.savez(tmp_path / "set.npz", **{name: arrays[name] for name in ("meas", "truth")})
    model.write_text(ANYWHERE, encoding="utf-8")
    result = CliRunner().invoke(app, ["track", str(tmp_path / "set.npz"), "--model", str(model), "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.output.strip().splitlines()[-1])["cardinality_error_mean"] < 0.3


def circling(rng, scans=60, radius_m=60.0, speed_m_s=15.0):
    """Rows of truth and of detections of an aircraft that loiters."""
    angle = np.arange(scans) * speed_m_s / radius_m
    place = radius_m * np.column_stack([np.cos(angle), np.sin(angle)])
    velocity = speed_m_s * np.column_stack([-np.sin(angle), np.cos(angle)])
    k = np.arange(1.0, scans + 1)
    truth = np.column_stack([k, np.ones(scans), place[:, 0], velocity[:, 0], place[:, 1], velocity[:, 1]])
    seen = rng.random(scans) < 0.95
    made = np.column_stack([k, place + rng.normal(0.0, 10.0, place.shape)])[seen]
    clutter = np.column_stack(
        [rng.integers(1, scans + 1, 10 * scans), rng.uniform(-500, 500, (10 * scans, 2))]
    )
    return truth, np.vstack([made, clutter])


def test_paths_of_turning_objects_are_recovered_with_their_turns(tmp_path):
    truth, meas = circling(np.random.default_rng(3))
    np.savez(tmp_path / "set.npz", meas=meas, truth=truth)
    head, _ = MODEL.split("[[births]]", 1)
    birth = "[[births]]\nx_m = 60.0\ny_m = 0.0\nstd_m = 10.0\nspeed_std_m_s = 10.0\nprobability = 0.03\n"
    straight, turning = tmp_path / "straight.toml", tmp_path / "turning.toml"
    straight.write_text(head + birth)
    head = head.replace(
        "piecewise_accel_std_m_s2 = 5.0", "piecewise_accel_std_m_s2 = 1.0\nturn_rate_std_deg_s = 17.0"
    )
    turning.write_text(head + birth)

    def ospa(model, estimator):
        result = scores(tmp_path / "set.npz", "--model", model, "--estimator", estimator)
        return result["ospa_mean_m"]

    filtered, recovered, smoothed = (ospa(turning, e) for e in ("filtered", "recovered", "smoothed"))
    assert recovered <= filtered
    assert smoothed < 0.75 * recovered
    assert smoothed < ospa(straight, "smoothed")


def test_scores_have_the_cut_off_that_long_ranges_need(files):
    how = (files / "set.npz", "--estimator", "filtered")
    plain, at_100, at_1000 = (
        scores(*how, *more) for more in ([], ["--cutoff-m", "100"], ["--cutoff-m", "1000"])
    )
    assert at_100["gospa_mean_m"] == plain["gospa_mean_m"]
    assert at_1000["ospa_mean_m"] > 3.0 * at_100["ospa_mean_m"] == 3.0 * plain["ospa_mean_m"]
    shown = " ".join(run(files / "set.npz", "--cutoff-m", "1000").output.split())
    assert "OSPA (c 1000 m, p 1)" in shown
    assert "GOSPA (c 500 m, p 2)" in shown
    assert all(run(files / "set.npz", "--cutoff-m", c).exit_code == 2 for c in ("0", "nan", "inf"))


def test_objects_that_manoeuvre_keep_their_label_with_manoeuvres_in_the_model(tmp_path):
    rng = np.random.default_rng(2)
    k = np.arange(1, 41)
    angle = np.cumsum(np.where((k > 15) & (k < 24), np.radians(25.0), 0.0))
    place = np.cumsum(20.0 * np.column_stack([np.cos(angle), np.sin(angle)]), axis=0) - [300.0, 0.0]
    truth = np.column_stack([k, np.ones(40), place[:, 0], 0 * k, place[:, 1], 0 * k])
    seen = rng.random(40) < 0.9
    meas = np.column_stack([k, place + rng.normal(0.0, 5.0, place.shape)])[seen]
    clutter = np.column_stack([rng.integers(1, 41, 400), rng.uniform(-500, 500, (400, 2))])
    np.savez(tmp_path / "set.npz", meas=np.vstack([meas, clutter]), truth=truth)
    head = MODEL.split("[[births]]", 1)[0].replace("piecewise_accel_std_m_s2 = 5.0", "accel_psd_m2_s3 = 0.1")
    head = head.replace("noise_std_m = 10.0", "noise_std_m = 5.0").replace("scans = 30", "scans = 40")
    anywhere = "[anywhere]\nper_s = 0.1\nspeed_std_m_s = 20.0\n"
    manoeuvres = "[manoeuvres]\naccel_psd_m2_s3 = 50.0\nmean_time_s = 10.0\nstraight_time_s = 20.0\n"
    (tmp_path / "straight.toml").write_text(head + anywhere)
    (tmp_path / "both.toml").write_text(head + anywhere + manoeuvres)
    straight, both = (
        scores(tmp_path / "set.npz", "--model", tmp_path / f"{n}.toml") for n in ("straight", "both")
    )
    assert both["labels_per_object"] == 1.0 < straight["labels_per_object"]
    assert both["ospa_mean_m"] < straight["ospa_mean_m"]
    (tmp_path / "both.toml").write_text("turn_rate_std_deg_s = 5.0\n" + head + anywhere + manoeuvres)
    refused = run(tmp_path / "set.npz", "--model", tmp_path / "both.toml")
    assert refused.exit_code == 2
    assert "another model of turns than [manoeuvres]" in " ".join(refused.output.split())


def test_several_files_give_mean_deviation_and_interval(files):
    for seed, name in enumerate(("second", "third"), 2):
        np.savez(files / f"{name}.npz", **made(seed))
    paths = [files / f"{name}.npz" for name in ("set", "second", "third")]
    done = run(*paths, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout.splitlines()[-1])
    each = [scores(path)["ospa_mean_m"] for path in paths]
    assert [one["ospa_mean_m"] for one in found["files"]] == each
    assert [one["file"] for one in found["files"]] == [str(path) for path in paths]
    spread = found["spread"]["ospa_mean_m"]
    assert spread["mean"] == pytest.approx(np.mean(each))
    assert spread["std"] == pytest.approx(np.std(each, ddof=1))
    half = 4.3026527 * np.std(each, ddof=1) / np.sqrt(3)  # Student's t, two degrees of freedom
    assert spread["interval_95"] == pytest.approx([np.mean(each) - half, np.mean(each) + half])
    shown = " ".join(run(*paths).output.split())
    assert "3 files, recovered" in shown
    assert "95 % interval of the mean" in shown


@pytest.mark.parametrize("option", ["-o", "--plot", "--truth"])
def test_outputs_and_truth_of_one_file_are_refused_for_several(files, option):
    done = run(files / "set.npz", files / "set.npz", option, files / "one.png")
    assert done.exit_code == 2
    assert "is for one file: got 2 files" in " ".join(done.stderr.split())
    assert not (files / "one.png").exists()


def test_parquet_has_the_columns_of_the_csv(files):
    parquet = pytest.importorskip("pyarrow.parquet")
    for ending in ("csv", "parquet"):
        assert run(files / "set.npz", "-o", files / f"e.{ending}").exit_code == 0
    table = parquet.read_table(files / "e.parquet")
    rows = np.genfromtxt(files / "e.csv", delimiter=",", names=True)
    assert table.column_names == list(rows.dtype.names)
    assert str(table.schema.field("label").type) == "int64"
    for name in table.column_names:
        np.testing.assert_allclose(table[name].to_numpy(), rows[name], atol=6e-5)


def test_parquet_without_its_library_is_refused_with_a_remedy(files, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    done = run(files / "set.npz", "-o", files / "e.parquet")
    assert done.exit_code == 2
    assert "pip install 'swarm-gcs[tables]'" in " ".join(done.stderr.split())
