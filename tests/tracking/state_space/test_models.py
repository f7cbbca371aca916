"""A user's models give what the textbook filters give: Kalman, extended, cubature, and their smoother."""

import math
from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import (
    ExtendedKalmanFilter,
    JulierSigmaPoints,
    KalmanFilter,
    UnscentedKalmanFilter,
)

from gcs.tracking import (
    Birth,
    GlmbParams,
    MeasurementModel,
    MotionModel,
    SwitchingMotion,
    TrackingModel,
    constant_velocity,
    linear_measurement,
    track,
)
from gcs.tracking.glmb.marginals import track_probabilities
from gcs.tracking.state_space.filter import StateSpaceGlmb

PARAMS = GlmbParams(accel_psd_m2_s3=0.0, survival_probability_per_s=0.99)
NOISE = np.diag([25.0, 25.0, 100.0])
H = np.eye(3, 6)
PRIOR = np.diag([100.0, 100.0, 100.0, 400.0, 400.0, 25.0])
PLACE = np.array([800.0, -500.0, 300.0, 0.0, 0.0, 0.0])
MOTION = constant_velocity(3, 2.0)
TIMES = np.cumsum([0.0, *np.tile([1.0, 0.5, 2.0], 8)])


def flight(seed):
    """Return a path in three dimensions, at TIMES."""
    rng = np.random.default_rng(seed)
    state = rng.multivariate_normal(PLACE, PRIOR)
    states = [state]
    for dt in np.diff(TIMES):
        state = MOTION.transition(state[None], dt)[0]
        state = rng.multivariate_normal(state, MOTION.process_noise(dt))
        states.append(state)
    return np.array(states)


def one_track(scans, sensor, motion=MOTION, estimator="recovered", prior=(PLACE, PRIOR), **how):
    model = TrackingModel(PARAMS, (Birth(*prior, 0.05),), motion=motion)
    (found,) = track(scans, TIMES[: len(scans)], sensor, model, estimator, **how).trajectories
    assert found.t_ns.size == len(scans)
    return found


def test_a_track_in_three_dimensions_is_that_of_filterpys_kalman_filter_and_smoother():
    rng = np.random.default_rng(1)
    z = flight(1)[:, :3] + rng.multivariate_normal(np.zeros(3), NOISE, TIMES.size)
    radar = linear_measurement("radar", 0.95, 1e-12, H, NOISE)
    kalman = KalmanFilter(6, 3)
    kalman.x = PLACE.copy()
    kalman.P = PRIOR.copy()
    kalman.H = H
    kalman.R = NOISE
    means, covs, Fs, Qs = [], [], [np.eye(6)], [np.zeros((6, 6))]
    for k, dt in enumerate([0.0, *np.diff(TIMES)]):
        if k:
            Fs.append(np.kron([[1.0, dt], [0.0, 1.0]], np.eye(3)))
            Qs.append(2.0 * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3)))
            kalman.predict(F=Fs[-1], Q=Qs[-1])
        kalman.update(z[k])
        means.append(kalman.x.copy())
        covs.append(kalman.P.copy())
    found = one_track([row[None] for row in z], radar)
    np.testing.assert_allclose(found.mean, means, atol=1e-7)
    np.testing.assert_allclose(found.cov, covs, atol=1e-7)
    expected, expected_cov, _, _ = kalman.rts_smoother(np.array(means), np.array(covs), Fs, Qs)
    smooth = one_track([row[None] for row in z], radar, estimator="smoothed")
    np.testing.assert_allclose(smooth.mean, expected, atol=1e-6)
    np.testing.assert_allclose(smooth.cov, expected_cov, atol=1e-6)


def doppler(x):
    """Range, bearing clockwise from north, and range rate, of states x, y, vx, vy."""
    r = np.hypot(x[:, 0], x[:, 1])
    return np.column_stack([r, np.arctan2(x[:, 0], x[:, 1]), (x[:, 0] * x[:, 2] + x[:, 1] * x[:, 3]) / r])


def doppler_jacobian(x):
    px, py, vx, vy = x.T
    r = np.hypot(px, py)
    rate = (px * vx + py * vy) / r
    zero = np.zeros(len(x))
    rows = [
        [px / r, py / r, zero, zero],
        [py / r**2, -px / r**2, zero, zero],
        [vx / r - px * rate / r**2, vy / r - py * rate / r**2, px / r, py / r],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


DOPPLER_NOISE = np.diag([25.0, 1e-4, 1.0])
SOUTH = np.array([-20.0, -900.0, 20.0, 4.0])
"""Flies across south, where bearings jump by a turn."""
WIDE = np.diag([100.0, 100.0, 100.0, 100.0])


def residual(a, b):
    d = a - b
    d[1] = math.remainder(d[1], 2.0 * math.pi)
    return d


def across_south(seed):
    rng = np.random.default_rng(seed)
    x = SOUTH + np.outer(TIMES[:12], [20.0, 4.0, 0.0, 0.0])
    z = doppler(x) + rng.multivariate_normal(np.zeros(3), DOPPLER_NOISE, 12)
    z[:, 1] = np.angle(np.exp(1j * z[:, 1]))
    assert np.ptp(z[:, 1]) > 6.0
    return z


def doppler_radar(jacobian):
    return MeasurementModel("doppler", 0.95, 1e-9, doppler, DOPPLER_NOISE, jacobian, angles=(1,))


def peer_states(peer, predict, update, z):
    means, covs = [], []
    for k, dt in enumerate([0.0, *np.diff(TIMES)][: len(z)]):
        if k:
            predict(peer, dt)
        update(peer, z[k])
        means.append(peer.x.copy())
        covs.append(peer.P.copy())
    return np.array(means), np.array(covs)


@pytest.mark.parametrize("seed", range(3))
def test_doppler_with_a_jacobian_is_filterpys_extended_filter_also_across_south(seed):
    z = across_south(seed)
    motion = constant_velocity(2, 1.0)
    peer = ExtendedKalmanFilter(4, 3)
    peer.x = SOUTH.copy()
    peer.P = WIDE.copy()
    peer.R = DOPPLER_NOISE

    def predict(peer, dt):
        peer.F = np.kron([[1.0, dt], [0.0, 1.0]], np.eye(2))
        peer.Q = motion.process_noise(dt)
        peer.predict()

    def update(peer, z):
        peer.update(
            z,
            lambda x: doppler_jacobian(x[None])[0],
            lambda x: doppler(x[None])[0],
            residual=residual,
        )

    means, covs = peer_states(peer, predict, update, z)
    found = one_track([row[None] for row in z], doppler_radar(doppler_jacobian), motion, prior=(SOUTH, WIDE))
    np.testing.assert_allclose(found.mean, means, atol=1e-6)
    np.testing.assert_allclose(found.cov, covs, atol=1e-6)


def turn(x, dt):
    """Coordinated turn of states x, y, vx, vy, w (rad/s)."""
    w = np.where(np.abs(x[:, 4]) < 1e-6, 1e-6, x[:, 4])
    s = np.sin(w * dt)
    c = np.cos(w * dt)
    px, py, vx, vy, _ = x.T
    return np.column_stack(
        [
            px + (s * vx - (1 - c) * vy) / w,
            py + ((1 - c) * vx + s * vy) / w,
            c * vx - s * vy,
            s * vx + c * vy,
            x[:, 4],
        ]
    )


def turn_noise(dt):
    Q = np.zeros((5, 5))
    Q[:4, :4] = constant_velocity(2, 1.0).process_noise(dt)
    Q[4, 4] = 1e-4 * dt
    return Q


TURN = MotionModel(("x", "y", "vx", "vy", "w"), turn, turn_noise)


def test_a_turn_without_jacobians_is_filterpys_filter_with_cubature_points():
    rng = np.random.default_rng(5)
    start = np.array([900.0, 300.0, 30.0, 0.0, 0.05])
    prior = np.diag([100.0, 100.0, 25.0, 25.0, 0.01])
    x = start[None]
    z = []
    for dt in [0.0, *np.diff(TIMES)]:
        x = turn(x, dt)
        z.append(np.array([np.hypot(x[0, 0], x[0, 1]), np.arctan2(x[0, 0], x[0, 1])]))
    R = np.diag([25.0, 1e-4])
    z = np.array(z) + rng.multivariate_normal(np.zeros(2), R, len(z))
    polar = MeasurementModel("polar", 0.95, 1e-9, range_bearing, R, angles=(1,))
    # An unscented filter with kappa = 0 has the points and weights of the cubature rule.
    points = JulierSigmaPoints(5, kappa=0.0)
    peer = UnscentedKalmanFilter(
        5,
        2,
        1.0,
        lambda x: range_bearing(x[None])[0],
        lambda x, dt: turn(x[None], dt)[0],
        points,
        residual_z=residual,
    )
    peer.x = start.copy()
    peer.P = prior.copy()
    peer.R = R

    def predict(peer, dt):
        peer.Q = turn_noise(dt)
        peer.predict(dt)

    def update(peer, z):
        peer.sigmas_f = points.sigma_points(peer.x, peer.P)
        peer.update(z)

    means, covs = peer_states(peer, predict, update, z)
    found = one_track([row[None] for row in z], polar, TURN, prior=(start, prior))
    np.testing.assert_allclose(found.mean, means, atol=1e-6)
    np.testing.assert_allclose(found.cov, covs, atol=1e-6)


def range_bearing(x):
    return np.column_stack([np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 0], x[:, 1])])


def test_modes_are_weighed_as_by_enumerating_all_their_sequences():
    """The mixture over mode histories: each is a Kalman filter with the likelihood of its innovations."""
    motion = SwitchingMotion((constant_velocity(2, 0.1), constant_velocity(2, 200.0)), (30.0, 5.0))
    rate = np.array([[-1 / 30, 1 / 30], [1 / 5, -1 / 5]])
    dt = 2.0
    moved = np.eye(2) + rate * (1.0 - math.exp(-dt * (1 / 30 + 1 / 5))) / (1 / 30 + 1 / 5)
    np.testing.assert_allclose(motion.mode_transition(dt), moved)
    np.testing.assert_allclose(motion.stationary_modes(), [30 / 35, 5 / 35])
    R = 25.0 * np.eye(2)
    z = np.array([[0.0, 0.0], [20.0, 2.0], [38.0, 20.0], [50.0, 55.0]])
    params = GlmbParams(0.0, survival_probability_per_s=1.0, merge_chi2=0.0, prune_weight=1e-12)
    tracker = StateSpaceGlmb(motion, params, 1)
    sensor = linear_measurement("radar", 0.9, 1e-9, np.eye(2, 4), R)
    prior = (np.zeros(4), np.diag([100.0, 100.0, 400.0, 400.0]))
    for k, row in enumerate(z):
        births = [Birth(*prior, 0.999999)] if k == 0 else []
        tracker.update(round(k * dt * 1e9), row[None], sensor, births)
    weights = {}
    for sequence in np.ndindex(2, 2, 2):
        kalman = KalmanFilter(4, 2)
        kalman.x, kalman.P = (part.copy() for part in prior)
        kalman.H = np.eye(2, 4)
        kalman.R = R
        kalman.update(z[0])
        before = np.array([30 / 35, 5 / 35])
        log_weight = 0.0
        for mode, row in zip(sequence, z[1:], strict=True):
            log_weight += math.log((before @ moved)[mode])
            before = np.eye(2)[mode]
            F = np.kron([[1.0, dt], [0.0, 1.0]], np.eye(2))
            kalman.predict(F=F, Q=motion.models[mode].process_noise(dt))
            kalman.update(row)
            log_weight += kalman.log_likelihood
        weights[sequence] = (log_weight, kalman.x[:4])
    logs = np.array([one for one, _ in weights.values()])
    share = np.exp(logs - logs.max())
    share /= share.sum()
    expected = share @ np.array([x for _, x in weights.values()])
    posterior = tracker.posterior
    found = track_probabilities(posterior.clusters, posterior.track_label.size)
    assert found.sum() > 0.999
    np.testing.assert_allclose(found @ posterior.mean / found.sum(), expected, atol=1e-3)
    by_mode = np.zeros(2)
    for (*_, last), one in zip(np.ndindex(2, 2, 2), share, strict=True):
        by_mode[last] += one
    assert 0.1 < by_mode[1] < 0.9
    np.testing.assert_allclose(found @ posterior.turn / found.sum(), by_mode, atol=1e-4)


RADAR_3D = linear_measurement("radar", 0.9, 1e-6, H, NOISE)


def of_radar(scans, births_per_s=0.0, log_ratios=None, **other):
    model = TrackingModel(PARAMS, (Birth(PLACE, PRIOR, 0.1),), births_per_s, motion=MOTION)
    times = np.arange(float(len(scans)))
    track(scans, times, replace(RADAR_3D, **other), model, log_ratios=log_ratios)


WRONG = {
    "states without y": (
        lambda: MotionModel(("x", "vx"), None, None),
        "names: expected different names with x",
    ),
    "modes of other states": (
        lambda: SwitchingMotion((constant_velocity(2, 1.0), constant_velocity(3, 1.0)), (1.0, 1.0)),
        "models: expected one or more models with the same names of states",
    ),
    "a time too few": (
        lambda: SwitchingMotion((constant_velocity(2, 1.0), constant_velocity(2, 9.0)), (1.0,)),
        "mean_time_s: expected 2 times above 0",
    ),
    "four axes": (lambda: constant_velocity(4, 1.0), "axes: expected 2 or 3, got 4"),
    "a flat noise": (lambda: linear_measurement("a", 0.9, 1e-6, H, [1.0, 1.0, 1.0]), "noise_cov: expected"),
    "a probability of 2": (
        lambda: linear_measurement("a", 2.0, 1e-6, H, NOISE),
        "detection_probability: exp",
    ),
    "no motion": (
        lambda: track([[]], [0.0], RADAR_3D, TrackingModel(PARAMS, births_per_s=1.0)),
        "model: expected TrackingModel.motion, of the states that radar measures",
    ),
    "two coordinates of three": (lambda: of_radar([np.zeros((4, 2))]), "scans[0]: expected shape (m, 3)"),
    "ratios of another scan": (
        lambda: of_radar([np.zeros((4, 3))], log_ratios=[np.zeros(3)]),
        "log_ratios[0]: expected shape (4,), one for each detection of the scan; got (3,)",
    ),
    "births anywhere of a sensor without them": (
        lambda: of_radar([np.zeros((1, 3))], births_per_s=1.0),
        "birth of sensor radar: expected a function, for births anywhere",
    ),
    "a function of another shape": (
        lambda: of_radar([np.zeros((1, 3))], expected=lambda x: x[:, 0], jacobian=None),
        "a model's function: expected to return the shape",
    ),
    "noise twice": (
        lambda: TrackingModel(GlmbParams(1.0), births_per_s=1.0, motion=MOTION),
        "params: expected accel_psd_m2_s3=0",
    ),
    "a birth of four states": (
        lambda: TrackingModel(PARAMS, (Birth(np.zeros(4), np.eye(4), 0.1),), motion=MOTION),
        "births[0].mean: expected shape (6,), x, y, z, vx, vy, vz",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_model_is_refused_in_words(case):
    wrong, said = WRONG[case]
    with pytest.raises(ValueError, match="expected") as raised:
        wrong()
    assert said in str(raised.value)
