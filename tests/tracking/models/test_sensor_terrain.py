"""A radar on a hill would put everything in the valley too far away, and end tracks that a ridge hides."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.ridged import ground, ridge

from gcs.model import Polar, Sensor, Viewpoint, read_only
from gcs.terrain.line_of_sight import line_of_sight, visible_share
from gcs.tracking.models.measurement_model import linearise, sensor_model
from gcs.tracking.models.sensor_geometry import covers, polar_sensor
from gcs.tracking.models.sensor_terrain import (
    ground_range_m,
    range_over_terrain_m,
    sensor_alt_msl_m,
    slant_range_m,
)

POLAR = Polar(1200.0, 1200.0, 5.0, 0.01, (0.0, 1300.0), (0.0, math.pi), 1e-3, is_slant=True)
SENSOR = Sensor("s", 0.9, 1e-6, read_only(np.eye(2) * 9.0), (0.0, 0.0, 2000.0, 2000.0))


def hills(seed: int):
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 2.0 * math.pi, 4)
    return ground(
        lambda east, north: (
            900.0
            + 60.0 * np.sin(east / 300.0 + phase[0])
            + 60.0 * np.sin(north / 250.0 + phase[1])
            + 30.0 * np.sin((east + north) / 170.0 + phase[2])
        )
    )


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("agl_m", [2.0, 85.0])
def test_a_slant_range_is_put_where_the_object_is_over_ground(seed, agl_m):
    elevation = hills(seed)
    alt_m = elevation.height_msl_m(POLAR.east_m, POLAR.north_m) + 150.0
    rng = np.random.default_rng(seed)
    true = np.column_stack([rng.uniform(200.0, 1000.0, 200), rng.uniform(-math.pi, math.pi, 200)])
    places = np.column_stack(
        [POLAR.east_m + true[:, 0] * np.sin(true[:, 1]), POLAR.north_m + true[:, 0] * np.cos(true[:, 1])]
    )
    above_m = elevation.heights_at(places) + agl_m - alt_m
    slant = np.column_stack([slant_range_m(true[:, 0], above_m), true[:, 1]])
    np.testing.assert_allclose(ground_range_m(slant[:, 0], above_m), true[:, 0], atol=1e-6)
    found = range_over_terrain_m(elevation, POLAR, slant, alt_m, agl_m)
    # Uncorrected, the greatest error is tens of metres.
    assert np.abs(slant[:, 0] - true[:, 0]).max() > 20.0
    np.testing.assert_allclose(found, true[:, 0], atol=0.5)


def test_a_sensor_stands_on_the_ground_of_the_model_at_least():
    elevation = ridge()
    assert sensor_alt_msl_m(elevation, Viewpoint(500.0, 500.0, 12.0, is_agl=True)) == pytest.approx(112.0)
    assert sensor_alt_msl_m(elevation, Viewpoint(500.0, 500.0, 95.0, is_agl=False)) == pytest.approx(101.0)
    assert sensor_alt_msl_m(elevation, Viewpoint(9e4, 0.0, 95.0, is_agl=False)) == 95.0
    assert math.isnan(sensor_alt_msl_m(elevation, Viewpoint(9e4, 0.0, 95.0, is_agl=True)))


@pytest.mark.parametrize("sensor", [SENSOR, polar_sensor("r", 0.9, replace(POLAR, east_m=500.0))])
def test_what_terrain_hides_is_not_in_the_field_of_view(sensor):
    seen = line_of_sight(ridge(), (500.0, 1200.0), 110.0, 1800.0).visibility(2.0, 2.0)
    hidden = replace(sensor, visibility=seen)
    places = np.array([[600.0, 1200.0], [1500.0, 1200.0]])
    assert covers(sensor, places).tolist() == [True, True]
    assert covers(hidden, places).tolist() == [True, False]
    mean = np.zeros((2, 4))
    mean[:, :2] = places
    cov = np.broadcast_to(np.diag([25.0, 25.0, 1.0, 1.0]), (2, 4, 4)).copy()
    assert linearise(sensor_model(sensor), mean, cov).p_in_fov == pytest.approx([1.0, 1.0], abs=1e-9)
    assert linearise(sensor_model(hidden), mean, cov).p_in_fov == pytest.approx([1.0, 0.0], abs=1e-9)


def test_of_a_wide_track_that_is_seen_in_part_that_part_counts():
    seen = line_of_sight(ridge(), (500.0, 1200.0), 110.0, 1800.0).visibility(2.0, 2.0)
    sensor = replace(SENSOR, visibility=seen)
    mean = np.array([[east_m, 1200.0, 0.0, 0.0] for east_m in range(800, 980, 5)])
    cov = np.broadcast_to(np.diag([60.0**2, 60.0**2, 1.0, 1.0]), (len(mean), 4, 4)).copy()
    draws = np.random.default_rng(0).normal(0.0, 60.0, (10_000, 2))
    share = np.array([visible_share(seen, draws + place).mean() for place in mean[:, :2]])
    assert (share.min(), share.max()) == (pytest.approx(0.6, abs=0.1), pytest.approx(1.0, abs=0.01))
    # Of three points the one in the middle has two thirds: at an edge half of that may be off.
    found = linearise(sensor_model(sensor), mean, cov).p_in_fov
    np.testing.assert_allclose(found, share, atol=1.0 / 3.0)
    assert found.mean() == pytest.approx(share.mean(), abs=0.04)
