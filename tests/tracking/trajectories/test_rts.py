"""A wrong smoother biases every path: it is compared with the exact linear-Gaussian posterior."""

import numpy as np
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import Sensor
from gcs.tracking.models import constant_velocity
from gcs.tracking.trajectories.rts import FilterStep, run_filter, smooth_states

PRIOR = np.diag([100.0, 100.0, 25.0, 25.0])


def history(seed, n, missed=0.3):
    rng = np.random.default_rng(seed)
    sensor = Sensor("s", 0.9, 1e-6, np.diag([9.0, 16.0]), (-1e4, -1e4, 1e4, 1e4))
    steps = []
    for k in range(n):
        dt = float(rng.uniform(0.1, 3.0))
        z = None if rng.random() < missed else rng.normal((5.0 * k, 0.0), 30.0)
        steps.append(
            FilterStep(
                dt, constant_velocity.transition(dt), constant_velocity.process_noise(dt, 4.0), sensor, z
            )
        )
    return rng.normal(0, 10, 4), steps


def joint_posterior(mean, steps, upto):
    """Mean (n, 4) of all states given the detections of the first `upto` steps: one big linear system."""
    n = len(steps)
    information = np.zeros((4 * n, 4 * n))
    vector = np.zeros(4 * n)
    information[:4, :4] += np.linalg.inv(PRIOR)
    vector[:4] += np.linalg.inv(PRIOR) @ mean
    for k, step in enumerate(steps):
        here = slice(4 * k, 4 * k + 4)
        if k:
            W = np.linalg.inv(step.Q)
            before = slice(4 * k - 4, 4 * k)
            information[before, before] += step.F.T @ W @ step.F
            information[before, here] -= step.F.T @ W
            information[here, before] -= W @ step.F
            information[here, here] += W
        if step.z_m is not None and k < upto:
            H = np.eye(2, 4)
            information[here, here] += H.T @ np.linalg.inv(step.sensor.noise_cov_m2) @ H
            vector[here] += H.T @ np.linalg.inv(step.sensor.noise_cov_m2) @ step.z_m
    return np.linalg.solve(information, vector).reshape(n, 4)


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 8))
def test_each_state_is_the_posterior_of_its_scans(seed, n):
    mean, steps = history(seed, n)
    run = run_filter(mean, PRIOR, steps)
    whole = smooth_states(run)[0]
    for k in range(n):
        for result, upto in ((run.mean, k + 1), (whole, n)):
            np.testing.assert_allclose(result[k], joint_posterior(mean, steps, upto)[k], atol=1e-5)


def test_filter_and_smoother_agree_with_filterpy():
    mean, steps = history(4, 30, missed=0.0)
    run = run_filter(mean, PRIOR, steps)
    kalman = KalmanFilter(4, 2)
    kalman.x = mean.copy()
    kalman.P = PRIOR.copy()
    kalman.H = np.eye(2, 4)
    means = []
    covs = []
    for k, step in enumerate(steps):
        if k:
            kalman.predict(F=step.F, Q=step.Q)
        kalman.update(step.z_m, R=step.sensor.noise_cov_m2)
        means.append(kalman.x.copy())
        covs.append(kalman.P.copy())
    np.testing.assert_allclose(run.mean, means, atol=1e-8)
    np.testing.assert_allclose(run.cov, covs, atol=1e-8)
    expected, expected_cov, _, _ = kalman.rts_smoother(
        np.array(means), np.array(covs), [step.F for step in steps], [step.Q for step in steps]
    )
    mean_out, cov_out = smooth_states(run)
    np.testing.assert_allclose(mean_out, expected, atol=1e-6)
    np.testing.assert_allclose(cov_out, expected_cov, atol=1e-6)


@given(seed=st.integers(0, 1000), n=st.integers(1, 30))
def test_what_comes_later_never_makes_a_state_less_certain(seed, n):
    mean, steps = history(seed, n)
    run = run_filter(mean, PRIOR, steps)
    _, cov = smooth_states(run)
    assert (np.trace(cov, axis1=1, axis2=2) <= np.trace(run.cov, axis1=1, axis2=2) + 1e-9).all()
    assert (np.linalg.eigvalsh(cov) > 0).all()
