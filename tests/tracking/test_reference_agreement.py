"""If the filter differed from the reference, no existence or position in the picture could be trusted."""

import itertools
import math
from collections import defaultdict

import numpy as np
import pytest
from helpers.reference_glmb import ReferenceGlmb

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams

EXACT = {
    "accel_psd_m2_s3": 4.0,
    "survival_probability_per_s": 0.9,
    "max_hypotheses": 100_000,
    "gate_chi2": 1e6,
    "prune_weight": 1e-300,
    "tail_share": 0.0,
    "min_existence": 0.0,
    "max_conflict": 0.0,
    "max_dependence": 1e-12,
    "merge_chi2": 0.0,
    "min_reported_existence": 0.0,
}
SENSOR = Sensor("s", 0.8, 1e-4, np.diag([9.0, 16.0]), (-500.0, -500.0, 500.0, 500.0))
BLIND = Sensor("b", 0.6, 2e-4, np.array([[30.0, 9.0], [9.0, 20.0]]), (-500.0, -500.0, 20.0, 500.0))


def births(rng):
    return [
        Birth(np.array([0.0, 0.0, 3.0, 0.0]), np.diag([100.0, 80.0, 25.0, 25.0]), 0.3),
        Birth(np.array([25.0, 5.0, -3.0, 0.0]), np.diag([100.0, 80.0, 25.0, 25.0]), 0.2),
    ]


def run_both(seed, dts_s, **overrides):
    """Objects that meet, scans of two sensors, some at the same time; second births at the third scan."""
    rng = np.random.default_rng(seed)
    params = GlmbParams(**{**EXACT, **overrides})
    fast = Glmb("targets", params, seed)
    exact = ReferenceGlmb(params)
    t_ns = 0
    for k, dt_s in enumerate(dts_s):
        t_ns += int(dt_s * NS_PER_S)
        z = np.vstack([rng.normal([5.0, 0.0], 12.0, (rng.integers(0, 3), 2)), rng.normal(0, 60, (1, 2))])
        new = births(rng) if k == 0 else births(rng)[:1] if k == 2 else []
        for tracker in (fast, exact):
            tracker.update(t_ns, z, (SENSOR, BLIND)[k % 2], new)
    return fast, exact, fast.picture(t_ns)


def joint(fast):
    """All (weight, tracks) of the product of the fast filter's groups, and its state by track."""
    g = fast.state.posterior.clusters
    everything = [(1.0, ())]
    for low, high in itertools.pairwise(g.first):
        held = [(math.exp(g.logw[h]), tuple(g.items[g.start[h] : g.start[h + 1]])) for h in range(low, high)]
        everything = [(w * v, a + b) for w, a in everything for v, b in held]
    return everything


def label_of(fast, track):
    return tuple(fast.state.posterior.labels[fast.state.posterior.track_label[track]].tolist())


def assert_agree(fast, exact, picture, rel, floor):
    hypotheses = joint(fast)
    sets = defaultdict(float)
    for weight, tracks in hypotheses:
        sets[frozenset(label_of(fast, t) for t in tracks)] += weight
    for labels, weight in exact.label_sets().items():
        assert sets[labels] == pytest.approx(weight, rel=rel, abs=floor)
    for track in picture.tracks:
        assert track.existence == pytest.approx(exact.existence(track.label), rel=rel, abs=floor)
    for label in {track.label for track in picture.tracks if track.existence > 0.2}:
        held = [(w, t) for w, tracks in hypotheses for t in tracks if label_of(fast, t) == label]
        mean = sum(w * fast.state.posterior.mean[t] for w, t in held) / sum(w for w, _ in held)
        np.testing.assert_allclose(mean, exact.mean(label), rtol=rel, atol=100 * floor)
    sizes = np.zeros(picture.cardinality.size)
    for labels, weight in exact.label_sets().items():
        sizes[len(labels)] += weight
    np.testing.assert_allclose(picture.cardinality, sizes, rtol=rel, atol=floor)


@pytest.mark.parametrize("seed", range(6))
def test_without_limits_the_filter_equals_the_reference(seed):
    fast, exact, picture = run_both(seed, [1.0, 1.0, 0.0, 0.4])
    assert_agree(fast, exact, picture, rel=1e-6, floor=1e-9)
    ours = np.sort([w for w, _ in joint(fast)])[::-1]
    theirs = np.sort(list(exact.weights.values()))[::-1]
    np.testing.assert_allclose(ours[:200], theirs[:200], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_gibbs_sampling_finds_the_same_marginals(seed):
    fast, exact, picture = run_both(seed, [1.0, 1.0, 0.0], max_enumerated=0, gibbs_sweeps=20_000)
    assert_agree(fast, exact, picture, rel=1e-2, floor=2e-3)


@pytest.mark.parametrize("seed", range(6))
def test_default_limits_hardly_change_existence(seed):
    usual = GlmbParams(accel_psd_m2_s3=4.0)
    kept = [
        "max_hypotheses",
        "gate_chi2",
        "prune_weight",
        "tail_share",
        "min_existence",
        "max_conflict",
        "max_dependence",
        "merge_chi2",
    ]
    _, exact, picture = run_both(seed, [1.0, 1.0, 0.0, 0.4], **{name: getattr(usual, name) for name in kept})
    for track in picture.tracks:
        assert track.existence == pytest.approx(exact.existence(track.label), abs=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_enumeration_of_a_dense_scene_is_exact_within_its_bound(seed):
    rng = np.random.default_rng(seed)
    place = rng.uniform(-60.0, 60.0, (9, 2))
    born = [Birth(np.array([*p, 0.0, 0.0]), np.diag([60.0, 60.0, 9.0, 9.0]), 0.7) for p in place]
    usual, unbound = (
        Glmb("targets", GlmbParams(accel_psd_m2_s3=1.0, max_enumerated=most), 1) for most in (100_000, 10**15)
    )
    for k in range(4):
        z = np.vstack([place[rng.random(9) < 0.9] + rng.normal(0, 3, 2), rng.uniform(-80, 80, (6, 2))])
        for tracker in (usual, unbound):
            tracker.update(k * NS_PER_S, z, SENSOR, born if k == 0 else ())
        for one, other in zip(usual.picture(0).tracks, unbound.picture(0).tracks, strict=True):
            assert one.existence == pytest.approx(other.existence, abs=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_dropping_improbable_tracks_keeps_existence(seed):
    rng = np.random.default_rng(seed)
    params = GlmbParams(**{**EXACT, "tail_share": 1e-3})
    fast = Glmb("targets", params, 1)
    exact = ReferenceGlmb(params)
    for k in range(4):
        z = np.vstack([rng.normal([3.0 * k, 0.0], 4.0, (1, 2)), rng.normal(0.0, 30.0, (2, 2))])
        for tracker in (fast, exact):
            tracker.update(k * NS_PER_S, z, SENSOR, births(rng)[:1] if k == 0 else ())
        (track,) = fast.picture(0).tracks
        assert track.existence == pytest.approx(exact.existence((0, 0)), rel=1e-9 if k == 0 else 4e-3)
    held = [(w, *tracks) for w, tracks in joint(fast) if tracks]
    assert len(held) < 0.7 * sum(bool(h) for h in exact.weights)
    mean = sum(w * fast.state.posterior.mean[t] for w, t in held) / track.existence
    np.testing.assert_allclose(mean, exact.mean((0, 0)), atol=0.05)
