"""A hidden GPS jump, or a jump that no vehicle flew, misleads the reader of the report."""

import numpy as np
import pytest

from gcs.report.telemetry.smoothed_path import smooth_path

TIMES_S = 0.5 * np.arange(120)


def turning(speed_m_s, bank_deg, times_s, noise_m, seed=1):
    """Reports of an aeroplane that circles, and the length of what it flew."""
    rate = 9.81 * np.tan(np.radians(bank_deg)) / speed_m_s
    angle = rate * times_s
    circle = speed_m_s / rate * np.column_stack([np.cos(angle), np.sin(angle)])
    noise = np.random.default_rng(seed).normal(0.0, noise_m, circle.shape)
    return circle + noise, speed_m_s * np.ptp(times_s)


@pytest.mark.parametrize("period_s", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("bank_deg", [1.0, 30.0, 45.0])
def test_a_turn_is_no_jump_and_its_length_is_that_of_the_flight(bank_deg, period_s):
    times_s = np.arange(0.0, 120.0, period_s)
    reports_m, flown_m = turning(25.0, bank_deg, times_s, noise_m=1.0)
    path = smooth_path(times_s, reports_m)
    assert path.jumps == ()
    assert path.length_m == pytest.approx(flown_m, rel=0.03)


def test_standing_with_noise_is_hardly_a_flight():
    rng = np.random.default_rng(2)
    reports_m = rng.normal(0.0, 1.0, (120, 2))
    path = smooth_path(TIMES_S, reports_m)
    assert path.jumps == ()
    assert path.length_m < 0.5 * np.hypot(*np.diff(reports_m, axis=0).T).sum()


def test_a_glitch_jumps_out_and_back_and_adds_no_length():
    reports_m, flown_m = turning(20.0, 30.0, TIMES_S, noise_m=0.5)
    reports_m[50:56] += [30.0, -40.0]
    path = smooth_path(TIMES_S, reports_m)
    assert [jump.report for jump in path.jumps] == [50, 56]
    assert [jump.size_m for jump in path.jumps] == pytest.approx([50.0, 50.0], abs=6.0)
    assert path.length_m == pytest.approx(flown_m, rel=0.05)
    assert np.hypot(*(path.points_m - reports_m).T).max() < 5.0


def test_without_a_boot_clock_nothing_is_claimed():
    reports_m, _ = turning(20.0, 30.0, TIMES_S, noise_m=0.5)
    assert smooth_path(np.zeros(120), reports_m).jumps == ()
    rebooted = np.concatenate([TIMES_S[:60] + 1000.0, TIMES_S[:60]])
    assert smooth_path(rebooted, reports_m).jumps == ()
    assert smooth_path(np.empty(0), np.empty((0, 2))).length_m == 0.0
