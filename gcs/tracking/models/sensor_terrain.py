"""Sensors over terrain: heights, lines of sight, and ground ranges of slant ranges.

A slant range r to an object at height z, from a sensor at height h, is the range g over ground with g^2 = r^2
- (z - h)^2. Without a measured height the object is at a height above the ground under it, so that z depends
on g: g^2 = r^2 - (ground(g) + agl - h)^2. The iteration begins at g = r and averages with the value before,
so that it converges on slopes below 45 degrees from the sensor's line of sight.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from gcs.model import FloatArray, Polar, Sensor, Viewpoint
from gcs.terrain.elevation_grid import Elevation
from gcs.tracking.models.sensor_geometry import map_coordinates

if TYPE_CHECKING:
    from gcs.terrain.line_of_sight import LineOfSight

_CLEAR_M: Final = 1.0
"""Least height of a sensor above the ground of an elevation model."""
_STEPS: Final = 20


def sensor_alt_msl_m(elevation: Elevation, viewpoint: Viewpoint) -> float:
    """Return the height of a sensor above mean sea level, never under the ground of the model.

    It is NaN for a height above ground outside the model.
    """
    ground_m = elevation.height_msl_m(viewpoint.east_m, viewpoint.north_m)
    if viewpoint.is_agl:
        return ground_m + max(viewpoint.height_m, _CLEAR_M)
    return viewpoint.height_m if math.isnan(ground_m) else max(viewpoint.height_m, ground_m + _CLEAR_M)


def sensor_reach_m(sensor: Sensor, viewpoint: Viewpoint) -> float:
    """Return the distance of the farthest point of a field of view."""
    if sensor.polar is not None:
        return sensor.polar.range_m[1]
    west, south, east, north = sensor.field_of_view_m
    x_m = max(abs(west - viewpoint.east_m), abs(east - viewpoint.east_m))
    y_m = max(abs(south - viewpoint.north_m), abs(north - viewpoint.north_m))
    return math.hypot(x_m, y_m)


def sensor_line_of_sight(elevation: Elevation, sensor: Sensor, viewpoint: Viewpoint) -> LineOfSight:
    """Return the shadows in the field of view of a sensor."""
    from gcs.terrain.line_of_sight import line_of_sight  # Loads numba.

    place_m = viewpoint.east_m, viewpoint.north_m
    alt_msl_m = sensor_alt_msl_m(elevation, viewpoint)
    return line_of_sight(elevation, place_m, alt_msl_m, sensor_reach_m(sensor, viewpoint))


def slant_range_m(range_m: FloatArray, above_m: FloatArray) -> FloatArray:
    """Return the slant range to objects `above_m` above the sensor."""
    return np.hypot(range_m, above_m)


def ground_range_m(slant_m: FloatArray, above_m: FloatArray) -> FloatArray:
    """Return the range over ground to objects `above_m` above the sensor; 0 if they are farther than that."""
    return np.asarray(np.sqrt(np.maximum(np.square(slant_m) - np.square(above_m), 0.0)))


def range_over_terrain_m(
    elevation: Elevation,
    polar: Polar,
    slant_and_bearing: FloatArray,
    alt_msl_m: float,
    height_agl_m: float,
) -> FloatArray:
    """Return the ranges over ground (m,) to objects at a height above the ground.

    Outside the elevation model the ground is taken to be as high as the sensor.

    Parameters
    ----------
    slant_and_bearing : ndarray, shape (m, 2)
        Slant range and bearing.
    alt_msl_m : float
        Height of the sensor.
    """
    slant_m, bearing_rad = slant_and_bearing.T
    range_m = slant_m
    for _ in range(_STEPS):
        ground = elevation.heights_at(map_coordinates(polar, np.column_stack([range_m, bearing_rad])))
        above_m = np.nan_to_num(ground + height_agl_m - alt_msl_m)
        range_m = 0.5 * (range_m + ground_range_m(slant_m, above_m))
    return range_m
