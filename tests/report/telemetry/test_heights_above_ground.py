"""A report would call a flight clear of the ground that was not, or blame it for its landing."""

import numpy as np
from helpers.hills import elevation_of, hill

from gcs.planning.terrain.ground import Terrain
from gcs.report.plots.run_charts import flight_figure
from gcs.report.run.tables import flown
from gcs.report.telemetry.flights import Flight, agl_m, least_agl_m

HILL = Terrain(elevation_of(hill(1000.0, 500.0, 100.0, 200.0, 300.0), 2000.0), 50.0, 120.0)


def flight(*heights_msl_m):
    """Return the flight of a vehicle eastwards over the hill, with as many reports as heights."""
    count = len(heights_msl_m)
    heights = np.array(heights_msl_m, dtype=float)
    points_m = np.column_stack((np.linspace(0.0, 2000.0, count), np.full(count, 500.0)))
    times = np.arange(float(count))
    return Flight(1, times, points_m, heights - 300.0, heights, np.full(count, 15.0), (), count, 2000.0, ())


def test_the_least_height_is_that_between_take_off_and_landing():
    landed = flight(300.0, 340.0, 380.0, 390.0, 460.0, 440.0, 380.0, 320.0, 300.0)
    above_m = agl_m(landed, HILL)
    assert above_m[4] < 65.0, "on the top of the hill"
    assert above_m[-1] < 1.0
    assert abs(least_agl_m(landed, HILL) - above_m[2:7].min()) < 1e-9
    (row,) = flown({1: landed}, HILL).rows
    assert row[flown({1: landed}, HILL).columns.index("least AGL, m")] == f"{above_m[2:7].min():.0f}"


def test_a_flight_below_the_floor_on_the_way_is_seen():
    low = flight(380.0, 380.0, 380.0, 380.0, 410.0, 380.0, 380.0, 380.0, 380.0)
    assert least_agl_m(low, HILL) < 15.0
    assert least_agl_m(flight(*[310.0] * 9), HILL) is None


def test_reports_over_flat_ground_are_as_before():
    assert "least AGL, m" not in flown({1: flight(*[380.0] * 9)}).columns
    rows = [len(flight_figure({1: flight(*[380.0] * 9)}, 9.0, terrain).axes) for terrain in (None, HILL)]
    assert rows == [3, 4]
