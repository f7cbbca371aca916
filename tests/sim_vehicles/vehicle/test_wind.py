"""Wind: vehicles are carried along, crab against it, and reach their waypoints on a straight course."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.model import NS_PER_S
from sim_vehicles.vehicle.guidance import ToPoint
from sim_vehicles.vehicle.paper_airframe import STEP_NS, Airframe
from sim_vehicles.vehicle.wind import Wind


def test_a_heading_held_in_wind_drifts_with_it():
    calm, windy = Airframe(0.0, 0.0, 100.0, 0.0, 15.0), Airframe(0.0, 0.0, 100.0, 0.0, 15.0)
    windy.wind_east_m_s, windy.wind_north_m_s = 3.0, -2.0
    for _ in range(1000):
        calm.step(0.0, 100.0, 15.0)
        windy.step(0.0, 100.0, 15.0)
    assert windy.east_m - calm.east_m == pytest.approx(30.0)
    assert windy.north_m - calm.north_m == pytest.approx(-20.0)
    assert windy.velocity_m_s == pytest.approx((3.0, 13.0))


def test_in_a_crosswind_the_course_to_a_point_is_straight():
    """With the heading held on the bearing the track would bend downwind by tens of metres."""
    airframe = Airframe(0.0, 0.0, 100.0, -math.asin(5.0 / 15.0), 15.0)
    airframe.wind_east_m_s = 5.0
    goal = ToPoint(0.0, 1000.0, 0.0, 1000.0, 10.0)
    aside_m = 0.0
    while not goal.is_reached(airframe):
        airframe.step(goal.heading_error_rad(airframe), 100.0, 15.0)
        aside_m = max(aside_m, abs(airframe.east_m))
    assert aside_m < 1.0


def test_gusts_have_their_deviation_and_correlation_time():
    airframe = Airframe(0.0, 0.0, 100.0, 0.0, 15.0)
    wind = Wind(4.0, 0.0, 2.0, 5.0, np.random.default_rng(1), 0)
    seen = []
    for second in range(20_000):
        wind.blow(airframe, second * NS_PER_S, airframe.alt_rel_m)
        seen.append((airframe.wind_east_m_s, airframe.wind_north_m_s))
    east, north = np.array(seen).T
    assert (east.mean(), north.mean()) == pytest.approx((4.0, 0.0), abs=0.2)
    assert (east.std(), north.std()) == pytest.approx((2.0, 2.0), rel=0.1)
    assert np.corrcoef(north[:-5], north[5:])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.05)


def test_the_wind_does_not_depend_on_how_often_it_is_read():
    places = []
    for stride in (1, 7):
        airframe = Airframe(0.0, 0.0, 100.0, 0.0, 15.0)
        wind = Wind(0.0, 0.0, 2.0, 5.0, np.random.default_rng(1), 0)
        for step in range(0, 7001, stride):
            wind.blow(airframe, step * STEP_NS, airframe.alt_rel_m)
        places.append((airframe.wind_east_m_s, airframe.wind_north_m_s))
    assert places[0] == places[1]
