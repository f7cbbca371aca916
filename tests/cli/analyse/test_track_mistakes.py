"""Mistakes in detections and models are named with their file and what was expected."""

import contextlib

import numpy as np
import pytest
from helpers.detection_sets import MODEL, RADARS, made, run
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.cli.analyse.track_run import track_detections
from gcs.config import read_text
from gcs.errors import GcsError
from gcs.io.detections.track_input import load

MISTAKES = {
    "no such file": (["gone.npz"], "gone.npz: there is no such file"),
    "csv without a model": (["set.csv"], "name one, NPZ or TOML, with --model"),
    "too few columns": (["two.csv", "--model", "set.npz"], "found k,x: rename the columns"),
    "words": (["words.csv", "--model", "set.npz"], "line 3: expected 3 numbers, as the titles k,x,y say"),
    "too few numbers": (
        ["few.npz", "--model", "set.npz"],
        "meas: expected rows k,x,y; found the shape (5, 2)",
    ),
    "an archive of others": (["model.npz", "--model", "set.npz"], "meas: is missing; expected rows k,x,y"),
    "broken archive": (["cut.npz"], "expected an NPZ of numbers"),
    "no model in the archive": (["bare.npz"], "sigma_v: is missing"),
    "another state order": (["order.npz"], "expected constant velocity in the order px, vx, py, vy"),
    "half a scan": (["half.csv", "--model", "set.npz"], "expected whole numbers"),
    "scan a billion": (["far.csv", "--model", "set.npz"], "found number 1000000000"),
    "a mission file for detections": (
        ["mission.toml"],
        "mission.toml: is a mission file or a model: expected detections (NPZ, CSV) or a recording",
    ),
    "a log for detections": (["log.tlog"], "without detections: expected detections (NPZ, CSV)"),
    "a former key": (["set.csv", "--model", "former.toml"], "did you mean `accel_psd_m2_s3`?"),
    "no process noise": (["set.csv", "--model", "still.toml"], "expected a process noise above 0"),
    "a mission file": (["set.csv", "--model", "mission.toml"], "is a mission file"),
    "a key of no meaning": (["set.csv", "--model", "typo.toml"], "unknown key `accel`"),
    "a word for a number": (["set.csv", "--model", "word.toml"], "noise_std_m: expected a number, got text"),
    "a picture for detections": (
        ["noise.bin", "--model", "set.npz"],
        "noise.bin: is not text; expected a CSV",
    ),
    "no recording there": ([".."], "run.mcap"),
    "picture of no kind": (["set.npz", "--plot", "p.docx"], "expected a name that ends in .png"),
    "nowhere to write": (["set.npz", "-o", "set.csv/e.csv"], "cannot be written"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_is_named_with_its_file_and_what_was_expected(files, monkeypatch, case):
    arguments, said = MISTAKES[case]
    (files / "here").mkdir()
    monkeypatch.chdir(files)
    (files / "two.csv").write_text("k,x\n1,2\n")
    (files / "words.csv").write_text("k,x,y\n1,2,3\n1,two,3\n")
    (files / "half.csv").write_text("k,x,y\n0.5,2,3\n")
    (files / "far.csv").write_text("k,x,y\n1e9,2,3\n")
    np.savez(files / "few.npz", meas=np.zeros((5, 2)))
    np.savez(files / "model.npz", F=np.eye(4))
    (files / "cut.npz").write_bytes((files / "set.npz").read_bytes()[:500])
    (files / "noise.bin").write_bytes(b"\x89PNG\xff\xfe")
    (files / "word.toml").write_text(MODEL.replace("10.0\nregion", '"10"\nregion'))
    (files / "typo.toml").write_text("accel = 5.0\n" + MODEL)
    (files / "former.toml").write_text(MODEL.replace("piecewise_", ""))
    (files / "still.toml").write_text(MODEL.replace("piecewise_accel_std_m_s2 = 5.0", ""))
    (files / "log.tlog").write_bytes(bytes(100))
    (files / "mission.toml").write_text(read_text("prescribed")[0])
    arrays = made()
    np.savez(files / "order.npz", **{**arrays, "F": np.kron([[1.0, 1.0], [0.0, 1.0]], np.eye(2))})
    del arrays["sigma_v"]
    np.savez(files / "bare.npz", **arrays)
    done = run(*arguments)
    assert done.exit_code == 2, done.output
    assert said in " ".join(done.stderr.split())


def test_a_model_without_births_is_refused_with_a_remedy(tmp_path):
    np.savez(tmp_path / "set.npz", meas=made()["meas"])
    (tmp_path / "model.toml").write_text(MODEL.split("[[births]]")[0], encoding="utf-8")
    done = run(tmp_path / "set.npz", "--model", tmp_path / "model.toml")
    assert done.exit_code == 2
    assert "anywhere.per_s > 0" in " ".join(done.stderr.split())


SENSOR_MISTAKES = {
    "a name that the model has not": (
        ",camera,",
        ",camrea,",
        "",
        "'camrea' is not in the model, which has: west, camera",
    ),
    "no column of names": ("", "", "", "sensor: is missing"),
    "half of what a radar measures": (
        "bearing_deg,x,y",
        "bearing,px,py",
        "",
        "found k,sensor,range_m",
    ),
    "a camera without places": (",x,y", ",px,py", "", "but camera measures positions"),
    "a key of the other kind": ("", "", ("noise_std_m", "range_std_m"), "sensors[1]"),
    "a kind that is none": ("", "", ('"position"', '"sonar"'), "sensors[1].kind"),
    "no spread of bearings": ("", "", ("bearing_std_deg = 0.5", ""), "`bearing_std_deg` is missing"),
    "two of one name": ("", "", ('"camera"', '"west"'), "sensors[1].name: 'west' is the name of another"),
    "nowhere to see": (
        "",
        "",
        ("most_range_m = 2000.0", "most_range_m = 1.0\nleast_range_m = 2.0"),
        "most_range_m",
    ),
    "one sensor and several": ("", "", ("accel", "noise_std_m = 3.0\naccel"), "is of one sensor"),
    "no sensor": ("", "", ("[[sensors]]", "[[sensers]]"), "unknown key `sensers`"),
}


@pytest.mark.parametrize("case", SENSOR_MISTAKES)
def test_a_mistake_about_sensors_is_named(radars, case):
    old, new, model, said = SENSOR_MISTAKES[case]
    csv_file, model_file = radars / "set.csv", radars / "model.toml"
    text = csv_file.read_text().replace(old, new) if old else csv_file.read_text()
    if case == "no column of names":
        text = "k,x,y\n1,2.0,3.0\n"
    csv_file.write_text(text)
    model_file.write_text(model_file.read_text().replace(*model) if model else RADARS)
    done = run(csv_file, "--model", model_file)
    assert done.exit_code == 2, done.output
    assert said in " ".join(done.stderr.split())


ROWS = st.lists(
    st.tuples(st.integers(0, 12), st.floats(allow_nan=True), st.floats(allow_nan=True)),
    min_size=1,
    max_size=30,
)


@settings(max_examples=25)
@given(rows=ROWS)
def test_no_numbers_however_wild_make_it_fail(tmp_path_factory, rows):
    folder = tmp_path_factory.mktemp("wild")
    (folder / "model.toml").write_text(MODEL)
    (folder / "wild.csv").write_text("k,x,y\n" + "".join(f"{k},{x},{y}\n" for k, x, y in rows))
    detections = load(folder / "wild.csv", folder / "model.toml", None)
    tracked = track_detections(detections, "smoothed")
    bad = sum(not np.isfinite(row[1:]).all() and not np.isnan(row[1:]).all() for row in rows)
    assert tracked.bad_detections == bad
    for states in tracked.states.values():
        assert all(np.isfinite(state).all() for state in states.values())


@settings(max_examples=40)
@given(data=st.binary(max_size=300), name=st.sampled_from(["x.npz", "x.csv"]))
def test_any_bytes_are_read_or_refused_in_words(tmp_path_factory, data, name):
    folder = tmp_path_factory.mktemp("bytes")
    (folder / "model.toml").write_text(MODEL)
    (folder / name).write_bytes(data)
    with contextlib.suppress(GcsError):
        load(folder / name, folder / "model.toml", None)
