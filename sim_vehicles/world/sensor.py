"""Simulated sensors: ground truth and a random generator in, one scan out.

Each object inside the field of view is detected with probability p_D, with Gaussian noise on east and north,
or on range and bearing. Clutter is Poisson in number and uniform over the field of view in the same
coordinates. Detections are in random order: the standard multi-object observation model (Vo & Vo 2013,
section III-C).

Terrain hides objects that are below the line of sight, each at its true height. Slant ranges are those to
the true height.

Each scan has its own generator and draws for every object, so that a loss does not change the detections of
other objects.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs.config.schema import MapTable
from gcs.model import BoolArray, FloatArray, Polar, Scan, Sensor, TruthObject, Viewpoint, read_only
from gcs.terrain.elevation_grid import Elevation
from gcs.tracking.models.sensor_geometry import (
    covers,
    expected_clutter,
    map_coordinates,
    polar_sensor,
    sector,
    sensor_coordinates,
)
from gcs.tracking.models.sensor_terrain import sensor_alt_msl_m, sensor_line_of_sight, slant_range_m
from sim_vehicles.world.scenario import Scenario, SensorTable, generator


def make_sensors(scenario: Scenario) -> list[Sensor]:
    """Return the true sensor models of a scenario."""
    return [
        replace(_make_sensor(table, scenario.config.map), viewpoint=_viewpoint(table))
        for table in scenario.sensors
    ]


def _viewpoint(table: SensorTable) -> Viewpoint | None:
    if table.height_agl_m is None:
        return None
    return Viewpoint(table.east_m, table.north_m, table.height_agl_m, is_agl=True)


def _make_sensor(table: SensorTable, area: MapTable) -> Sensor:
    if table.kind == "range_bearing":
        polar = sector(
            (table.east_m, table.north_m),
            (table.range_std_m, table.bearing_std_deg),
            (table.least_range_m, table.most_range_m),
            (table.sector_centre_deg, table.sector_width_deg),
            table.clutter_per_scan,
        )
        polar = replace(polar, is_slant=table.range == "slant")
        return polar_sensor(table.name, table.detection_probability, polar)
    margin = table.field_margin_m
    field = (-margin, -margin, area.width_m + margin, area.height_m + margin)
    if table.field_m is not None:
        west, south, east, north = table.field_m
        field = (west, south, east, north)
    return Sensor(
        name=table.name,
        detection_probability=table.detection_probability,
        clutter_density_per_m2=table.clutter_per_scan / _area_m2(field),
        noise_cov_m2=read_only(np.eye(2) * table.noise_std_m**2),
        field_of_view_m=field,
    )


class TrueSight:
    """What terrain does to one sensor's view of objects at their true heights."""

    def __init__(self, elevation: Elevation, sensor: Sensor, viewpoint: Viewpoint) -> None:
        self._elevation = elevation
        self._lines = sensor_line_of_sight(elevation, sensor, viewpoint)
        self._alt_msl_m = sensor_alt_msl_m(elevation, viewpoint)

    def is_seen(self, places_m: FloatArray, alts_msl_m: FloatArray) -> BoolArray:
        """Return True for each object (n,) that terrain does not hide, or whose height is unknown (NaN)."""
        height_agl_m = alts_msl_m - self._elevation.heights_at(places_m)
        return ~(height_agl_m < self._lines.shadows_at(places_m))

    def above_m(self, alts_msl_m: FloatArray) -> FloatArray:
        """Return the heights (n,) above the sensor; 0 if unknown."""
        return np.nan_to_num(alts_msl_m - self._alt_msl_m)


def observe(
    sensor: Sensor,
    objects: Sequence[TruthObject],
    seed: int,
    scan_index: int,
    t_ns: int,
    purpose: str = "scan",
    sight: TrueSight | None = None,
) -> Scan:
    """Return one scan of all objects at `t_ns`, including those that are not alive."""
    rng = generator(seed, purpose, scan_index)
    detected = np.empty(len(objects), np.bool_)
    noise = np.empty((len(objects), 2))
    for i in range(len(objects)):
        detected[i] = rng.random() < sensor.detection_probability
        noise[i] = rng.standard_normal(2)
    places = np.reshape([(thing.east_m, thing.north_m) for thing in objects], (-1, 2))
    alive = np.array([thing.alive for thing in objects], np.bool_)
    seen = detected & alive & covers(sensor, places)
    above_m = np.zeros(len(objects))
    if sight is not None:
        alts = np.array([math.nan if thing.alt_msl_m is None else thing.alt_msl_m for thing in objects])
        seen &= sight.is_seen(places, alts)
        above_m = sight.above_m(alts)
    if sensor.polar is None:
        points = _positions(sensor, places[seen], noise[seen], rng)
    else:
        points = _ranges_and_bearings(sensor, sensor.polar, places[seen], above_m[seen], noise[seen], rng)
    return Scan(t_ns, t_ns, sensor, read_only(rng.permutation(points)))


def _positions(sensor: Sensor, places: FloatArray, noise: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return detections and clutter of a sensor that reports positions."""
    east_min, north_min, east_max, north_max = sensor.field_of_view_m
    points = places + np.sqrt(np.diag(sensor.noise_cov_m2)) * noise
    count = rng.poisson(expected_clutter(sensor))
    return np.concatenate([points, rng.uniform([east_min, north_min], [east_max, north_max], (count, 2))])


def _ranges_and_bearings(
    sensor: Sensor,
    polar: Polar,
    places: FloatArray,
    above_m: FloatArray,
    noise: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Return detections and clutter of a sensor that reports range and bearing, as east/north."""
    z = sensor_coordinates(sensor, places)
    if polar.is_slant:
        z[:, 0] = slant_range_m(z[:, 0], above_m)
    z += noise * (polar.range_std_m, polar.bearing_std_rad)
    count = rng.poisson(expected_clutter(sensor))
    centre_rad, half_rad = polar.bearing_rad
    least = (polar.range_m[0], centre_rad - half_rad)
    most = (polar.range_m[1], centre_rad + half_rad)
    return map_coordinates(polar, np.concatenate([z, rng.uniform(least, most, (count, 2))]))


def _area_m2(field: tuple[float, float, float, float]) -> float:
    east_min, north_min, east_max, north_max = field
    return (east_max - east_min) * (north_max - north_min)
