"""A baseline with a wrong gain or pairing would flatter the tracker that is compared with it."""

import numpy as np
import pytest
from baselines import NearestNeighbourTracker, TrueAssociationTracker

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb.params import Birth, GlmbParams

SENSOR = Sensor("s", 0.9, 1e-6, np.eye(2) * 4.0, (-1e3, -1e3, 1e3, 1e3))
BIRTH = Birth(np.zeros(4), np.diag([4.0, 4.0, 1.0, 1.0]), 0.1)
STILL = GlmbParams(accel_psd_m2_s3=1e-18)
"""Without process noise, each axis can be computed by hand."""


def scans(tracker, *detections, origins=None):
    for k, z in enumerate(detections):
        origin = () if origins is None else (np.array(origins[k], dtype=float),)
        tracker.update(k * NS_PER_S, np.reshape(np.array(z, dtype=float), (-1, 2)), SENSOR, (BIRTH,), *origin)
    return tracker


def test_two_scans_are_those_of_a_hand_computed_kalman_filter_and_smoother():
    # Birth: p 0 with variance 4, v 0 with variance 1. Detection 2 with variance 4: gain 1/2, p = 1 with 2.
    # Prediction by 1 s: variance [[3, 1], [1, 1]]. Detection 8: innovation 7 with variance 7, so p = 1 + 3
    # and v = 0 + 1. Smoother: gain [[2, 0], [1, 1]] inv([[3, 1], [1, 1]]) = [[1, -1], [0, 1]], so
    # p = 1 + 3 - 1 and v = 0 + 1.
    tracker = scans(NearestNeighbourTracker(STILL), (2, 0), (8, 0))
    (state,) = tracker.estimates().values()
    np.testing.assert_allclose(state, [4.0, 0.0, 1.0, 0.0], atol=1e-9)
    (filtered,) = tracker.paths()
    (smoothed,) = tracker.paths(smooth=True)
    np.testing.assert_allclose(filtered.mean[:, [0, 2]], [[1.0, 0.0], [4.0, 1.0]], atol=1e-9)
    np.testing.assert_allclose(smoothed.mean[:, [0, 2]], [[3.0, 1.0], [4.0, 1.0]], atol=1e-9)
    np.testing.assert_allclose(tracker.paths(smooth=True, lag_scans=0)[0].mean, filtered.mean)
    np.testing.assert_allclose(tracker.paths(smooth=True, lag_scans=5)[0].mean, smoothed.mean)


def test_the_nearest_pairs_are_those_with_the_least_sum():
    # Each track alone would take the detection at 4: the sum decides.
    tracker = NearestNeighbourTracker(STILL, 1.0)
    scans(tracker, [(0, 0), (6, 0)], [(0, 0), (6, 0)], [(4, 0), (10, 0)])
    first, second = tracker.estimates().values()
    assert first[0] < 4.0 < 6.0 < second[0]
    assert len(tracker.estimates()) == 2


def test_two_detections_in_three_scans_confirm_and_three_misses_end():
    assert scans(NearestNeighbourTracker(STILL), (0, 0)).estimates() == {}
    assert scans(NearestNeighbourTracker(STILL), (0, 0), (), ()).paths() == []
    assert len(scans(NearestNeighbourTracker(STILL), (0, 0), (), (0, 0), (), ()).estimates()) == 1
    ended = scans(NearestNeighbourTracker(STILL), (0, 0), (), (0, 0), (), (), ())
    assert ended.estimates() == {}
    assert [path.scan.tolist() for path in ended.paths()] == [[0, 1, 2]]


def test_objects_start_at_births_only_unless_they_may_appear_anywhere():
    far = [(500, 500), (500, 500)]
    assert scans(NearestNeighbourTracker(STILL), *far).paths() == []
    assert len(scans(NearestNeighbourTracker(STILL, 10.0), *far).paths()) == 1


def test_late_scans_and_numbers_that_are_not_finite_are_left_out():
    tracker = scans(NearestNeighbourTracker(STILL), [(0, 0), (np.nan, 0)], (0, 0))
    tracker.update(0, np.array([[0.0, 0.0]]), SENSOR, (BIRTH,))
    assert tracker.scans == 2
    assert len(tracker.paths()) == 1


def test_true_association_follows_objects_that_cross():
    rng = np.random.default_rng(3)
    true = [np.array([[-20.0 + 2 * k, 0.3], [20.0 - 2 * k, -0.3]]) for k in range(21)]
    seen = [xy + rng.normal(0.0, 2.0, (2, 2)) for xy in true]
    clutter = [np.vstack([z, [[0.0, 1.0]]]) for z in seen]
    tracker = scans(TrueAssociationTracker(STILL, 5.0), *clutter, origins=[(7, 9, 0)] * 21)
    paths = tracker.paths(smooth=True)
    assert [path.label[1] for path in paths] == [7, 9]
    for i, path in enumerate(paths):
        assert np.abs(path.mean[:, :2] - [xy[i] for xy in true]).max() < 3.0


def test_origins_that_are_no_numbers_are_clutter():
    tracker = scans(
        TrueAssociationTracker(STILL, 5.0), *[[(0, 0), (1, 1), (2, 2)]] * 3, origins=[(np.inf, np.nan, 4)] * 3
    )
    assert [path.label[1] for path in tracker.paths()] == [4]


@pytest.mark.parametrize("dt_s", [0.0, 0.3])
def test_sensors_of_one_epoch_and_irregular_scans_are_filtered(dt_s):
    tracker = NearestNeighbourTracker(STILL)
    for t_s in (0.0, dt_s, 1.0):
        tracker.update(round(t_s * NS_PER_S), np.array([[2.0 + t_s, 0.0]]), SENSOR, (BIRTH,))
    (path,) = tracker.paths(smooth=True)
    assert len(path.mean) == 3
    assert np.isfinite(path.mean).all()
