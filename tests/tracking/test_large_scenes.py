"""Optimisations for a thousand objects must not change the estimate of any of them."""

import numpy as np
import pytest

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb import gating
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams
from gcs.tracking.models.measurement_model import linearise, sensor_model

SIDE_M = 300.0
SENSOR = Sensor("s", 0.9, 10 / SIDE_M**2, np.diag([10.0, 10.0]), (-1e4, -1e4, 1e4, 1e4))


def neighbours(seed, kind=list):
    """Scans of a dozen objects a gate or two apart, with births among them at every scan."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(0.0, SIDE_M, (12, 2))
    wide = np.diag([100.0, 100.0, 25.0, 25.0])
    narrow = np.diag([10.0, 10.0, 4.0, 4.0])
    born = kind(Birth(np.array([*p, 0.0, 0.0]), narrow, 0.9) for p in place)
    again = kind(Birth(np.array([*p, 0.0, 0.0]), wide, 0.05) for p in rng.uniform(0.0, SIDE_M, (3, 2)))
    for k in range(6):
        seen = place[rng.random(12) < 0.9]
        z = np.vstack([seen + rng.normal(0.0, 3.0, seen.shape), rng.uniform(0.0, SIDE_M, (10, 2))])
        yield k * NS_PER_S, z, born if k == 0 else again


def tracked(scans, **limits):
    tracker = Glmb("targets", GlmbParams(accel_psd_m2_s3=1.0, **limits), 1)
    for t_ns, z, births in scans:
        tracker.update(t_ns, z, SENSOR, births)
        yield tracker


@pytest.mark.parametrize("seed", range(5))
def test_separate_clusters_have_the_existence_of_joint_association(seed):
    apart = tracked(neighbours(seed))
    together = tracked(neighbours(seed), max_conflict=0.0)
    for one, other in zip(apart, together, strict=True):
        ours = {track.label: track.existence for track in one.picture(0).tracks}
        theirs = {track.label: track.existence for track in other.picture(0).tracks}
        for label in ours | theirs:
            assert ours.get(label, 0.0) == pytest.approx(theirs.get(label, 0.0), abs=0.02)


def test_births_may_be_a_list_or_a_tuple():
    for one, other in zip(tracked(neighbours(0)), tracked(neighbours(0, tuple)), strict=True):
        for column, same in zip(one.estimates(), other.estimates(), strict=True):
            np.testing.assert_array_equal(column, same)


def test_estimates_equal_the_picture():
    for tracker in tracked(neighbours(1)):
        found = tracker.estimates()
        picture = tracker.picture(0)
        rows = list(zip(*found[:5], strict=True))
        assert len(rows) == len(picture.tracks) > 0
        assert [tuple(row[0].tolist()) for row in rows] == sorted(track.label for track in picture.tracks)
        for (_, mean, cov, existence, estimated), track in zip(rows, picture.tracks, strict=True):
            np.testing.assert_array_equal(mean, track.mean)
            np.testing.assert_array_equal(cov, track.cov)
            assert (existence, estimated) == (track.existence, track.estimated)
        with pytest.raises(ValueError, match="read-only"):
            found.mean[0] = 0.0


@pytest.mark.parametrize("m", [0, 1, 2, 3, 5, 24, 25, 26, 400])
def test_no_gate_misses_a_detection(m):
    rng = np.random.default_rng(m)
    z = rng.uniform(0.0, 200.0, (m, 2)).round(-1)  # many at the same coordinate
    rows = np.arange(m)
    gating.sort_into_strips(z, rows)
    z = z[rows]
    n = 30
    gate_chi2 = 9.0
    mean = np.hstack([rng.uniform(-20.0, 220.0, (n, 2)), np.zeros((n, 2))])
    cov = np.array([np.diag([*rng.uniform(1.0, 900.0, 2), 1.0, 1.0]) for _ in range(n)])
    view = linearise(sensor_model(SENSOR), mean, cov)
    flat = np.full(n, -0.1)
    start, meas, _ = gating.association_options(cov, flat, flat, z, view, np.full(m, -60.0), gate_chi2)
    for t in range(n):
        off = z - mean[t, :2]
        d2 = np.einsum("mi,ij,mj->m", off, np.linalg.inv(cov[t, :2, :2] + SENSOR.noise_cov_m2), off)
        inside = np.flatnonzero(d2 <= gate_chi2)
        found = meas[start[t] : start[t + 1]]
        if inside.size <= gating.MAX_GATED_DETECTIONS:
            assert sorted(found[found >= 0]) == inside.tolist()
        else:
            assert set(found[found >= 0]) < set(inside.tolist())
