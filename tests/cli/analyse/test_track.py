"""`gcs track` as a user runs it: detections in, estimates and scores out, mistakes named in plain words."""

import contextlib
import csv
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from gcs.cli import app
from gcs.cli.analyse.track_run import track_detections
from gcs.config import read_text
from gcs.errors import GcsError
from gcs.io.detections.readers import load
from gcs.io.recording.writer import Recorder
from gcs.model import NS_PER_S, Scan, Sensor, Truth, TruthObject, read_only

KEYS = [
    "scans",
    "ospa_mean_m",
    "ospa2_mean_m",
    "gospa_mean_m",
    "cardinality_error_mean",
    "id_switches",
    "scan_ms_mean",
    "scan_ms_p99",
    "remarks",
]
SCANS = 30
MODEL = """
piecewise_accel_std_m_s2 = 5.0
survival_probability = 0.99
detection_probability = 0.95
clutter_per_scan = 10.0
noise_std_m = 10.0
region_m = [-500.0, -500.0, 500.0, 500.0]
scans = 30
[[births]]
x_m = -300.0
y_m = 0.0
std_m = 10.0
speed_std_m_s = 10.0
probability = 0.03
[[births]]
x_m = 0.0
y_m = 300.0
std_m = 10.0
speed_std_m_s = 10.0
probability = 0.03
"""


def made(seed=1, scans=SCANS):
    """Arrays as in the shared sets: two objects, the second from scan 8 to 22 alone."""
    rng = np.random.default_rng(seed)
    truth, meas = [], []
    for k in range(1, scans + 1):
        here = [(1, -300.0 + 15.0 * k, 15.0, 2.0 * k, 2.0)]
        if 8 <= k <= 22:
            here.append((2, 3.0 * (k - 8), 3.0, 300.0 - 12.0 * (k - 8), -12.0))
        truth += [(k, *row) for row in here]
        seen = [(k, row[1] + rng.normal(0, 10), row[3] + rng.normal(0, 10), row[0]) for row in here]
        meas += [row for row in seen if rng.random() < 0.95]
        meas += [(k, *rng.uniform(-500, 500, 2), 0.0) for _ in range(rng.poisson(10))]
    return {
        "truth": np.array(truth),
        "meas": rng.permutation(np.array(meas)),
        "F": np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]]),
        "sigma_v": 5.0,
        "sigma_z": 10.0,
        "pS": 0.99,
        "pD": 0.95,
        "lambda_c": 10.0,
        "region": np.array([[-500.0, 500.0], [-500.0, 500.0]]),
        "birth_mean": np.array([[-300.0, 0.0, 0.0, 0.0], [0.0, 0.0, 300.0, 0.0]]),
        "birth_std": np.full(4, 10.0),
        "r_birth": 0.03,
        "K": scans,
    }


@pytest.fixture
def files(tmp_path):
    arrays = made()
    np.savez(tmp_path / "set.npz", **arrays)
    np.savetxt(tmp_path / "set.csv", arrays["meas"], "%.10g", ",", header="k,x,y,src")
    np.savetxt(tmp_path / "truth.csv", arrays["truth"], "%.10g", ",", header="k,id,px,vx,py,vy")
    (tmp_path / "model.toml").write_text(MODEL)
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(app, ["track", *map(str, arguments)])


def scores(*arguments):
    done = run(*arguments, "--json")
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout.splitlines()[-1])
    assert list(result) == KEYS
    return result


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
    recovered = scores(files / "set.npz", "--estimator", "recovered")["ospa_mean_m"]
    at_once, soon, late, all_ = (
        scores(files / "set.npz", *smoothed, *lag)["ospa_mean_m"]
        for lag in (("--lag-scans", 0), ("--lag-scans", 2), ("--lag-scans", 99), ())
    )
    assert at_once == pytest.approx(recovered)
    assert all_ == pytest.approx(late)
    assert all_ < soon < at_once
    refused = run(files / "set.npz", "--lag-scans", 2)
    assert refused.exit_code
    assert "--estimator smoothed" in " ".join(refused.output.split())


def test_who_appears_between_two_scans_has_moved_on_by_the_second(files):
    (files / "fast.toml").write_text(
        MODEL.replace("scans = 30", "scans = 30\ndt_s = 2.0").replace(
            "y_m = 300.0", "y_m = 300.0\nvx_m_s = 9.0"
        )
    )
    birth = load(files / "set.csv", files / "fast.toml", None).births[1]
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


@pytest.mark.parametrize("name", ["set.npz", "set.csv"])
def test_baselines_are_scored_with_the_tracker(files, name):
    arguments = [files / name, "--model", files / "set.npz", "--truth", files / "truth.csv"]
    for estimator in ("filtered", "smoothed"):
        found = {}
        for baseline in ("nearest", "true-association"):
            done = run(*arguments, "--estimator", estimator, "--baseline", baseline, "--json")
            assert done.exit_code == 0, done.output
            result = json.loads(done.stdout.splitlines()[-1])
            assert list(result) == [*KEYS, "baseline"]
            assert result["baseline"]["name"] == baseline
            assert list(result["baseline"]) == ["name", *KEYS[:-1]]
            assert baseline in done.stderr
            found[baseline], ours = result["baseline"], result
        assert found["true-association"]["ospa_mean_m"] < ours["ospa_mean_m"]
        assert ours["ospa_mean_m"] < found["nearest"]["ospa_mean_m"]


def test_true_association_is_refused_without_the_origins_of_detections(files):
    (files / "bare.csv").write_text("k,x,y\n1,2.0,3.0\n")
    done = run(files / "bare.csv", "--model", files / "model.toml", "--baseline", "true-association")
    assert done.exit_code == 2
    assert "bare.csv: src: is missing" in " ".join(done.stderr.split())


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
    (files / "mission.toml").write_text(read_text("prescribed")[0])
    arrays = made()
    np.savez(files / "order.npz", **{**arrays, "F": np.kron([[1.0, 1.0], [0.0, 1.0]], np.eye(2))})
    del arrays["sigma_v"]
    np.savez(files / "bare.npz", **arrays)
    done = run(*arguments)
    assert done.exit_code == 2, done.output
    assert said in " ".join(done.stderr.split())


ROWS = st.lists(
    st.tuples(st.integers(0, 12), st.floats(allow_nan=True), st.floats(allow_nan=True)),
    min_size=1,
    max_size=30,
)


@settings(max_examples=25, deadline=None)
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


ANYWHERE = MODEL.split("[[births]]")[0] + "[anywhere]\nper_s = 0.1\n"


def test_without_places_of_birth_objects_are_found_where_they_appear(tmp_path):
    arrays, model = made(), tmp_path / "model.toml"
    np.savez(tmp_path / "set.npz", **{name: arrays[name] for name in ("meas", "truth")})
    model.write_text(ANYWHERE, encoding="utf-8")
    result = CliRunner().invoke(app, ["track", str(tmp_path / "set.npz"), "--model", str(model), "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.output.strip().splitlines()[-1])["cardinality_error_mean"] < 0.3


def test_a_model_without_births_is_refused_with_a_remedy(tmp_path):
    np.savez(tmp_path / "set.npz", meas=made()["meas"])
    (tmp_path / "model.toml").write_text(MODEL.split("[[births]]")[0], encoding="utf-8")
    done = run(tmp_path / "set.npz", "--model", tmp_path / "model.toml")
    assert done.exit_code == 2
    assert "anywhere.per_s > 0" in " ".join(done.stderr.split())


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


RADARS = """
accel_psd_m2_s3 = 1.0
survival_probability = 0.99
[[sensors]]
name = "west"
kind = "range_bearing"
detection_probability = 0.9
clutter_per_scan = 5.0
x_m = -800.0
y_m = 0.0
range_std_m = 5.0
bearing_std_deg = 0.5
most_range_m = 2000.0
sector_centre_deg = 90.0
sector_width_deg = 120.0
[[sensors]]
name = "camera"
kind = "position"
detection_probability = 0.9
clutter_per_scan = 5.0
noise_std_m = 5.0
region_m = [0.0, -500.0, 500.0, 500.0]
field_of_view_m = [0.0, -500.0, 500.0, 500.0]
[[births]]
x_m = -300.0
y_m = 0.0
std_m = 10.0
speed_std_m_s = 20.0
probability = 0.03
"""


def seen_by_both(rng, bearing="bearing_deg", time="k"):
    """CSV of what a radar and a camera see of one object that flies into the camera's view; its truth."""
    unit = 180.0 / np.pi if bearing == "bearing_deg" else 1.0
    lines, truth = [f"{time},sensor,range_m,{bearing},x,y"], []
    for k in range(1, 41):
        x, y = -315.0 + 15.0 * k, 2.0 * k
        truth.append((k, 1, x, 15.0, y, 2.0))
        seen = [(np.hypot(x + 800.0, y), np.arctan2(x + 800.0, y))] if rng.random() < 0.9 else []
        clutter = zip(rng.uniform(0, 2000, 5), rng.uniform(np.pi / 6, 5 * np.pi / 6, 5), strict=True)
        polar = [(r + rng.normal(0, 5), b + rng.normal(0, 0.0087)) for r, b in seen] + list(clutter)
        lines += [f"{k},west,{r:.3f},{b * unit:.5f},," for r, b in polar] or [f"{k},west,,,,"]
        places = [(x + rng.normal(0, 5), y + rng.normal(0, 5))] if x > 0 and rng.random() < 0.9 else []
        places += [(rng.uniform(0, 500), rng.uniform(-500, 500)) for _ in range(5)]
        lines += [f"{k},camera,,,{a:.3f},{b:.3f}" for a, b in places]
    return "\n".join(lines) + "\n", np.array(truth)


@pytest.fixture
def radars(tmp_path):
    text, truth = seen_by_both(np.random.default_rng(3))
    (tmp_path / "set.csv").write_text(text)
    (tmp_path / "model.toml").write_text(RADARS)
    np.savez(tmp_path / "truth.npz", truth=truth)
    return tmp_path


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
