"""Aircraft fly arcs. A user would lose them in their loiter circles, or trust a covariance that is none."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb import kalman, marginals
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams
from gcs.tracking.models import constant_velocity, coordinated_turn
from gcs.tracking.models.measurement_model import linearise, sensor_model

SENSOR = Sensor("s", 0.98, 4e-6, np.diag([10.0, 10.0]), (-5000.0, -5000.0, 5000.0, 5000.0))


def moved(x, dt):
    """The coordinated turn itself, for (5,) states."""
    px, py, vx, vy, w = x
    if abs(w) < 1e-12:
        return np.array([px + vx * dt, py + vy * dt, vx, vy, w])
    s = math.sin(w * dt)
    c = math.cos(w * dt)
    return np.array(
        [
            px + (s * vx - (1.0 - c) * vy) / w,
            py + ((1.0 - c) * vx + s * vy) / w,
            c * vx - s * vy,
            s * vx + c * vy,
            w,
        ]
    )


def joint(cov, turn):
    return np.block([[cov, turn[2:, None]], [turn[None, 2:], np.array([[turn[1]]])]])


def is_held(P):
    """Whether the covariance with the turn rate is more than merged tracks may have (see `turning`)."""
    return P[4, :4] @ np.linalg.solve(P[:4, :4], P[4, :4]) > 0.97 * P[4, 4]


def random_track(rng):
    root = rng.normal(0.0, 1.0, (5, 5)) * np.array([5.0, 5.0, 3.0, 3.0, 0.2])[:, None]
    P = root @ root.T + np.diag([1.0, 1.0, 1.0, 1.0, 1e-3])
    x = np.array([*rng.normal(0, 100, 2), *rng.normal(0, 15, 2), rng.normal(0, 0.3)])
    return x, P


def split(x, P):
    return x[None, :4].copy(), P[None, :4, :4].copy(), np.array([[x[4], P[4, 4], *P[4, :4]]])


@settings(max_examples=100)
@given(seed=st.integers(0, 2**32 - 1), dt=st.sampled_from([0.05, 0.5, 1.0, 2.0]))
def test_prediction_is_the_extended_filters_on_five_states(seed, dt):
    rng = np.random.default_rng(seed)
    x, P = random_track(rng)
    if seed % 3 == 0:
        x[4] = 0.0
    Q = constant_velocity.process_noise(dt, 1.0)
    mean, cov, turn = coordinated_turn.predict(*split(x, P), Q, dt, 1e-9, 1e12)
    step = np.diag([1e-4, 1e-4, 1e-4, 1e-4, 1e-5])
    J = np.column_stack([(moved(x + d, dt) - moved(x - d, dt)) / (2 * d.max()) for d in step])
    expected = J @ P @ J.T
    expected[:4, :4] += Q
    assume(not is_held(P) and not is_held(expected))
    np.testing.assert_allclose(np.append(mean[0], turn[0, 0]), moved(x, dt), atol=1e-9)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(joint(cov[0], turn[0]) / scale, expected / scale, atol=1e-3)


def test_the_update_is_the_kalman_update_of_five_states():
    rng = np.random.default_rng(5)
    x, P = random_track(rng)
    mean, cov, turn = split(x, P)
    place = mean[:, :2] + 4.0
    view = linearise(sensor_model(SENSOR), mean, cov)
    first = np.zeros(1, np.int64)
    new_mean, new_cov = kalman.update_tracks(mean, cov, first, first, place, view)
    new_turn = coordinated_turn.update(cov, turn, first, first, place, view)
    H = np.eye(2, 5)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + SENSOR.noise_cov_m2)
    np.testing.assert_allclose(np.append(new_mean[0], new_turn[0, 0]), x + K @ (place[0] - x[:2]), atol=1e-9)
    np.testing.assert_allclose(joint(new_cov[0], new_turn[0]), P - K @ H @ P, atol=1e-9)


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), dt=st.sampled_from([0.0, 0.05, 1.0, 2.0]), straight=st.booleans())
def test_jacobians_are_the_slopes_of_the_turn(seed, dt, straight):
    x, _ = random_track(np.random.default_rng(seed))
    if straight:
        x[4] = 0.0
    (found,) = coordinated_turn.jacobians(x[None], np.array([dt]), 1e12)
    slopes = [(moved(x + d, dt) - moved(x - d, dt)) / 2e-4 for d in np.eye(5) * 1e-4]
    np.testing.assert_allclose(found, np.column_stack(slopes), atol=1e-4, rtol=1e-4)


@settings(max_examples=100)
@given(
    seed=st.integers(0, 2**32 - 1),
    steps=st.lists(st.tuples(st.sampled_from([1e-3, 0.2, 1.0, 30.0, 1000.0]), st.booleans()), max_size=8),
)
def test_the_joint_covariance_stays_positive_definite_at_any_pace(seed, steps):
    rng = np.random.default_rng(seed)
    mean, cov, turn = split(*random_track(rng))
    first = np.zeros(1, np.int64)
    for dt, seen in steps:
        mean, cov, turn = coordinated_turn.predict(
            mean, cov, turn, constant_velocity.process_noise(dt, 1.0), dt, 0.3, 10.0
        )
        view = linearise(sensor_model(SENSOR), mean, cov)
        z = mean[:, :2] + rng.normal(0, 5, (1, 2))
        meas = first if seen else first - 1
        mean_after, cov_after = kalman.update_tracks(mean, cov, first, meas, z, view)
        turn = coordinated_turn.update(cov, turn, first, meas, z, view)
        mean = mean_after
        cov = cov_after
        P = joint(cov[0], turn[0])
        assert np.isfinite(P).all()
        scale = np.sqrt(np.diag(P))
        assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > 0.0


def velocity_error(params, seeds, radius_m=45.0, speed_m_s=15.0):
    errors = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        tracker = Glmb("agents", params, 1)
        for k in range(40):
            a = k * speed_m_s / radius_m
            place = radius_m * np.array([math.cos(a) - 1.0, math.sin(a)])
            birth = Birth(np.array([0.0, 0.0, 0.0, 0.0]), np.diag([100.0] * 4), 0.5)
            z = place + rng.normal(0.0, math.sqrt(10.0), (1, 2))
            tracker.update(k * NS_PER_S, z, SENSOR, [birth] if k == 0 else ())
            if k > 10:
                (track,) = tracker.estimate()
                errors.append(track.mean[2:] - speed_m_s * np.array([-math.sin(a), math.cos(a)]))
    return math.sqrt(np.mean(np.square(errors).sum(axis=1)))


def test_a_loiter_circle_is_followed_much_closer_than_by_straight_motion():
    straight = velocity_error(GlmbParams(accel_psd_m2_s3=16.0), range(5))
    turning_too = velocity_error(
        GlmbParams(accel_psd_m2_s3=1.0, turn_rate_std_rad_s=0.3, turn_time_s=10.0), range(5)
    )
    assert turning_too < 0.7 * straight


def loitering(seed, **params):
    """Tracker of an aircraft that circles among misses and clutter; states shown by scan, and the truth."""
    params = {"accel_psd_m2_s3": 1.0, "turn_rate_std_rad_s": 0.3, "turn_time_s": 10.0} | params
    rng = np.random.default_rng(seed)
    tracker = Glmb("agents", GlmbParams(**params), 1, keep_histories=True)
    angle = np.arange(40) / 3.0
    truth = 45.0 * np.column_stack([np.cos(angle) - 1.0, np.sin(angle)])
    shown = {}
    for k, place in enumerate(truth):
        z = place[None][rng.random(1) < 0.9] + rng.normal(0.0, math.sqrt(10.0), (1, 2))
        z = np.vstack([z, place + rng.uniform(-100.0, 100.0, (rng.poisson(0.16), 2))])
        births = [Birth(np.zeros(4), np.diag([100.0] * 4), 0.5)] if k == 0 else []
        tracker.update(k * NS_PER_S, z, SENSOR, births)
        for track in tracker.estimate():
            shown[k] = track.mean
    return tracker, shown, truth


def best_tracks(of):
    """State of each estimated label along the single history that the best hypothesis has of it."""
    posterior = of.state.posterior
    tracks = marginals.map_tracks(posterior.clusters)
    labels = map(tuple, posterior.labels[posterior.track_label[tracks]].tolist())
    return {label: (posterior.mean[t], posterior.cov[t]) for label, t in zip(labels, tracks, strict=True)}


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_a_path_with_turns_ends_in_the_state_of_the_filter(seed):
    tracker, _, _ = loitering(seed, merge_chi2=0.0)
    shown = best_tracks(tracker)
    living = {path.label: path for path in tracker.histories.paths() if path.alive}
    assert living.keys() == shown.keys()
    for label, path in living.items():
        np.testing.assert_allclose(path.mean[-1], shown[label][0], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(path.cov[-1], shown[label][1], rtol=1e-6, atol=1e-6)


def path_of(tracker, **how):
    (path,) = tracker.histories.paths(**how)
    return dict(zip(path.scan.tolist(), path.mean, strict=True))


def test_recovered_turns_are_no_worse_than_filtered_ones_and_smoothed_ones_far_better():
    squares = {}
    for seed in range(8):
        tracker, shown, truth = loitering(seed)
        ways = {
            "filtered": shown,
            "recovered": path_of(tracker),
            "smoothed": path_of(tracker, smooth=True),
        }
        assert ways["recovered"].keys() == set(range(len(truth)))
        for name, states in ways.items():
            squares.setdefault(name, []).extend(((states[k][:2] - truth[k]) ** 2).sum() for k in shown)
    rms = {name: math.sqrt(np.mean(values)) for name, values in squares.items()}
    assert rms["recovered"] <= 1.01 * rms["filtered"]
    assert rms["smoothed"] < 0.75 * rms["filtered"]
    assert rms["smoothed"] < 0.5 * math.hypot(*np.sqrt(np.diag(SENSOR.noise_cov_m2)))


@pytest.mark.parametrize("rate", [0.0, 0.3])
def test_a_straight_flight_is_followed_with_and_without_turns(rate):
    params = GlmbParams(accel_psd_m2_s3=1.0, turn_rate_std_rad_s=rate, turn_time_s=10.0)
    assert velocity_error(params, range(2), radius_m=1e6) < 4.0
