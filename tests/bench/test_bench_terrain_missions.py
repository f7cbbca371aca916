"""A mission between hills: the band and the distances are kept, and the bench counts what is not."""

from __future__ import annotations

from helpers.hills import elevation_of, hill
from terrain_missions import ALLOWED_M, MAX_AGL_M, MIN_AGL_M, FlownMission, Site

SITE = Site(46.8, 9.8, 1500.0, 3000.0, 3000.0, (300.0, 300.0), (220.0, 190.0), 45.0, max_duration_s=240.0)


def ground(east, north):
    hills = [(700.0, 2000.0), (1500.0, 1300.0), (2300.0, 2100.0), (2500.0, 600.0)]
    return 1500.0 + sum(hill(*place, 250.0, 300.0, 0.0)(east, north) for place in hills)


def test_three_vehicles_between_hills_keep_the_band_and_their_distances_in_wind():
    flight = FlownMission(SITE, elevation_of(ground, 3000.0), 3, 8.0, 1).fly()
    assert flight.arrived == 2
    assert flight.lost == 1
    assert not flight.outside
    assert MIN_AGL_M - ALLOWED_M <= flight.least_agl_m <= flight.greatest_agl_m <= MAX_AGL_M + ALLOWED_M
    assert not flight.near


def test_samples_outside_the_band_and_near_pairs_are_counted():
    mission = FlownMission(SITE, elevation_of(ground, 3000.0), 2, 0.0, 1)
    base_m = float(ground(300.0, 300.0))
    mission.times_s = [0.2, 0.4, 0.6, 0.8]
    mission.places = [
        [(300.0, 300.0, base_m + high_m), (300.0 + apart_m, 300.0, base_m + 60.0)]
        for high_m, apart_m in ((80.0, 50.0), (65.0, 50.0), (65.0, 40.0), (39.0, 40.0))
    ]
    mission.look()
    assert [(one.vehicle, one.t_s) for one in mission.flight.outside] == [(1, 0.8)]
    (pair,) = mission.flight.near
    assert (pair.begin_s, pair.end_s, round(pair.distance_m)) == (0.4, 0.6, 40)
