"""Heights of a route that keep its flight, which is late and cuts corners, inside the flight band."""

import numpy as np
import pytest
from helpers.random_terrain import hills
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.terrain.band import Vertical, make_band
from gcs.planning.terrain.detour import AvoidedFlight, band_beside
from gcs.planning.terrain.flown_route import FlightModel, fly_route, worst_departure_m
from gcs.planning.terrain.height_correction import correct_heights
from gcs.planning.terrain.route import TerrainRoute
from gcs.planning.terrain.terrain_map import BandCircle
from gcs.terrain.elevation_grid import Elevation

MODEL = FlightModel(15.0, 1.0, TurnAnticipation(40.0, 15.0, 5.0))
RATES = Vertical(0.2, 0.25)


def drawn_route(seed):
    """Return a band, and a route with heights near its middle at each waypoint."""
    band = make_band(hills(seed, 130, 25.0), 50.0, 120.0)
    rng = np.random.default_rng(seed)
    along_m = np.linspace(100.0, 1000.0, 8)
    points_m = np.column_stack((along_m, 550.0 + rng.uniform(-60.0, 60.0, 8)))
    heights_m = band.limits_at(points_m).mean(axis=1) + rng.uniform(-20.0, 20.0, 8)
    circle = BandCircle(
        1000.0, points_m[-1, 1] - 60.0, 60.0, heights_m[-1], heights_m[-1], is_clockwise=False
    )
    return band, TerrainRoute(points_m, heights_m, circle, 1000.0), rng


def rises(route):
    return np.diff(route.heights_msl_m) / np.hypot(*np.diff(route.points_m, axis=0).T)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_no_other_heights_leave_the_band_less(seed):
    """Nor does a leg become steeper than the vehicle climbs and sinks, or than it was; both ends stay."""
    band, route, rng = drawn_route(seed)
    flown = fly_route(route, MODEL)
    corrected = correct_heights(band, route, flown, RATES)
    before_m, after_m = (max(worst_departure_m(band, one, MODEL), 0.0) for one in (route, corrected))
    assert after_m <= before_m + 0.5
    slopes, given_slopes = rises(corrected), rises(route)
    assert (slopes <= np.maximum(RATES.climb_gradient, given_slopes) + 1e-6).all()
    assert (slopes >= np.minimum(-RATES.sink_gradient, given_slopes) - 1e-6).all()
    assert corrected.heights_msl_m[[0, -1]] == pytest.approx(route.heights_msl_m[[0, -1]])
    for _ in range(20):
        changed = corrected.heights_msl_m.copy()
        changed[1:-1] += rng.normal(0.0, 3.0, 6)
        other = TerrainRoute(route.points_m, changed, route.circle, route.length_m)
        if (rises(other) > RATES.climb_gradient).any() or (rises(other) < -RATES.sink_gradient).any():
            continue
        assert max(worst_departure_m(band, other, MODEL), 0.0) >= after_m - 0.5


def test_heights_that_keep_the_flight_inside_are_kept():
    band = make_band(hills(3, 130, 0.0), 50.0, 120.0)
    points_m = np.array([[100.0, 500.0], [500.0, 500.0], [800.0, 500.0]])
    heights_m = np.array([560.0, 590.0, 600.0])
    circle = BandCircle(800.0, 440.0, 60.0, 600.0, 600.0, is_clockwise=True)
    route = TerrainRoute(points_m, heights_m, circle, 700.0)
    assert worst_departure_m(band, route, MODEL) < 0.0
    corrected = correct_heights(band, route, fly_route(route, MODEL), RATES)
    assert corrected.heights_msl_m == pytest.approx(heights_m)


@pytest.mark.parametrize("start_msl_m", [552.0, 530.0])
def test_a_late_climb_over_a_slope_begins_earlier(start_msl_m):
    """The planned heights follow the ground; 3 s late the flight is 9 m lower."""
    elevation = hills(3, relief_m=0.0)
    slope_m = np.clip(0.2 * (np.arange(60) * 20.0 - 300.0), 0.0, 100.0)
    ground = type(elevation)((0.0, 0.0), 20.0, 500.0 + np.tile(slope_m, (60, 1)))
    band = make_band(ground, 50.0, 120.0)
    points_m = np.array([[100.0, 500.0], [300.0, 500.0], [800.0, 500.0], [1000.0, 500.0]])
    heights_m = np.array([start_msl_m, 552.0, 652.0, 660.0])
    route = TerrainRoute(points_m, heights_m, BandCircle(1000.0, 440.0, 60.0, 660.0, 660.0), 900.0)
    corrected = correct_heights(band, route, fly_route(route, MODEL), RATES)
    flown = fly_route(route, MODEL)
    is_on_slope = flown.places_m[:, 0] > 350.0
    floor_m = band.limits_at(flown.places_m)[:, 0]
    below_m, corrected_m = (floor_m - flown.heights(one.heights_msl_m) for one in (route, corrected))
    assert below_m[is_on_slope].max() > 5.0
    assert corrected_m[is_on_slope].max() < 0.5


def test_a_route_beside_a_flight_that_leaves_no_height_stays_above_the_ground():
    """Where the band is closed, no height is better than another. Before, it was led to sea level there."""
    ground = Elevation((0.0, 0.0), 20.0, np.full((80, 130), 2000.0))
    at_mid = np.array([[1000.0, north_m, 2085.0] for north_m in np.arange(0.0, 460.0, 10.0)])
    band = band_beside(make_band(ground, 50.0, 120.0), [AvoidedFlight(at_mid, 60.0, 36.0)])
    points_m = np.array([[100.0, 300.0], [600.0, 420.0], [1000.0, 515.0], [1400.0, 420.0], [2000.0, 300.0]])
    circle = BandCircle(2000.0, 240.0, 60.0, 2085.0, 2085.0, is_clockwise=True)
    route = TerrainRoute(points_m, np.full(5, 2085.0), circle, 1900.0)
    flown = fly_route(route, MODEL)
    assert (np.diff(band.limits_at(flown.places_m)) < 0.0).any()
    corrected = correct_heights(band, route, flown, RATES)
    assert corrected.heights_msl_m.min() > 2050.0


def test_a_route_where_the_band_is_closed_everywhere_is_kept():
    ground = Elevation((0.0, 0.0), 20.0, np.full((80, 130), 2000.0))
    at_mid = np.array([[x, 300.0, 2085.0] for x in np.arange(0.0, 2500.0, 10.0)])
    band = band_beside(make_band(ground, 50.0, 120.0), [AvoidedFlight(at_mid, 300.0, 36.0)])
    circle = BandCircle(2000.0, 240.0, 60.0, 2085.0, 2085.0, is_clockwise=True)
    route = TerrainRoute(np.array([[100.0, 300.0], [2000.0, 300.0]]), np.full(2, 2085.0), circle, 1900.0)
    assert correct_heights(band, route, fly_route(route, MODEL), RATES) is route
