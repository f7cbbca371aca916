"""What no sensor should send must not stop the tracker, nor leave a covariance that poisons what follows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams

NUMBERS = st.one_of(
    st.floats(-300, 300),
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, 1e-300, 1e300]),
)
SCANS = st.lists(
    st.tuples(
        st.sampled_from([-NS_PER_S, 0, 1, NS_PER_S // 10, NS_PER_S, 1000 * NS_PER_S, 10**18]),
        st.lists(st.tuples(NUMBERS, NUMBERS), max_size=12),
        st.sampled_from([0.0, 0.5, 0.98, 1.0]),
        st.sampled_from([0.0, 1e-9, 1e-4, 10.0]),
        st.sampled_from([1e-3, 3.0, 300.0]),
        st.booleans(),
    ),
    max_size=8,
)


def assert_sound(tracker):
    picture = tracker.picture(0)
    assert np.isfinite(picture.cardinality).all()
    assert picture.cardinality.sum() == pytest.approx(1.0)
    for track in picture.tracks:
        assert 0.0 <= track.existence <= 1.0
        assert np.isfinite(track.mean).all()
        assert np.array_equal(track.cov, track.cov.T)
        scale = np.sqrt(np.diag(track.cov))
        assert np.linalg.eigvalsh(track.cov / np.outer(scale, scale)).min() > 0.0
    assert [track.label for track in picture.tracks] == sorted(track.label for track in picture.tracks)


@settings(max_examples=150)
@given(scans=SCANS)
def test_any_sequence_of_scans_leaves_a_sound_picture(scans):
    tracker = Glmb("targets", GlmbParams(accel_psd_m2_s3=9.0), 0)
    births = [
        Birth(np.array([0.0, x, 1.0, 0.0]), np.diag([100.0, 100.0, 20.0, 20.0]), p)
        for x, p in [(0, 0.03), (9, 1)]
    ]
    t_ns = 0
    late = 0
    bad = 0
    for step_ns, z, p_d, clutter, noise_m, born in scans:
        now_ns = t_ns + step_ns
        detector = Sensor("s", p_d, clutter, np.eye(2) * noise_m**2, (-250.0, -250.0, 250.0, 250.0))
        started = tracker.scans > 0
        tracker.update(
            now_ns, np.reshape(np.array(z, dtype=float), (-1, 2)), detector, births if born else ()
        )
        if step_ns < 0 and started:
            late += 1
        else:
            bad += sum(not np.isfinite(point).all() for point in z)
            t_ns = now_ns
        assert_sound(tracker)
    assert (tracker.late_scans, tracker.bad_detections) == (late, bad)
    assert tracker.scans == len(scans) - late


def test_thousands_of_detections_in_one_place_are_survived():
    rng = np.random.default_rng(1)
    places = rng.uniform(-40, 40, (25, 2))
    births = [
        Birth(np.array([*place, 0.0, 0.0]), np.diag([100.0, 100.0, 20.0, 20.0]), 0.5) for place in places
    ]
    tracker = Glmb("targets", GlmbParams(accel_psd_m2_s3=9.0), 0)
    detector = Sensor("s", 0.95, 1e-3, np.eye(2) * 9.0, (-250.0, -250.0, 250.0, 250.0))
    for k in range(3):
        z = np.vstack([rng.normal(0, 30, (5000, 2)), np.zeros((500, 2))])
        tracker.update(k * NS_PER_S, z, detector, births if k == 0 else ())
        assert_sound(tracker)
    tracker.update(3 * NS_PER_S, np.empty((0, 2)), detector)
    assert_sound(tracker)
