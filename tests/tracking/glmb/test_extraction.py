"""A user would see objects at a clutter point, or between two possible positions."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb import extraction, marginals
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams

NEAR = 4.0
FAR = 400.0


def mixture(rng, labels=4, most=6):
    """Tracks of some labels, each near to its label's place or far from it; shown is the first of each."""
    track_label = np.repeat(np.arange(labels), rng.integers(1, most, labels))
    n = track_label.size
    place = rng.uniform(-1e4, 1e4, (labels, 4))[track_label]
    mean = place + rng.choice([NEAR, FAR], (n, 1)) * rng.normal(0.0, 1.0, (n, 4))
    root = rng.normal(0.0, 3.0, (n, 4, 4))
    probability = rng.uniform(0.01, 0.2, n)
    shown = np.searchsorted(track_label, np.arange(labels))
    return probability, track_label, shown, mean, root @ root.transpose(0, 2, 1) + np.eye(4)


def plainly(probability, track_label, t, mean, cov):
    """Mean and covariance of the mixture of those that may be the same state as track t."""
    same = []
    for u in np.flatnonzero(track_label == track_label[t]):
        d = mean[u] - mean[t]
        if u == t or d @ np.linalg.solve(cov[t] + cov[u], d) <= extraction.SAME_STATE_CHI2:
            same.append(u)
    w = probability[same] / probability[same].sum()
    centre = w @ mean[same]
    d = mean[same] - centre
    return centre, np.einsum("n,nij->ij", w, cov[same] + d[:, :, None] * d[:, None, :]), len(same)


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_an_estimate_is_the_mixture_of_the_tracks_that_agree(seed):
    of = mixture(np.random.default_rng(seed))
    probability, track_label, shown, mean, cov = of
    found, spread = extraction.average_states(*of)
    for row, t in enumerate(shown):
        expected, expected_cov, _ = plainly(probability, track_label, t, mean, cov)
        np.testing.assert_allclose(found[row], expected, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(spread[row], expected_cov, rtol=1e-7, atol=1e-6)
        assert np.linalg.eigvalsh(spread[row]).min() > 0.0


def test_no_estimate_lies_between_two_possible_positions():
    mean = np.array([[0.0, 0.0, 0.0, 0.0], [100.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0]])
    cov = np.tile(np.eye(4) * 4.0, (3, 1, 1))
    label = np.zeros(3, np.int64)
    found, _ = extraction.average_states(np.array([0.3, 0.3, 0.3]), label, np.zeros(1, np.int64), mean, cov)
    assert found[0, 0] == 1.0


def test_in_clutter_estimates_are_better_than_the_best_track_and_consistent():
    distances = []
    nees = []
    sensor = Sensor("s", 0.8, 3e-4, np.eye(2) * 25.0, (-1e4, -1e4, 1e4, 1e4))
    birth = Birth(np.zeros(4), np.diag([25.0, 25.0, 200.0, 200.0]), 0.9)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        of = Glmb("targets", GlmbParams(accel_psd_m2_s3=4.0), 1)
        x = np.array([0.0, 0.0, 10.0, 0.0])
        for k in range(40):
            z = x[None, :2][rng.random(1) < 0.8] + rng.normal(0.0, 5.0, (1, 2))
            clutter = x[:2] + rng.uniform(-100.0, 100.0, (rng.poisson(12.0), 2))
            of.update(k * NS_PER_S, np.vstack([z, clutter]), sensor, [birth] if k == 0 else [])
            posterior = of.state.posterior
            for track, t in zip(of.estimate(), marginals.map_tracks(posterior.clusters), strict=True):
                states = (track.mean - x, track.cov), (posterior.mean[t] - x, posterior.cov[t])
                distances.append([np.hypot(*d[:2]) for d, _ in states])
                nees.append([d @ np.linalg.solve(P, d) for d, P in states])
            push = rng.normal(0.0, 2.0, 2)
            x = np.concatenate([x[:2] + x[2:] + push / 2.0, x[2:] + push])
    shown, best = np.mean(distances, axis=0)
    assert shown < 0.985 * best
    assert np.mean(nees, axis=0)[0] < 0.7 * np.mean(nees, axis=0)[1]
