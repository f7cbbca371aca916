"""A user would trust a vehicle whose reports contradict each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.mavlink.fleet.checks.report_consistency import ReportConsistency, Sample
from gcs.model import NoticeCode

S = 1_000_000_000


def sample(t_s, place, velocity, alt_m=100.0, frames=0, delay_s=0.0, armed=True):
    return Sample(
        round((t_s + delay_s) * S),
        round(t_s * 1000),
        round(delay_s * S),
        *place,
        alt_m,
        *velocity,
        frames,
        armed,
    )


def notices(samples, home_alt_m=50.0):
    checks, found = ReportConsistency(), []
    for one in samples:
        checks.add_sample(one, home_alt_m, lambda code, **parameters: found.append((code, parameters)))
    return found


def turning(seconds, *, radius_m=40.0, speed_m_s=22.0, factor=1.0, seed=1, noise_m=2.0, rate_hz=4.0):
    """A vehicle that circles; arrivals are delayed by up to 2 s, and a third of the reports is lost."""
    rng = np.random.default_rng(seed)
    for k in range(int(seconds * rate_hz)):
        if rng.random() < 0.3:
            continue
        t_s, angle = k / rate_hz, k / rate_hz * speed_m_s / radius_m
        place = np.array([radius_m * math.sin(angle), radius_m * math.cos(angle)]) + rng.normal(0, noise_m, 2)
        velocity = (factor * speed_m_s * math.cos(angle), -factor * speed_m_s * math.sin(angle))
        yield sample(t_s, place.tolist(), velocity, 100.0 + rng.normal(0, 3.0), delay_s=rng.uniform(0, 2))


@pytest.mark.parametrize("seed", range(20))
def test_a_vehicle_that_turns_tightly_over_a_bad_link_is_consistent(seed):
    assert notices(turning(120.0, seed=seed)) == []
    assert notices(turning(120.0, seed=seed, radius_m=500.0, speed_m_s=60.0)) == []
    assert notices(turning(120.0, seed=seed, speed_m_s=0.0)) == []


@pytest.mark.parametrize("factor", [-1.0, 0.0, 2.0])
def test_a_velocity_that_contradicts_the_positions_is_an_alarm_with_an_all_clear(factor):
    wrong = list(turning(30.0, radius_m=1000.0, factor=factor))
    later = [sample(40.0 + k, (22.0 * k, 0.0), (22.0, 0.0)) for k in range(20)]
    found = notices([*wrong, *later])
    assert [code for code, _ in found] == [NoticeCode.VELOCITY_WRONG, NoticeCode.VELOCITY_RIGHT]


def test_a_height_that_jumps_or_that_no_vehicle_has_is_an_alarm():
    heights = [100.0] * 5 + [9000.0] * 5 + [100.0] * 5
    found = notices(sample(k, (22.0 * k, 0.0), (22.0, 0.0), alt_m) for k, alt_m in enumerate(heights))
    assert found == [
        (NoticeCode.HEIGHT_JUMP, {"jump_m": 8900.0}),
        (NoticeCode.HEIGHT_WRONG, {"height_m": 8950.0}),
        (NoticeCode.HEIGHT_JUMP, {"jump_m": -8900.0}),
        (NoticeCode.HEIGHT_RIGHT, {}),
    ]
    climb = notices(sample(k, (0.0, 0.0), (0.0, 0.0), 50.0 + 20.0 * k) for k in range(60))
    assert climb == []


def test_an_estimator_that_finds_its_origin_on_the_ground_is_no_alarm():
    """Recorded with ArduPlane: the height goes from 0 to that of the field, 584 m, before it is armed."""
    heights = [0.0] * 5 + [584.0] * 5
    samples = [sample(k, (0.0, 0.0), (0.0, 0.0), alt, armed=False) for k, alt in enumerate(heights)]
    assert notices(samples, home_alt_m=584.0) == []


def test_a_flood_of_frames_is_a_warning_that_ends():
    frames = np.cumsum([50] * 10 + [5000] * 10 + [50] * 10)
    found = notices(sample(k, (0.0, 0.0), (0.0, 0.0), frames=int(n)) for k, n in enumerate(frames))
    assert found == [
        (NoticeCode.FRAME_RATE_HIGH, {"rate_hz": 5000.0}),
        (NoticeCode.FRAME_RATE_NORMAL, {}),
    ]


def flown(t_s, delay_s=0.0):
    return sample(t_s, (22.0 * t_s, 0.0), (22.0, 0.0), delay_s=delay_s)


def test_reports_that_wait_in_a_radio_are_a_warning_that_ends():
    """Before, agents were "not seen where they report to be", and nothing named the radio."""
    delays_s = [0.1] * 30 + [0.1 + 0.1 * k for k in range(30)] + [3.1] * 600 + [0.2] * 40
    found = notices(flown(float(k), delay_s) for k, delay_s in enumerate(delays_s))
    assert [code for code, _ in found] == [NoticeCode.REPORTS_LATE, NoticeCode.REPORTS_IN_TIME]
    assert found[0][1]["delay_s"] == pytest.approx(1.5, abs=0.2)


def test_a_reboot_and_a_clock_that_drifts_do_not_make_reports_late():
    drifting = [flown(float(k), 0.1 + 2e-4 * k) for k in range(20_000)]
    assert notices(drifting) == []
    booted = [sample(k, (0.0, 0.0), (0.0, 0.0), delay_s=60.0) for k in range(60)]
    assert notices([*map(flown, range(60)), *booted]) == []


def test_a_position_that_is_seen_twice_does_not_hide_the_delay_and_a_boot_ends_the_warning():
    """Over an overloaded radio some seconds bring no new position; that began the measurement anew."""
    late = [flown(float(k), 0.1 if k < 30 else 3.1) for k in range(90)]
    twice = [one for k, one in enumerate(late) for one in ([one, one] if k % 7 == 0 else [one])]
    booted = [sample(k, (0.0, 0.0), (0.0, 0.0), delay_s=200.0) for k in range(10)]
    found = [code for code, _ in notices([*twice, *booted])]
    assert found == [NoticeCode.REPORTS_LATE, NoticeCode.REPORTS_IN_TIME]


@pytest.mark.parametrize("seed", range(20))
def test_single_reports_that_come_late_are_no_warning(seed):
    rng = np.random.default_rng(seed)
    assert notices(flown(float(k), float(rng.exponential(0.3))) for k in range(600)) == []
