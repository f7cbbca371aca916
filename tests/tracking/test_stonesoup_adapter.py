"""A user of Stone Soup runs our tracker in their framework and scores both sides by both kinds of metrics."""

import datetime
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stonesoup")

from stonesoup.dataassociator.tracktotrack import TrackToTruth
from stonesoup.measures import Euclidean
from stonesoup.metricgenerator.manager import MultiManager
from stonesoup.metricgenerator.ospametric import OSPAMetric
from stonesoup.metricgenerator.tracktotruthmetrics import SIAPMetrics
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
from stonesoup.tracker.base import Tracker
from stonesoup.types.detection import Detection
from stonesoup.types.state import State

from gcs.tracking import (
    GlmbParams,
    Sensor,
    TrackingModel,
    Trajectory,
    linear_measurement,
    ospa,
    track,
    track_scans,
)
from gcs.tracking.stonesoup_adapter import (
    StoneSoupTracker,
    positions_m,
    t_ns_of,
    time_of,
    to_arrays,
    to_detections,
    to_ground_truth,
    to_scans,
    to_tracks,
)

RADAR = Sensor("radar", 0.95, 10 / 2000**2, 5.0**2 * np.eye(2), (-1000.0, -1000.0, 1000.0, 1000.0))
MODEL = TrackingModel(GlmbParams(accel_psd_m2_s3=1.0), births_per_s=0.2, birth_speed_std_m_s=20.0)
POSITIONS = LinearGaussian(4, (0, 2), 25.0 * np.eye(2))
TIMES_S = 1e9 + np.arange(30.0)
TRUTH = [{"a": np.array([-800 + 20 * k, 3 * k]), "b": np.array([5 * k, 800 - 20 * k])} for k in range(30)]


@pytest.fixture(scope="module")
def scans():
    rng = np.random.default_rng(1)
    return [
        np.vstack([rng.normal(list(at.values()), 5.0), rng.uniform(-1000.0, 1000.0, (rng.poisson(10), 2))])
        for at in TRUTH
    ]


def test_our_tracker_runs_as_theirs_and_gives_the_same_estimates(scans):
    tracker = StoneSoupTracker(to_detections(scans, TIMES_S, POSITIONS), RADAR, MODEL)
    assert isinstance(tracker, Tracker)
    times, shown, seen = [], [], set()
    for time, tracks in tracker:
        times.append(time)
        shown.append({one.id: one.state_vector for one in tracks})
        seen |= tracks
    ours = track(*to_arrays(to_detections(scans, TIMES_S)), RADAR, MODEL, "filtered")
    assert [t_ns_of(time) for time in times] == ours.t_ns.tolist()
    assert tracker.tracks == {one for one in seen if one.timestamp == times[-1]}
    for at, found in zip(shown, ours.positions_m(), strict=True):
        assert {f"{k}.{i}" for k, i in found} == at.keys()
        for (k, i), place in found.items():
            np.testing.assert_array_equal(at[f"{k}.{i}"][[0, 2], 0], place)


def test_detections_go_there_and_back(scans):
    back, times_s = to_arrays(to_detections(scans, TIMES_S, POSITIONS))
    np.testing.assert_array_equal(times_s, TIMES_S)
    for sent, found in zip(scans, back, strict=True):
        np.testing.assert_array_equal(found, sent[np.lexsort(sent.T[::-1])])


def test_ranges_and_bearings_become_positions():
    model = CartesianToBearingRange(4, (0, 2), np.diag([1e-6, 1e-2]))
    time = time_of(0)
    vector = model.function(State([300.0, 0.0, 400.0, 0.0], time), noise=False)
    ((z_m,), _) = to_arrays([(time, {Detection(vector, timestamp=time, measurement_model=model)})])
    np.testing.assert_allclose(z_m, [[300.0, 400.0]])


def test_a_detection_of_another_kind_is_refused_in_words():
    time = time_of(0)
    with pytest.raises(ValueError, match=r"expected a position of shape \(2, 1\), x and y; got \(3, 1\)"):
        to_arrays([(time, {Detection([[1.0], [2.0], [3.0]], timestamp=time)})])


def test_their_metrics_score_our_tracks_as_our_metric_does(scans):
    ours = track(scans, TIMES_S, RADAR, MODEL)
    tracks, truth = to_tracks(ours), to_ground_truth(TRUTH, TIMES_S)
    generators = [
        OSPAMetric(
            c=100.0, p=1, generator_name="ospa", tracks_key="tracks", truths_key="truth",
            measure=Euclidean([0, 2], [0, 1]),
        ),
        SIAPMetrics(
            Euclidean([0, 2], [0, 1]), Euclidean([1, 3], [0, 1]),
            generator_name="siap", tracks_key="tracks", truths_key="truth",
        ),
    ]  # fmt: skip
    manager = MultiManager(generators, TrackToTruth(50.0, measure=Euclidean([0, 2], [0, 1])))
    manager.add_data({"tracks": tracks, "truth": truth}, overwrite=False)
    scores = manager.generate_metrics()
    theirs = [one.value for one in scores["ospa"]["OSPA distances"].value]
    mine = [
        ospa(np.reshape(list(x.values()), (-1, 2)), np.array(list(y.values()))).total_m
        for x, y in zip(ours.positions_m(), TRUTH, strict=True)
    ]
    np.testing.assert_allclose(theirs, mine, rtol=1e-6)
    assert scores["siap"]["SIAP Completeness"].value > 0.9


def collected(ages_s, minutes=8):
    """Two ships at 8 m/s report once a minute, each so long before the minute's end."""
    for minute in range(1, minutes):
        time = time_of(minute * 60 * 10**9)
        found = set()
        for north_m, age_s in zip((0.0, 5000.0), ages_s, strict=True):
            at = time - datetime.timedelta(seconds=age_s)
            east_m = 8.0 * (minute * 60.0 - age_s)
            found.add(Detection([[east_m], [north_m]], timestamp=at, measurement_model=POSITIONS))
        yield time, found


def test_reports_that_were_collected_for_a_minute_count_at_their_own_times():
    """Taken at the end of the minute, ships would be shown where they were up to 400 m before."""
    radar = Sensor("ais", 0.9, 1e-12, 25.0 * np.eye(2), (-1e4, -1e4, 1e4, 1e4))
    model = replace(MODEL, params=GlmbParams(accel_psd_m2_s3=0.01, survival_probability_per_s=0.9999))
    (*_, (time, tracks)) = StoneSoupTracker(collected((50.0, 5.0)), radar, model)
    found = sorted((one.state_vector[2, 0], one.state_vector[0, 0]) for one in tracks)
    east_m = 8.0 * t_ns_of(time) / 1e9
    np.testing.assert_allclose(found, [[0.0, east_m], [5000.0, east_m]], atol=40.0)


@pytest.mark.parametrize("density", [0.01, lambda z: np.full(len(z), 0.01)])
def test_the_parts_of_a_set_share_clutter_and_detection_probability(density):
    ais = Sensor("ais", 0.9, 0.01, np.eye(2), (-1e4, -1e4, 1e4, 1e4))
    parts = to_scans(collected((50.0, 5.0), minutes=2), ais)
    assert [scan.t_ns / 1e9 for scan in parts] == [10.0, 55.0, 60.0]
    undetected = [1.0 - scan.sensor.detection_probability for scan in parts]
    assert np.prod(undetected) == pytest.approx(0.1)
    assert [scan.sensor.clutter_density_per_m2 for scan in parts[:2]] == [0.005, 0.005]
    own = replace(linear_measurement("ais", 0.9, 0.01, np.eye(2, 4), np.eye(2)), clutter_density=density)
    share = to_scans(collected((50.0, 5.0), minutes=2), own)[0].sensor.clutter_density
    assert (share(np.zeros((1, 2)))[0] if callable(share) else share) == 0.005


def test_scans_of_a_detector_are_tracked_as_its_arrays_are_by_default(scans):
    detector = to_detections(scans, TIMES_S)
    found = track_scans(to_scans(detector, RADAR), MODEL).trajectories
    expected = track(*to_arrays(detector), RADAR, MODEL).trajectories
    assert len(found) == len(expected) >= 2
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.mean, other.mean)


def test_a_gap_in_a_trajectory_makes_two_tracks_of_one_id():
    whole = track([], [], RADAR, MODEL)
    t_ns = np.arange(4) * 10**9
    one = Trajectory((1, 0), t_ns[[0, 1, 3]], np.zeros((3, 4)), np.zeros((3, 4, 4)), np.ones(3))
    tracks = to_tracks(replace(whole, t_ns=t_ns, trajectories=(one,)))
    assert sorted(len(part) for part in tracks) == [1, 2]
    assert {part.id for part in tracks} == {"1.0"}


def test_their_tracks_and_truth_feed_our_metrics(scans):
    ours = track(scans, TIMES_S, RADAR, MODEL)
    times = [time_of(t_ns) for t_ns in ours.t_ns.tolist()]
    for at, found in zip(positions_m(to_tracks(ours), times), ours.positions_m(), strict=True):
        assert sorted(map(tuple, at.values())) == sorted(map(tuple, found.values()))
    back = positions_m(to_ground_truth(TRUTH, TIMES_S), times, mapping=(0, 1))
    for at, objects in zip(back, TRUTH, strict=True):
        assert {name: place.tolist() for name, place in at.items()} == {
            name: place.tolist() for name, place in objects.items()
        }


def test_times_are_kept_to_the_microsecond():
    time = datetime.datetime(2026, 11, 26, 6, 30, 0, 123456)  # noqa: DTZ001
    assert time_of(t_ns_of(time)) == time
