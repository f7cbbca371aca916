"""The vehicle flies the paper's model: its poles, its gain, its turn, and nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st

from sim_vehicles.vehicle.paper_airframe import TURN_TIME_S, A, Airframe, B, closed_loop


def continuous_poles(transition: np.ndarray) -> np.ndarray:
    return np.sort_complex(np.log(np.linalg.eigvals(transition).astype(complex)) / 0.01)


def test_discretisation_and_gain_agree_with_scipy():
    loop = closed_loop()
    block = np.zeros((7, 7))
    block[:5, :5], block[:5, 5:] = A, B
    exact = scipy.linalg.expm(block * 0.01)
    np.testing.assert_allclose(loop.F, exact[:5, :5], atol=1e-12)
    np.testing.assert_allclose(loop.G, exact[:5, 5:], atol=1e-12)
    p = scipy.linalg.solve_discrete_are(loop.F, loop.G, np.eye(5), np.eye(2))
    gain = np.linalg.solve(np.eye(2) + loop.G.T @ p @ loop.G, loop.G.T @ p @ loop.F)
    np.testing.assert_allclose(loop.gain, gain, atol=1e-9)


def test_gain_is_the_published_one():
    published = [[-0.1076, -0.0818, 0.5068, 2.0877, 0.9392], [-0.0926, -0.1703, 0.2149, -0.9184, -0.0974]]
    np.testing.assert_allclose(closed_loop().gain, published, atol=6e-5)


def test_poles_open_and_closed():
    open_loop = continuous_poles(closed_loop().F)
    np.testing.assert_allclose(open_loop.real, [-16.887, -2.486, -2.486, -0.1228, 0.0], atol=1e-3)
    slowest = continuous_poles(closed_loop().transition)[-2:]
    np.testing.assert_allclose(slowest, [-0.5315 - 0.3035j, -0.5315 + 0.3035j], atol=1e-4)


@given(
    st.lists(st.floats(-2, 2), min_size=4, max_size=4),
    st.floats(-3, 3),
    st.floats(-3, 3),
    st.floats(1, 40),
)
def test_step_is_the_matrix_step(state, heading, error, speed):
    loop = closed_loop()
    airframe = Airframe(10.0, 20.0, 100.0, heading, speed)
    airframe.sideslip_m_s, airframe.roll_rate_rad_s, airframe.yaw_rate_rad_s, airframe.roll_rad = state
    x = np.array([*state, heading])
    expected = loop.transition @ x + loop.command * (heading + error)
    v = state[0]
    airframe.step(error, 100.0, speed)
    got = [
        airframe.sideslip_m_s, airframe.roll_rate_rad_s, airframe.yaw_rate_rad_s, airframe.roll_rad,
        airframe.heading_rad,
    ]  # fmt: skip
    np.testing.assert_allclose(got, expected, atol=1e-10)
    assert airframe.east_m == pytest.approx(10.0 + 0.01 * (speed * math.sin(heading) + v * math.cos(heading)))
    assert airframe.north_m == pytest.approx(
        20.0 + 0.01 * (speed * math.cos(heading) - v * math.sin(heading))
    )


def test_a_right_angle_turn_needs_the_papers_time():
    airframe, target = Airframe(0, 0, 100, 0, 15), math.pi / 2
    reached_s = settled_s = 0.0
    peak = 0.0
    for step in range(2000):
        airframe.step(target - airframe.heading_rad, 100.0, 15.0)
        reached_s = reached_s or (step / 100 if airframe.heading_rad > 0.632 * target else 0.0)
        if abs(airframe.heading_rad - target) > 0.02 * target:
            settled_s = step / 100
        peak = max(peak, airframe.heading_rad)
    assert reached_s == pytest.approx(3.2, abs=0.1)
    assert settled_s == pytest.approx(7.1, abs=0.1)
    assert peak / target == pytest.approx(1.004, abs=0.001)


def test_a_steady_turn_needs_the_documented_heading_error_and_hardly_slips():
    airframe = Airframe(0, 0, 100, 0, 15)
    for _ in range(3000):
        airframe.step(0.5, 100.0, 15.0)
    assert 0.5 / airframe.yaw_rate_rad_s == pytest.approx(TURN_TIME_S, abs=1e-3)
    assert airframe.roll_rad > 0.0
    assert abs(airframe.sideslip_m_s) < 0.05


@pytest.mark.parametrize(("heading", "target"), [(3.0, -3.0), (-3.0, 3.0), (50.0, 50.0 + 6.0)])
def test_the_short_way_round_across_south(heading, target):
    airframe = Airframe(0, 0, 100, heading, 15)
    turned = 0.0
    for _ in range(1500):
        airframe.step(target - airframe.heading_rad, 100.0, 15.0)
        turned = max(turned, abs(airframe.heading_rad - heading))
    assert turned < 0.4
    assert math.cos(airframe.heading_rad - target) == pytest.approx(1.0, abs=1e-4)


def test_altitude_hold_climbs_no_faster_than_its_limit_and_arrives():
    airframe = Airframe(0, 0, 100, 0, 15)
    altitudes = []
    for _ in range(3000):
        airframe.step(0.0, 160.0, 15.0)
        altitudes.append(airframe.alt_rel_m)
    assert max(np.diff(altitudes)) <= 0.05 + 1e-9
    assert altitudes[-1] == pytest.approx(160.0, abs=0.1)
    assert max(altitudes) <= 160.0
