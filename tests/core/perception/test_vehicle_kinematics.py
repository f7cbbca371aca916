"""A user would lose aircraft: a route that begins on another course than its vehicle leads into obstacles."""

import math

import pytest
from helpers.staging import at, circle, state, track

from gcs.core.perception.vehicle_kinematics import VehicleKinematics
from gcs.core.state import State

CENTRE, RADIUS_M, SPEED_M_S = (500.0, 500.0), 60.0, 15.0


def circling(t_s):
    place, course_rad = circle(CENTRE, RADIUS_M, SPEED_M_S, t_s)
    return state(1, place, t_s, speed_m_s=SPEED_M_S, course_rad=course_rad)


def after(seconds, *, seen_at=None, now_s=None):
    motions = VehicleKinematics(State.initial([1]).agents, max_age_s=1.0)
    for t_s in range(seconds + 1):
        motions.update([circling(float(t_s))])
    place = circle(CENTRE, RADIUS_M, SPEED_M_S, float(seconds))[0] if seen_at is None else seen_at
    now = at(float(seconds) if now_s is None else now_s)
    return motions.motions({1: track((0, 1), place, (3.0, 4.0))}, now, at(float(seconds)))[1]


def test_the_turn_rate_of_a_vehicle_that_circles_is_known_from_its_reports():
    motion = after(3)
    assert motion.turn_rate_rad_s == pytest.approx(SPEED_M_S / RADIUS_M)
    assert motion.course_rad == pytest.approx(circling(3.0).course_rad)


def test_one_report_gives_no_turn_rate():
    assert after(0).turn_rate_rad_s == 0.0


@pytest.mark.parametrize("wrong", [{"now_s": 4.5}, {"seen_at": (300.0, 300.0)}], ids=["old", "elsewhere"])
def test_reports_that_are_old_or_far_from_the_track_are_not_used(wrong):
    motion = after(3, **wrong)
    assert (motion.speed_m_s, motion.turn_rate_rad_s) == (5.0, 0.0)
    assert motion.course_rad == pytest.approx(math.atan2(3.0, 4.0))


def test_a_gap_between_reports_is_not_taken_for_a_turn():
    motions = VehicleKinematics(State.initial([1]).agents, max_age_s=1.0)
    motions.update([circling(0.0)])
    motions.update([circling(10.0)])
    place = (circling(10.0).east_m, circling(10.0).north_m)
    assert motions.motions({1: track((0, 1), place)}, at(10.0), at(10.0))[1].turn_rate_rad_s == 0.0
