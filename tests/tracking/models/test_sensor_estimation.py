"""A wrongly announced sensor misleads every decision: the operator must be warned, once."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.model import NS_PER_S, Polar, Sensor
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams
from gcs.tracking.models.sensor_estimation import MIN_MISSED_PER_S, SensorEstimation
from gcs.tracking.models.sensor_geometry import polar_sensor

SIDE_M = 1000.0


def sensor(p_d=0.9, clutter=10.0):
    return Sensor("radar", p_d, clutter / SIDE_M**2, np.eye(2) * 9.0, (0.0, 0.0, SIDE_M, SIDE_M))


def findings(announced, p_d, clutter, scans, seed=0, calibration=None):
    """What is found in a stream of Poisson clutter and eight objects in view."""
    rng = np.random.default_rng(seed)
    calibration = calibration or SensorEstimation()
    found = []
    for _ in range(scans):
        calibration.add_scan(float(rng.poisson(clutter)), float(rng.binomial(8, p_d)), 8.0)
        found += calibration.findings(announced)
    return found, calibration


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize(("p_d", "clutter"), [(0.9, 10.0), (0.98, 0.1), (0.6, 200.0)])
def test_a_correctly_announced_sensor_is_never_reported(seed, p_d, clutter):
    assert findings(sensor(p_d, clutter), p_d, clutter, 500, seed)[0] == []


@pytest.mark.parametrize(
    ("p_d", "clutter", "quantity", "announced"),
    [
        (0.9, 40.0, "clutter", 10.0),
        (0.9, 2.0, "clutter", 10.0),
        (0.6, 10.0, "detection", 0.9),
    ],
)
def test_a_contradiction_is_reported_once_and_ended_once(p_d, clutter, quantity, announced):
    found, calibration = findings(sensor(), p_d, clutter, 300)
    (finding,) = found
    assert finding[:2] == (quantity, True)
    assert finding.announced == pytest.approx(announced)
    assert finding.estimated == pytest.approx(clutter if quantity == "clutter" else p_d, rel=0.3)
    found, _ = findings(sensor(), 0.9, 10.0, 600, 1, calibration)
    assert [one.is_contradiction for one in found] == [False]


def test_a_stream_at_the_edge_does_not_flap():
    for clutter in (15.0, 20.0):
        found, _ = findings(sensor(), 0.9, clutter, 3000)
        assert len(found) <= 2


def test_a_corrected_sensor_has_the_estimated_rates():
    _, calibration = findings(sensor(), 0.6, 40.0, 500)
    corrected = calibration.corrected(sensor())
    assert corrected.detection_probability == pytest.approx(0.6, abs=0.05)
    assert corrected.clutter_density_per_m2 * SIDE_M**2 == pytest.approx(40.0, rel=0.12)
    fresh = SensorEstimation().corrected(sensor())
    assert (fresh.detection_probability, fresh.clutter_density_per_m2) == (0.9, 10.0 / SIDE_M**2)


def test_a_corrected_radar_keeps_its_geometry_and_gets_its_clutter():
    radar = polar_sensor("r", 0.9, Polar(0.0, 0.0, 5.0, 0.01, (0.0, 1000.0), (0.0, 0.5), 0.01))
    _, calibration = findings(radar, 0.9, 40.0, 500)  # announced: 0.01 x 1000 x 1
    corrected = calibration.corrected(radar)
    assert corrected.polar.clutter_per_m_rad == pytest.approx(0.04, rel=0.12)
    assert corrected.polar.range_m == radar.polar.range_m


@pytest.mark.parametrize(("p_d", "clutter"), [(0.9, 10.0), (0.6, 10.0), (0.9, 40.0)])
def test_a_detection_summary_estimates_the_true_sensor(p_d, clutter):
    """Announced 0.9 and 10; the truth is another. Estimated through the tracker, not from the truth."""
    rng = np.random.default_rng(4)
    detector = sensor()
    calibration = SensorEstimation()
    tracker = Glmb("targets", GlmbParams(accel_psd_m2_s3=0.25), 1, summarise_detections=True)
    places = rng.uniform(200.0, 800.0, (8, 2))
    for k in range(150):
        r = 0.02 if k < 5 else 1e-4  # as of places that have given their object
        births = [Birth(np.array([*p, 0.0, 0.0]), np.diag([25.0, 25.0, 4.0, 4.0]), r) for p in places]
        z = places[rng.random(8) < p_d]
        z = np.vstack([z + rng.normal(0, 3.0, z.shape), rng.uniform(0, SIDE_M, (rng.poisson(clutter), 2))])
        tracker.update(k * NS_PER_S, z, detector, births)
        account = tracker.detection_summary
        calibration.add_scan(float((1.0 - account.explained).sum()), account.detected, account.in_view)
    corrected = calibration.corrected(detector)
    assert corrected.detection_probability == pytest.approx(p_d, abs=0.13)  # the announced value still counts
    assert corrected.clutter_density_per_m2 * SIDE_M**2 == pytest.approx(clutter, rel=0.15)


def test_misses_of_one_sensor_count_no_more_the_more_often_it_scans():
    """Ten scans a second with a detection probability of 0.99 told of an end 1e20 to 1."""
    for period_s in (1.0, 0.5, 0.1, 0.01):
        estimation = SensorEstimation()
        missed = 1.0
        for scan in range(round(10.0 / period_s)):
            t_ns = round(scan * period_s * NS_PER_S)
            missed *= 1.0 - estimation.bounded(sensor(p_d=1.0), t_ns).detection_probability
        assert math.log(missed) >= (10.0 + 1.0) * math.log(MIN_MISSED_PER_S)


def test_misses_where_another_sensor_looks_count_half_as_much_until_it_is_silent_or_looks_away():
    other = SensorEstimation()
    other.bounded(sensor(), 0)
    elsewhere = replace(sensor(), field_of_view_m=(-500.0, 0.0, -1.0, 1000.0))
    assert other.looks_there(sensor(), 5 * NS_PER_S)
    assert not other.looks_there(sensor(), 6 * NS_PER_S)
    assert not other.looks_there(elsewhere, 0)
    alone, shared = (
        SensorEstimation().bounded(sensor(p_d=1.0), 0, is_shared=is_shared).detection_probability
        for is_shared in (False, True)
    )
    assert (1.0 - shared) ** 2 == pytest.approx(1.0 - alone)


def test_a_sensor_with_usual_misses_is_taken_as_it_announces_itself():
    for announced, period_s in ((0.98, 1.0), (0.9, 0.5)):
        estimation = SensorEstimation()
        for scan in range(5):
            t_ns = round(scan * period_s * NS_PER_S)
            bounded = estimation.bounded(sensor(p_d=announced), t_ns)
            assert bounded.detection_probability == announced
