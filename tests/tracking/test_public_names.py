"""A researcher imports from the package, and does not wait for the compiler before the first tracker."""

import subprocess
import sys

import numpy as np
import pytest

import gcs.tracking
from gcs.tracking import Birth, Glmb, GlmbParams, Sensor, TrackingModel, gospa, ospa, track

PUBLIC = """Birth Estimates Estimator Glmb GlmbParams MeasurementModel MotionModel Polar Sensor SensorScan
StateSpaceGlmb SwitchingMotion TrackSet TrackingModel Trajectory cardinality_error constant_velocity gospa
identity_switches linear_measurement linear_motion map_coordinates ospa ospa2 polar_sensor sector track
track_scans"""
RADAR = Sensor("radar", 0.95, 10 / 2000**2, 5.0**2 * np.eye(2), (-1000.0, -1000.0, 1000.0, 1000.0))
MODEL = TrackingModel(GlmbParams(accel_psd_m2_s3=1.0), births_per_s=0.2, birth_speed_std_m_s=20.0)
STARTS = np.array([[-800.0, 0.0], [0.0, 800.0]])
SPEEDS = np.array([[20.0, 3.0], [5.0, -20.0]])


def truth(k):
    return STARTS + k * SPEEDS


def made_scans(count=30, seed=1):
    rng = np.random.default_rng(seed)
    found = []
    for k in range(count):
        seen = truth(k)[rng.random(2) < 0.95]
        clutter = rng.uniform(-1000.0, 1000.0, (rng.poisson(10), 2))
        found.append(np.vstack([seen + rng.normal(0.0, 5.0, seen.shape), clutter]))
    return found


def test_the_public_names_are_these():
    assert gcs.tracking.__all__ == sorted(PUBLIC.split())
    assert all(getattr(gcs.tracking, name) is not None for name in gcs.tracking.__all__)


def test_the_package_alone_does_not_import_the_compiler():
    code = "import sys, gcs.tracking; from gcs.tracking import Birth, GlmbParams, Sensor, ospa;"
    code += "print([name for name in ('llvmlite', 'scipy') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("estimator", ["filtered", "recovered", "smoothed"])
def test_arrays_give_labelled_trajectories(estimator):
    found = track(made_scans(), np.arange(30.0), RADAR, MODEL, estimator)
    assert len(found) == 2 or estimator == "filtered"  # which shows clutter now and then
    for one in sorted(found.trajectories, key=lambda one: one.t_ns.size)[-2:]:
        n = len(one.t_s)
        assert n >= 24
        assert (one.mean.shape, one.cov.shape, one.existence.shape) == ((n, 4), (n, 4, 4), (n,))
    errors = [
        ospa(np.reshape(list(at.values()), (-1, 2)), truth(k)).total_m
        for k, at in enumerate(found.positions_m())
    ]
    assert np.mean(errors[5:]) < 15.0


def test_the_trajectories_are_those_of_the_tracker_used_scan_by_scan():
    births = tuple(Birth(np.r_[at, 0.0, 0.0], np.diag([100.0, 100.0, 400.0, 400.0]), 0.02) for at in STARTS)
    model = TrackingModel(GlmbParams(accel_psd_m2_s3=1.0), births)
    tracker = Glmb("targets", model.params, seed=1)
    for k, z_m in enumerate(made_scans()):
        tracker.update(k * 10**9, z_m, RADAR, births)
    last = {track.label: track.mean for track in tracker.estimate()}
    found = track(made_scans(), np.arange(30.0), RADAR, model, "filtered")
    assert last.keys() == found.positions_m()[-1].keys()
    for one in found.trajectories:
        if one.label in last:
            np.testing.assert_array_equal(one.mean[-1], last[one.label])
    assert gospa(np.array(list(last.values()))[:, :2], truth(29)).missed == 0


@pytest.mark.parametrize("lag", [0, 3])
def test_estimates_with_a_lag_use_no_later_detection(lag):
    scans = made_scans()
    whole = track(scans, np.arange(30.0), RADAR, MODEL, lag_scans=lag).positions_m()
    for k in (4, 9, 17, 24):
        known = track(scans[: k + lag + 1], np.arange(k + lag + 1.0), RADAR, MODEL, lag_scans=lag)
        at = known.positions_m()[k]
        assert at.keys() == whole[k].keys()
        assert all(at[label].tolist() == whole[k][label].tolist() for label in at)


def test_a_longer_lag_is_more_accurate_than_filtering():
    def error_m(**how):
        at = track(made_scans(), np.arange(30.0), RADAR, MODEL, **how).positions_m()
        points = [np.reshape(list(found.values()), (-1, 2)) for found in at]
        return np.mean([ospa(found, truth(k)).total_m for k, found in enumerate(points)])

    assert error_m() <= error_m(lag_scans=3) < error_m(estimator="filtered")


def test_two_sensors_at_one_time_are_one_epoch():
    scans = [z_m for pair in zip(made_scans(seed=1), made_scans(seed=2), strict=True) for z_m in pair]
    west = Sensor("west", *[getattr(RADAR, name) for name in RADAR.__slots__[1:]])
    found = track(scans, np.repeat(np.arange(30.0), 2), [RADAR, west] * 30, MODEL)
    assert found.t_ns.size == 30
    assert len(found) == 2


WRONG = {
    "three columns": ({"scans": [np.zeros((4, 3))]}, "scans[0]: expected shape (m, 2), detections as east"),
    "a flat list": ({"scans": [[1.0, 2.0]]}, "scans[0]: expected shape (m, 2)"),
    "too few times": ({"times_s": []}, "times_s: expected shape (1,), one time in seconds for each"),
    "times as NaN": ({"times_s": [np.nan]}, "times_s: expected finite times in seconds that do not decrease"),
    "a sensor too many": ({"sensor": [RADAR, RADAR]}, "sensor: expected one, or one for each of 1 scans"),
    "noise as a number": (
        {"sensor": Sensor("x", 0.9, 1e-6, np.array(5.0), RADAR.field_of_view_m)},
        "noise_cov_m2 of sensor x: expected shape (2, 2)",
    ),
    "noise that is no covariance": (
        {"sensor": Sensor("x", 0.9, 1e-6, -np.eye(2), RADAR.field_of_view_m)},
        "noise_cov_m2 of sensor x: expected a positive definite matrix",
    ),
    "a detection probability in per cent": (
        {"sensor": Sensor("x", 95.0, 1e-6, np.eye(2), RADAR.field_of_view_m)},
        "detection_probability of sensor x: expected 0 to 1, got 95.0",
    ),
    "negative clutter": (
        {"sensor": Sensor("x", 0.9, -1e-6, np.eye(2), RADAR.field_of_view_m)},
        "clutter_density_per_m2 of sensor x: expected at least 0",
    ),
    "a field of view in another order": (
        {"sensor": Sensor("x", 0.9, 1e-6, np.eye(2), (-1000.0, 1000.0, -1000.0, 1000.0))},
        "field_of_view_m of sensor x: expected x_min, y_min, x_max, y_max",
    ),
    "no sensor": ({"sensor": [None]}, "sensor: expected Sensor or MeasurementModel, got None"),
    "a lag of filtered estimates": (
        {"estimator": "filtered", "lag_scans": 3},
        "lag_scans: expected at least 0",
    ),
    "no such estimator": ({"estimator": "best"}, "expected one of filtered, recovered, smoothed, got 'best'"),
}


@pytest.mark.parametrize("case", WRONG)
def test_an_argument_of_another_shape_is_refused_in_words(case):
    wrong, said = WRONG[case]
    arguments = {"scans": [np.empty((0, 2))], "times_s": [0.0], "sensor": RADAR, "model": MODEL} | wrong
    with pytest.raises(ValueError, match="expected") as raised:
        track(**arguments)
    assert said in str(raised.value)


def test_a_model_without_births_or_with_flat_ones_is_refused():
    with pytest.raises(ValueError, match="births: expected birth components, or births_per_s above 0"):
        TrackingModel(GlmbParams(accel_psd_m2_s3=1.0))
    with pytest.raises(ValueError, match=r"births\[0\].mean: expected shape \(4,\), x, y, vx, vy"):
        TrackingModel(GlmbParams(accel_psd_m2_s3=1.0), (Birth(np.zeros(2), np.eye(4), 0.1),))


def test_births_of_another_shape_are_refused_scan_by_scan():
    tracker = Glmb("targets", MODEL.params, seed=1)
    flat = (Birth(np.zeros(2), np.eye(2), 0.1), Birth(np.zeros(2), np.eye(2), 0.1))
    with pytest.raises(
        ValueError, match=r"births\[0\]: expected mean and cov of shapes \(\(4,\), \(4, 4\)\)"
    ):
        tracker.update(0, np.empty((0, 2)), RADAR, flat)


def test_an_empty_data_set_has_no_trajectories():
    found = track([], [], RADAR, MODEL)
    assert len(found) == 0
    assert all(len(column) == 0 for column in found.columns().values())


COLUMNS = ["k", "t_s", "label", "x", "y", "vx", "vy", "existence"]


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_trajectories_are_a_frame_of_pandas_and_polars(library):
    pytest.importorskip(library)
    found = track(made_scans(), np.arange(30.0), RADAR, MODEL)
    frame = getattr(found, f"to_{library}")()
    assert list(frame.columns) == COLUMNS
    assert len(frame) == sum(one.t_ns.size for one in found.trajectories)
    first = found.trajectories[0]
    rows = frame[frame["label"] == 1] if library == "pandas" else frame.filter(frame["label"] == 1)
    np.testing.assert_array_equal(rows["x"].to_numpy(), first.mean[:, 0])
    np.testing.assert_array_equal(rows["t_s"].to_numpy(), first.t_s)


def test_a_missing_library_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'swarm-gcs\[tables\]'"):
        track([], [], RADAR, MODEL).to_pandas()
