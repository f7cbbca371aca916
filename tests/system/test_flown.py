"""What is flown: the track of every vehicle stays out of obstacles, wherever its route has the choice.

The last metres to a target are the target's: it may pass next to an obstacle, or over one. So a track is
checked until its vehicle is within twice the capture radius of the end of its route.
"""

from __future__ import annotations

import pytest
from helpers.flown_clearance import flown_home, in_wind, landing, nearest

from sim_vehicles.world.scenario import WindTable, load

WIND = WindTable(east_m_s=2.0, north_m_s=-2.5, gust_std_m_s=0.8)


def least_clearance_m(name: str, seed: int, wind: WindTable | None = None) -> float:
    scenario = load(name)
    return nearest(scenario if wind is None else in_wind(scenario, wind, 4.0), seed).clearance_m


@pytest.mark.parametrize(
    ("name", "wind", "clearance_m"),
    [("random-obstacles", None, 10.0), ("random-targets", WIND, 5.0), ("prescribed", WIND, 15.0)],
)
def test_no_vehicle_flies_into_an_obstacle(name, wind, clearance_m):
    assert least_clearance_m(name, 1, wind) > clearance_m


def test_between_dense_obstacles_no_vehicle_is_blown_into_one():
    """The wind is 30 % of the airspeed, with gusts. Routes that were clear in still air led into a disc."""
    wind = WindTable(east_m_s=2.94, north_m_s=-0.61, gust_std_m_s=0.75)
    assert nearest(in_wind(load("deterministic"), wind, 3.75), 11).clearance_m > 5.0


@pytest.mark.parametrize(
    ("seed", "wind_m_s"), [(11, (4.4, -0.96)), (15, (3.47, -2.87)), (16, (4.46, 0.62)), (21, (3.19, -3.17))]
)
def test_first_missions_in_wind_lead_past_obstacles_beside_the_start(seed, wind_m_s):
    """They began where vehicles had been when they were planned, and led into obstacles after 8 s."""
    wind = WindTable(east_m_s=wind_m_s[0], north_m_s=wind_m_s[1], gust_std_m_s=1.125)
    assert nearest(in_wind(load("random-obstacles"), wind, 5.6), seed, 15.0).clearance_m > 10.0


@pytest.mark.slow
def test_straight_ways_home_would_lead_into_obstacles():
    home = flown_home(landing(load("random-obstacles")), 3, straight=True).flights
    assert min(one.clearance_m for one in home.values()) == 0.0


def test_vehicles_land_at_home_with_obstacles_between():
    home = flown_home(landing(load("random-obstacles")), 3).flights
    assert len(home) == 4
    assert max(one.home_m for one in home.values()) < 100.0
    assert min(one.clearance_m for one in home.values()) > 20.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "wind"),
    [
        (name, wind)
        for name in ("deterministic", "prescribed", "random-obstacles", "random-targets")
        for wind in (None, WIND)
    ],
)
def test_no_vehicle_flies_into_an_obstacle_over_seeds(name, wind):
    """The wind is a fifth of the airspeed, with gusts."""
    clearances_m = [least_clearance_m(name, seed, wind) for seed in range(1, 9)]
    assert min(clearances_m) > 0.0, clearances_m
