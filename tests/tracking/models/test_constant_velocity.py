"""A wrong F or Q makes gates too wide or too narrow, and estimates depend on the number of predictions."""

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise, van_loan_discretization
from hypothesis import given
from hypothesis import strategies as st

from gcs.tracking.models import constant_velocity

DT = st.floats(0.0, 60.0)


@pytest.mark.parametrize("dt_s", [0.05, 1.0, 7.5])
def test_noise_and_transition_agree_with_filterpy(dt_s):
    block = Q_continuous_white_noise(dim=2, dt=dt_s, spectral_density=9.0)
    expected = np.kron(block, np.eye(2))  # state order: both positions, then both velocities
    np.testing.assert_allclose(constant_velocity.process_noise(dt_s, 9.0), expected, rtol=1e-12)
    F, Q = van_loan_discretization(
        np.kron([[0, 1], [0, 0]], np.eye(2)), np.kron([[0], [3.0]], np.eye(2)), dt_s
    )
    np.testing.assert_allclose(constant_velocity.transition(dt_s), F, atol=1e-9)
    np.testing.assert_allclose(constant_velocity.process_noise(dt_s, 9.0), Q, rtol=1e-6, atol=1e-9)


@given(first=DT, second=DT)
def test_two_steps_are_one_long_step(first, second):
    F = constant_velocity.transition(second)
    Q = constant_velocity.process_noise(second, 4.0)
    both = F @ constant_velocity.process_noise(first, 4.0) @ F.T + Q
    np.testing.assert_allclose(
        both, constant_velocity.process_noise(first + second, 4.0), rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(
        F @ constant_velocity.transition(first), constant_velocity.transition(first + second)
    )


def test_no_time_means_no_motion_and_no_noise():
    assert np.array_equal(constant_velocity.transition(0.0), np.eye(4))
    assert not constant_velocity.process_noise(0.0, 5.0).any()


@pytest.mark.parametrize("dt_s", [0.05, 1.0, 7.5])
def test_piecewise_noise_is_one_draw_of_the_acceleration_for_each_scan(dt_s):
    gain = np.kron([[dt_s**2 / 2.0], [dt_s]], np.eye(2))
    np.testing.assert_allclose(
        constant_velocity.piecewise_process_noise(dt_s, 3.0), 9.0 * gain @ gain.T, rtol=1e-12
    )
