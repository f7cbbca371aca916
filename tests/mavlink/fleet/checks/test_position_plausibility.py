"""A user would task a vehicle by a place where it is not: contradictions in its own reports are refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.mavlink.fleet.checks.position_plausibility import DuplicateIdDetector, MotionCheck, Report
from gcs.model import NoticeCode

S = 1_000_000_000


def report(t_s, east_m, north_m=0.0, speed_m_s=15.0, boot_s=0.0, delay_s=0.0):
    return Report(round((t_s + delay_s) * S), round((t_s - boot_s) * 1000), east_m, north_m, speed_m_s)


def checked(reports, max_speed_m_s=75.0):
    motion, news = MotionCheck(), []
    return [
        motion.check_report(one, max_speed_m_s, lambda code, **parameters: news.append((code, parameters)))
        for one in reports
    ], news


def duplicates_in(reports):
    detector, news = DuplicateIdDetector(), []
    for one in reports:
        detector.add_report(one, 75.0, lambda code, **parameters: news.append((code, parameters)))
    return detector.has_duplicate, news


def flight(t_s, *, seconds=20.0, east_m=0.0, rate_hz=4.0, **settings):
    times = np.arange(t_s, t_s + seconds, 1.0 / rate_hz)
    return [report(t, east_m + 15.0 * (t - t_s), **settings) for t in times]


@given(
    st.floats(0.2, 10.0),
    st.floats(0.0, 25.0),
    st.lists(st.floats(-0.5, 0.5), min_size=30, max_size=30),
    st.floats(0.0, 3.0),
)
@settings(max_examples=60)
def test_any_flight_with_noise_and_gaps_is_accepted(rate_hz, speed_m_s, turns, noise_m):
    rng = np.random.default_rng(1)
    place, course, reports = np.zeros(2), 0.0, []
    for n, turn in enumerate(turns):
        course += turn
        place = place + speed_m_s / rate_hz * np.array([np.sin(course), np.cos(course)])
        reports.append(report(n / rate_hz, *(place + rng.normal(0, noise_m + 0.5, 2)), speed_m_s))
    refusals, news = checked(reports)
    assert not any(refusals)
    assert news == []
    assert duplicates_in(reports) == (False, [])


def test_one_place_out_of_reach_is_refused_and_the_flight_goes_on():
    reports = flight(0.0)
    reports[40] = report(10.0, 5000.0)
    refusals, news = checked(reports)
    assert [n for n, refusal in enumerate(refusals) if refusal] == [40]
    assert news == []


def test_a_jump_that_lasts_is_accepted_in_the_end_with_an_alarm():
    refusals, news = checked(flight(0.0, seconds=10) + flight(10.0, east_m=5000.0))
    assert refusals[40:48] == ["jump"] * 8
    assert not any(refusals[:40] + refusals[48:])
    ((code, parameters),) = news
    assert code is NoticeCode.POSITION_JUMP
    assert parameters["distance_m"] == pytest.approx(4884.0, abs=1.0)


def test_a_long_gap_is_no_jump():
    assert not any(checked(flight(0.0) + flight(200.0, east_m=5000.0))[0])


def test_a_ground_speed_that_no_airframe_has_is_refused():
    assert checked([report(0, 0), report(1, 15, speed_m_s=300.0)])[0] == ["", "speed"]


def test_a_place_that_stands_still_at_speed_is_frozen_until_it_moves():
    reports = flight(0.0, seconds=5)
    reports += [report(5 + n / 4, reports[-1].east_m) for n in range(40)] + flight(15.0, east_m=100.0)
    refusals, news = checked(reports)
    assert refusals[20:35] == [""] * 15, "sixty metres of way before it is sure"
    assert set(refusals[35:60]) == {"frozen"}
    assert not any(refusals[60:])
    assert [code for code, _ in news] == [NoticeCode.POSITION_FROZEN, NoticeCode.POSITION_MOVES]


def test_what_stands_on_the_ground_is_not_frozen():
    assert checked([report(n, 0.0, speed_m_s=0.2) for n in range(200)]) == ([""] * 200, [])


def test_after_a_reboot_it_may_be_anywhere():
    motion = MotionCheck()
    motion.check_report(report(0, 0), 75.0, print)
    motion.begin()
    assert motion.check_report(report(1, 9000), 75.0, print) == ""


@pytest.mark.parametrize(
    ("other", "difference"),
    [
        ({"boot_s": -50.0}, ("boots_s", 50.0)),
        ({"east_m": 900.0}, ("distance_m", 900.0)),
    ],
)
def test_two_vehicles_with_one_system_id_are_reported_and_so_is_the_end_of_it(other, difference):
    one, two = flight(0.0), flight(0.1, **other)
    both = sorted(one + two, key=lambda r: r.t_ns)
    assert duplicates_in(both)[0] is True
    two_now, news = duplicates_in(both + flight(20.0, east_m=300.0, seconds=15))
    assert two_now is False
    assert [code for code, _ in news] == [NoticeCode.DUPLICATE_ID, NoticeCode.DUPLICATE_ID_OVER]
    name, value = difference
    assert news[0][1][name] == pytest.approx(value, abs=3.0)


def test_a_reboot_and_reports_that_come_late_are_one_vehicle():
    assert duplicates_in(flight(0.0) + flight(25.0, boot_s=24.0, east_m=300.0)) == (False, [])
    late = [report(t / 4, 15 * t / 4, delay_s=3.0 if t % 3 else 0.0) for t in range(80)]
    assert duplicates_in(sorted(late, key=lambda r: r.t_ns)) == (False, [])
