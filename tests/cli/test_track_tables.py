"""Tables that others write for `gcs track`: found by their titles or refused, never misread."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.io.detections.track_input import load

MODEL = """
accel_psd_m2_s3 = 4.0
survival_probability = 0.99
detection_probability = 0.95
clutter_per_scan = 1.0
noise_std_m = 5.0
region_m = [-500.0, -500.0, 500.0, 500.0]
[anywhere]
per_s = 0.1
"""
SCANS = 12
PATH_M = np.column_stack([20.0 * np.arange(SCANS), 100.0 - 10.0 * np.arange(SCANS)])


def table(titles, rows):
    return "\n".join([titles, *(",".join(map(str, row)) for row in rows)]) + "\n"


SET = table("k,x,y", [(k, *xy) for k, xy in enumerate(PATH_M, 1)])
TRUTH = table("k,id,x,y", [(k, 1, *xy) for k, xy in enumerate(PATH_M, 1)])


@pytest.fixture
def tracked(tmp_path, monkeypatch):
    """Run the command on a table, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.toml").write_text(MODEL)

    def run(detections=SET, truth=None, *arguments, model=None):
        (tmp_path / "set.csv").write_text(detections)
        (tmp_path / "model.toml").write_text(model or MODEL)
        words = ["set.csv", "--model", "model.toml", "--json"]
        if truth is not None:
            (tmp_path / "truth.csv").write_text(truth)
            words += ["--truth", "truth.csv"]
        return CliRunner().invoke(app, ["track", *words, *arguments])

    return run


def test_a_column_of_log_ratios_says_which_detections_are_faint(tracked):
    """Clutter as near as the object, that its amplitude gives away."""
    near = np.tile(PATH_M, (3, 1)) + np.random.default_rng(1).normal(0.0, 25.0, (3 * SCANS, 2))
    rows = [(k, *xy, 3.0) for k, xy in enumerate(PATH_M, 1)]
    rows += [(1 + i % SCANS, *xy, -8.0) for i, xy in enumerate(near)]
    told = scores(tracked(table("k,x,y,log_ratio", rows), TRUTH))
    untold = scores(tracked(table("k,x,y,height", rows), TRUTH))
    assert told["ospa_mean_m"] < 0.8 * untold["ospa_mean_m"]


def scores(done):
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout.splitlines()[-1])


def refused(done):
    assert done.exit_code == 2, done.output
    return " ".join(done.stderr.split())


SAME = {
    "columns in another order": table("k,y,x", [(k, y, x) for k, (x, y) in enumerate(PATH_M, 1)]),
    "a column between": table("k,id,x,y", [(k, 7, *xy) for k, xy in enumerate(PATH_M, 1)]),
    "titles in a comment": "# " + SET,
    "remarks and an empty line above": "# flown on Monday\n\n" + SET,
    "titles in quotes": SET.replace("k,x,y", '"k","x","y"'),
    "a byte order mark": "\ufeff" + SET,
}


@pytest.mark.parametrize("how", SAME)
def test_the_same_detections_are_read_however_their_table_is_written(tmp_path, how):
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "set.csv").write_text(SAME[how], encoding="utf-8")
    scans = load(tmp_path / "set.csv", tmp_path / "model.toml", None).scans
    np.testing.assert_array_equal(np.concatenate([scan.z_m for scan in scans]), PATH_M)


def times(title, unit):
    return table(f"{title},x,y", [(k * unit, *xy) for k, xy in enumerate(PATH_M, 1)])


MISREAD = {
    "an empty file": ("", "set.csv: titles: are missing; expected k, t_s or t_ns first"),
    "no titles": (SET.split("\n", 1)[1], "found 1,0.0,100.0: rename the columns in the first line"),
    "titles alone": ("k,x,y\n", "holds no scan"),
    "a time that is not called so": (times("time", 0.5), "k, t_s or t_ns first; x and y, or range_m"),
    "a place first": (SET.replace("k,x,y", "x,y,k"), "found x,y,k: rename the columns"),
    "no place": (SET.replace("k,x,y", "k,lat,lon"), "found k,lat,lon: rename the columns in the first line"),
    "times for numbers": (times("k", 0.5), "has the title t_s or t_ns"),
    "seconds for nanoseconds": (times("t_ns", 1), "t_ns: expected nanoseconds; all scans lie within 11 ns"),
    "decimal commas": (
        "k;x;y\n1;10,5;20,5\n",
        "found k;x;y: rename",
    ),
    "fewer cells than titles": (
        SET.replace("k,x,y", "k,x,y,src"),
        "line 2: expected 4 numbers, as the titles k,x,y,src say",
    ),
}


@pytest.mark.parametrize("case", MISREAD)
def test_a_table_that_would_be_misread_is_refused(tracked, case):
    text, said = MISREAD[case]
    assert said in refused(tracked(text))


TRUTHS = {
    "as the estimates are written": table(
        "k,label,x,y,vx,vy,existence", [(k, 1, *xy, 20, -10, 1) for k, xy in enumerate(PATH_M, 1)]
    ),
    "states": table("k,id,px,vx,py,vy", [(k, 1, x, 20, y, -10) for k, (x, y) in enumerate(PATH_M, 1)]),
    "names that are words": TRUTH.replace(",1,", ",plane-a,"),
}


@pytest.mark.parametrize("how", TRUTHS)
def test_the_truth_judges_the_same_however_its_table_is_written(tracked, how):
    assert scores(tracked(SET, TRUTHS[how])) | {"scan_ms_mean": 0, "scan_ms_p99": 0} == scores(
        tracked(SET, TRUTH)
    ) | {"scan_ms_mean": 0, "scan_ms_p99": 0}


def test_truth_with_times_judges_the_scans_of_these_times(tracked):
    when = np.cumsum(np.random.default_rng(2).uniform(0.3, 0.9, SCANS)).round(3) + 1.7e9
    path = PATH_M[0] + np.outer(when - when[0], [20.0, -10.0])
    detections = table("t_s,x,y", [(f"{t:.3f}", *xy) for t, xy in zip(when, path, strict=True)])
    rows = [(f"{t:.3f}", "a", *xy) for t, xy in zip(when, path, strict=True)]
    result = scores(tracked(detections, table("t_s,id,x,y", rows)))
    assert result["scans"] == SCANS
    assert result["cardinality_error_mean"] <= 2 / SCANS
    assert result["remarks"] == []
    later = table("t_s,id,x,y", [*rows[3:], ("1.0", "a", 0.0, 0.0)])
    later_scores = scores(tracked(detections, later))
    assert later_scores["cardinality_error_mean"] == 0.0
    assert "3 of 12 scans are not scored" in later_scores["remarks"][0]
    scores(tracked(detections, later, "-o", "found.csv"))
    written = csv.DictReader(Path("found.csv").read_text(encoding="utf-8").splitlines())
    found = {int(row["k"]): int(row["t_ns"]) for row in written}
    assert len(found) >= SCANS - 2
    assert all(abs(t_ns - round(when[k - 1] * 1e9)) < 1000 for k, t_ns in found.items())
    empty_scores = scores(
        tracked(detections, table("t_s,id,x,y", [(row[0], "", "", "") for row in rows[3:]]))
    )
    assert empty_scores["cardinality_error_mean"] == 1.0


BAD_TRUTHS = {
    "an object twice": (TRUTH + "3,1,0.0,0.0\n", "truth.csv: id: '1' is in scan 3 twice"),
    "half a scan": (TRUTH.replace("\n3,", "\n3.5,"), "k: expected whole scan numbers from 0 to"),
    "names first": (TRUTH.replace("k,id", "id,k"), "expected k, t_s or t_ns first; id or label"),
    "no place": (TRUTH.replace("x,y", "east,north"), "found k,id,east,north: rename"),
    "a place that is none": (TRUTH.replace("20.0,", "inf,", 1), "x,y: expected it in each row"),
    "other scans": (TRUTH.replace("\n", "\n10"), "its scans 101 to 1012 are none of those of set.csv"),
    "times that are none of these": (TRUTH.replace("k,", "t_s,").replace("\n", "\n9"), "t_s: no scan of"),
    "nothing": ("", "truth.csv: titles: are missing"),
}


@pytest.mark.parametrize("case", BAD_TRUTHS)
def test_a_truth_that_would_judge_wrongly_is_refused(tracked, case):
    text, said = BAD_TRUTHS[case]
    text = text.removesuffix("\n10").removesuffix("\n9")
    assert said in refused(tracked(SET, text))


def test_estimates_never_replace_their_source(tracked, tmp_path):
    for name in ("set.csv", "./truth.csv", "model.toml"):
        assert "as well; expected another file" in refused(tracked(SET, TRUTH, "-o", name))
    assert (tmp_path / "set.csv").read_text() == SET
    assert "is -o as well" in refused(tracked(SET, TRUTH, "-o", "a.png", "--plot", "a.png"))


DOUBTFUL = MODEL.replace("1.0\nnoise", "5.0\nnoise")
CLUTTER_M = np.random.default_rng(5).uniform(-500, 500, (60, 2))


@pytest.mark.parametrize(
    ("scale", "said"),
    [
        (1.0, None),
        (1e-3, "are they in metres?"),
        (1e3, "lie outside region_m"),
        (25.4, "lie outside region_m"),
    ],
)
def test_detections_in_another_unit_are_doubted(tracked, scale, said):
    rows = [(1 + i // 5, *(scale * xy)) for i, xy in enumerate(CLUTTER_M)]
    remarks = scores(tracked(table("k,x,y", rows), model=DOUBTFUL))["remarks"]
    assert [said in text for text in remarks] == ([] if said is None else [True])


@pytest.mark.parametrize("probability", [0.95, 1.0])
def test_a_world_without_clutter_and_misses_is_tracked(tracked, probability):
    model = MODEL.replace("clutter_per_scan = 1.0", "clutter_per_scan = 0.0")
    model = model.replace("probability = 0.95", f"probability = {probability}")
    assert scores(tracked(SET, TRUTH, model=model))["cardinality_error_mean"] <= 1 / SCANS


RADAR = """
accel_psd_m2_s3 = 4.0
survival_probability = 0.99
[anywhere]
per_s = 0.1
[[sensors]]
name = "radar"
kind = "range_bearing"
detection_probability = 0.9
clutter_per_scan = 5.0
x_m = 0.0
y_m = 0.0
range_std_m = 5.0
bearing_std_deg = 0.5
most_range_m = 500.0
sector_width_deg = 90.0
"""


def test_bearings_in_another_unit_or_from_another_zero_are_noticed(tracked):
    rng = np.random.default_rng(6)
    polar = [(1 + i // 5, rng.uniform(0, 500), rng.uniform(-45, 45)) for i in range(60)]
    assert scores(tracked(table("k,range_m,bearing_deg", polar), model=RADAR))["remarks"] == []
    assert "are they in its unit" in refused(tracked(table("k,range_m,bearing_rad", polar), model=RADAR))
    from_east = [(k, r, 180.0 - b) for k, r, b in polar]
    remarks = scores(tracked(table("k,range_m,bearing_deg", from_east), model=RADAR))["remarks"]
    assert "60 of 60 detections of radar lie outside its field of view" in remarks[0]
