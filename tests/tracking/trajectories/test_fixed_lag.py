"""Late estimates of a tracker that runs are those of its whole histories, in bounded memory."""

import math

import numpy as np
import pytest

from gcs.model import NS_PER_S
from gcs.tracking import Birth, Glmb, GlmbParams, Sensor, ospa, polar_sensor, sector

FIELD_M = (-1000.0, -1000.0, 1000.0, 1000.0)
CAMERA = Sensor("camera", 0.9, 10 / 2000**2, 8.0**2 * np.eye(2), FIELD_M)
RADAR = polar_sensor("radar", 0.9, sector((0.0, -1500.0), (8.0, 0.4), (10.0, 3000.0), (0.0, 120.0), 10.0))
STARTS = np.array([[-600.0, 0.0, 20.0, 5.0], [0.0, 500.0, 10.0, -20.0]])
BIRTHS = tuple(Birth(one * [1, 1, 0, 0], np.diag([400.0, 400.0, 400.0, 400.0]), 0.05) for one in STARTS)
LAG = 4


def scans(count, clutter, seed=1):
    rng = np.random.default_rng(seed)
    for k in range(count):
        places = STARTS[:, :2] + k * STARTS[:, 2:]
        seen = places[rng.random(2) < 0.9]
        false = rng.uniform(-1000.0, 1000.0, (rng.poisson(clutter), 2))
        yield places, np.vstack([rng.normal(seen, 8.0), false])


@pytest.mark.parametrize("turn_rate_deg_s", [0.0, 5.0])
def test_late_estimates_are_those_of_smoothed_histories(turn_rate_deg_s):
    params = GlmbParams(2.0, turn_rate_std_rad_s=math.radians(turn_rate_deg_s), merge_chi2=0.0)
    tracker = Glmb("targets", params, 1, keep_histories=True, lag=LAG)
    compared = 0
    for k, (_, z) in enumerate(scans(25, 0)):
        # Two sensors at each time: they are one epoch.
        tracker.update(k * NS_PER_S, z, CAMERA, BIRTHS)
        tracker.update(k * NS_PER_S, z[:0], RADAR)
        late = tracker.lag_estimates()
        if k < LAG:
            assert late is None
            continue
        assert late.t_ns == (k - LAG) * NS_PER_S
        paths = {path.label: path for path in tracker.histories.paths(smooth=True) if path.alive}
        for label, mean, cov in zip(late.label.tolist(), late.mean, late.cov, strict=True):
            path = paths[tuple(label)]
            at = np.flatnonzero(path.t_ns == late.t_ns)[-1]
            np.testing.assert_allclose(mean, path.mean[at], atol=1e-6)
            np.testing.assert_allclose(cov, path.cov[at], rtol=1e-6, atol=1e-6)
            compared += 1
    assert compared > 30


@pytest.mark.parametrize("sensor", [CAMERA, RADAR], ids=["camera", "radar"])
def test_late_estimates_are_better_than_those_of_the_scan(sensor):
    tracker = Glmb("targets", GlmbParams(2.0), 1, lag=LAG)
    filtered, late, truths = [], [], []
    for k, (places, z) in enumerate(scans(40, 10)):
        tracker.update(k * NS_PER_S, z, sensor, BIRTHS)
        truths.append(places)
        now = tracker.estimates()
        filtered.append(ospa(now.mean[now.estimated, :2], places).total_m)
        then = tracker.lag_estimates()
        if then is not None:
            late.append(ospa(then.mean[:, :2], truths[k - LAG]).total_m)
    assert np.mean(late) < 0.7 * np.mean(filtered[: len(late)])


def test_an_object_is_there_from_its_first_detection_on():
    """One that appears at scan 10 is confirmed later; the late estimates have it at scan 10."""
    tracker = Glmb("targets", GlmbParams(2.0), 1, lag=LAG)
    rng = np.random.default_rng(1)
    shown_now, shown_late = [], []
    for k in range(25):
        here = [[-600.0 + 20.0 * (k - 10), 0.0]] if k >= 10 else np.empty((0, 2))
        z = np.vstack([rng.normal(here, 8.0), rng.uniform(-1000.0, 1000.0, (10, 2))])
        tracker.update(k * NS_PER_S, z, CAMERA, (Birth(BIRTHS[0].mean, BIRTHS[0].cov, 0.001),))
        now, then = tracker.estimates(), tracker.lag_estimates()
        shown_now += [k] * int(now.estimated.any())
        shown_late += [k - LAG] * (then is not None and len(then.label) > 0)
    assert shown_late[0] == 10 < shown_now[0]


def test_memory_is_that_of_the_lag():
    tracker = Glmb("targets", GlmbParams(2.0), 1, lag=LAG)
    for k, (_, z) in enumerate(scans(60, 10)):
        tracker.update(k * NS_PER_S, z, CAMERA, BIRTHS)
    assert len(tracker._fixed_lag._kept) == LAG + 1
