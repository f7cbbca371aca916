"""Whole paths from association histories: no late starts, no gaps, no ghosts, bounded memory."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb import marginals
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams

FOV = (0.0, 0.0, 2000.0, 2000.0)
PLACES = np.array([[200.0, 300.0], [220.0, 900.0], [1200.0, 1500.0]])
COV = np.diag([100.0, 100.0, 100.0, 100.0])


def sensor(p_d=0.9, clutter=20.0, noise_m=5.0):
    return Sensor("radar", p_d, clutter / 4e6, np.eye(2) * noise_m**2, FOV)


def births(probability=0.03):
    return [Birth(np.array([*place, 0.0, 0.0]), COV, probability) for place in PLACES]


def tracker(keep=True, **params):
    return Glmb("targets", GlmbParams(**{"accel_psd_m2_s3": 1.0, **params}), 1, keep_histories=keep)


def noisy_run(seed, scans=25, p_d=0.9, clutter=20, keep=True, **params):
    """Three objects that leave the places of birth, one of them dying near the end, seen through clutter."""
    rng = np.random.default_rng(seed)
    of = tracker(keep, **params)
    state = np.column_stack([PLACES, rng.normal(0, 8, (3, 2))])
    for k in range(scans):
        alive = state[: 2 if k > scans - 8 else 3]
        seen = alive[rng.random(len(alive)) < p_d, :2]
        z = np.vstack([seen + rng.normal(0, 5, seen.shape), rng.uniform(0, 2000, (rng.poisson(clutter), 2))])
        of.update(k * NS_PER_S, rng.permutation(z), sensor(p_d, clutter), births())
        state[:, :2] += state[:, 2:]
    return of


def best_tracks(of):
    """State of each estimated label along the single history that the best hypothesis has of it."""
    posterior = of.state.posterior
    tracks = marginals.map_tracks(posterior.clusters)
    labels = map(tuple, posterior.labels[posterior.track_label[tracks]].tolist())
    return {label: (posterior.mean[t], posterior.cov[t]) for label, t in zip(labels, tracks, strict=True)}


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000))
def test_a_path_ends_in_the_state_of_the_filter(seed):
    of = noisy_run(seed, merge_chi2=0.0)
    shown = best_tracks(of)
    living = {path.label: path for path in of.histories.paths() if path.alive}
    assert living.keys() == shown.keys()
    for label, path in living.items():
        np.testing.assert_allclose(path.mean[-1], shown[label][0], rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(path.cov[-1], shown[label][1], rtol=1e-9, atol=1e-7)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000))
def test_paths_have_no_gaps_and_no_detection_is_of_two_of_them(seed):
    paths = noisy_run(seed, p_d=0.7, clutter=60).histories.paths()
    used = set()
    for path in paths:
        assert path.scan[0] == path.label[0]
        np.testing.assert_array_equal(np.diff(path.scan), 1)
        np.testing.assert_array_equal(path.t_ns, path.scan * NS_PER_S)
        made = ~np.isnan(path.z_m[:, 0])
        assert path.alive or made[-1]
        here = {(k, *z) for k, z in zip(path.scan[made], path.z_m[made].tolist(), strict=True)}
        assert not used & here
        used |= here


def test_an_object_confirmed_late_has_a_path_from_its_birth_on():
    of = tracker()
    first = None
    for k in range(6):
        z = PLACES[:1] if k != 1 else np.empty((0, 2))
        of.update(k * NS_PER_S, z, sensor(0.5, 20.0), births(0.001) if k == 0 else [])
        if of.estimate() and first is None:
            first = k
    (path,) = of.histories.paths()
    assert first > 0
    assert path.scan.tolist() == list(range(6))
    assert np.isnan(path.z_m[:, 0]).tolist() == [False, True, False, False, False, False]


def test_the_path_of_a_lost_object_ends_with_its_last_detection():
    of = tracker()
    for k in range(12):
        z = PLACES[:1] if k < 8 and k != 5 else np.empty((0, 2))
        of.update(k * NS_PER_S, z, sensor(), births() if k == 0 else [])
    assert not of.estimate()
    (path,) = of.histories.paths()
    assert path.scan.tolist() == list(range(8))
    assert not path.alive


def test_a_path_of_clutter_is_dropped():
    of = tracker()
    of.update(0, PLACES[:1], sensor(0.98, 5.0), births())
    assert len(of.estimate()) == 1
    for k in range(1, 5):
        of.update(k * NS_PER_S, np.empty((0, 2)), sensor(0.98, 5.0))
    assert of.histories.labels == 1
    assert of.histories.paths() == ()


def test_histories_do_not_change_the_estimates():
    plain = noisy_run(3, keep=False)
    keeping = noisy_run(3)
    assert plain.histories is None
    for a, b in zip(plain.picture(0).tracks, keeping.picture(0).tracks, strict=True):
        assert (a.label, a.existence, a.estimated) == (b.label, b.existence, b.estimated)
        assert a.mean.tobytes() == b.mean.tobytes()


def test_smoothed_paths_are_nearer_to_the_truth():
    rng = np.random.default_rng(5)
    of = tracker()
    truth = PLACES[0] + np.arange(40)[:, None] * [12.0, 5.0]
    for k, place in enumerate(truth):
        of.update(k * NS_PER_S, [place + rng.normal(0, 5, 2)], sensor(), births() if k == 0 else [])

    def error_m(**how):
        (path,) = of.histories.paths(**how)
        return float(np.hypot(*(path.mean[:, :2] - truth).T).mean())

    assert error_m(smooth=True) < 0.8 * error_m()


def test_two_updates_at_one_time_are_two_rows_of_a_path():
    of = tracker()
    for k in range(3):
        of.update(k * NS_PER_S, PLACES[:1], sensor(), births() if k == 0 else [])
        of.update(k * NS_PER_S, PLACES[:1] + 1.0, sensor())
    (path,) = of.histories.paths()
    assert path.t_ns.tolist() == [0, 0, NS_PER_S, NS_PER_S, 2 * NS_PER_S, 2 * NS_PER_S]


@pytest.mark.parametrize("last", [0, 1])
def test_an_object_last_detected_by_any_sensor_of_an_epoch_keeps_its_path(last):
    """No object dies between two scans of one epoch: a path that ended there was once impossible."""
    of = tracker()
    scanned = [sensor(clutter=1.0), sensor(clutter=1.0)]
    for k in range(20):
        for i, radar in enumerate(scanned):
            seen = k < 10 or (k == 10 and i <= last)
            z = np.array([[200.0 + 8.0 * k, 300.0]] if seen else []).reshape(-1, 2)
            of.update(k * NS_PER_S, z, radar, births() if i == 0 else ())
    (path,) = of.histories.paths()
    assert not path.alive
    assert path.scan[-1] == 20 + last


def test_empty_scans_and_late_ones_leave_no_trace():
    of = tracker()
    for t_ns in (5, 6, 3, 7):
        of.update(t_ns, np.empty((0, 2)), sensor())
    assert of.late_scans == 1
    assert of.histories.paths() == ()
    assert of.histories.nodes == 0


def nodes_beyond_the_paths(scans):
    """Most nodes ever held that are on no kept label's history, in a long run among clutter."""
    rng = np.random.default_rng(11)
    of = tracker()
    most = 0
    for k in range(scans):
        alive = PLACES[rng.random(3) < 0.9]
        z = np.vstack([alive + rng.normal(0, 5, alive.shape), rng.uniform(0, 2000, (20, 2))])
        of.update(k * NS_PER_S, z, sensor(), births(0.03 if k == 0 else 1e-4))
        histories = of.histories
        if k % 50 == 49:
            kept = {int(n) for label in histories._estimated for n in histories._chain(label)}
            most = max(most, histories.nodes - len(kept))
            forest = histories._tree
            needed = set(forest.scan[forest.references > 0].tolist())
            assert needed <= set(histories._scans), "a path would not know its scans"
            assert len(histories._scans) <= max(64, 2 * len(needed)) + 50, "scans of no path are kept"
    return most


def test_only_paths_grow_with_the_run():
    assert nodes_beyond_the_paths(300) < 3000


@pytest.mark.slow
def test_only_paths_grow_with_a_long_run():
    assert nodes_beyond_the_paths(10_000) < 3000
