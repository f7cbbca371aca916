"""Sensor geometry: coordinates, field of view, noise and clutter on the map.

Clutter is uniform in sensor coordinates. Intensities are per m2 on the map, so that sensors can be
compared. A cell of range and bearing dr x db covers r dr db on the map, so lambda(r, b) = r lambda(east,
north).
"""

from __future__ import annotations

import math

import numpy as np

from gcs.model import BoolArray, FloatArray, Polar, Sensor, read_only

MAX_DETECTION_PROBABILITY = 0.999
"""Cap of the announced detection probability: a single miss must not end a track."""
_MIN_RANGE_M = 1e-3
"""Nearer, a bearing means nothing, and clutter per m2 would be infinite."""
_TWO_PI = 2.0 * math.pi
_MIN_SHARE = 0.99
"""Share of an object's heights that is in sight where an object is covered."""


def sensor_coordinates(sensor: Sensor, z_m: FloatArray) -> FloatArray:
    """Return detections (m, 2) in sensor coordinates: east/north, or range and bearing."""
    if sensor.polar is None:
        return z_m
    x = z_m[:, 0] - sensor.polar.east_m
    y = z_m[:, 1] - sensor.polar.north_m
    return np.column_stack([np.hypot(x, y), np.arctan2(x, y)])


def map_coordinates(polar: Polar, z: FloatArray) -> FloatArray:
    """Return east/north (m, 2) of ranges and bearings (m, 2)."""
    if z.ndim != 2 or z.shape[1] != 2:
        raise ValueError(f"z: expected shape (m, 2), range in metres and bearing in radians; got {z.shape}")
    range_m, bearing_rad = z.T
    return np.column_stack(
        [polar.east_m + range_m * np.sin(bearing_rad), polar.north_m + range_m * np.cos(bearing_rad)]
    )


def sector(
    position_m: tuple[float, float],
    stds: tuple[float, float],
    range_m: tuple[float, float],
    sector_deg: tuple[float, float],
    clutter_per_scan: float,
) -> Polar:
    """Return the geometry of a range/bearing sensor from its data sheet.

    Parameters
    ----------
    position_m
        East and north of the sensor.
    stds
        Standard deviations of range in metres and of bearing in degrees.
    range_m
        Least and greatest range.
    sector_deg
        Centre of the sector, clockwise from north, and its width.
    clutter_per_scan
        Mean number of false detections, uniform over range and bearing.
    """
    half_rad = math.radians(sector_deg[1]) / 2.0
    return Polar(
        *position_m,
        stds[0],
        math.radians(stds[1]),
        range_m,
        (math.radians(sector_deg[0]), half_rad),
        clutter_per_scan / ((range_m[1] - range_m[0]) * 2.0 * half_rad),
    )


def polar_sensor(name: str, detection_probability: float, polar: Polar) -> Sensor:
    """Return a range/bearing sensor, with a box and a mean noise for displays."""
    middle_m = max(0.5 * (polar.range_m[0] + polar.range_m[1]), _MIN_RANGE_M)
    variance_m2 = 0.5 * (polar.range_std_m**2 + (middle_m * polar.bearing_std_rad) ** 2)
    centre_rad, half_rad = polar.bearing_rad
    # Bounding box of a sector: its ends, and the compass points inside it.
    turns = np.array(
        [-half_rad, half_rad, *(math.remainder(k * math.pi / 2 - centre_rad, _TWO_PI) for k in range(4))]
    )
    turns = turns[np.abs(turns) <= half_rad + 1e-12]
    corners = np.array([(range_m, centre_rad + turn) for range_m in polar.range_m for turn in turns])
    (west, south), (east, north) = (
        f(map_coordinates(polar, corners), axis=0).tolist() for f in (np.min, np.max)
    )
    return Sensor(
        name,
        detection_probability,
        polar.clutter_per_m_rad / middle_m,
        read_only(np.eye(2) * variance_m2),
        (west, south, east, north),
        polar,
    )


def clutter_per_m2(sensor: Sensor, z_m: FloatArray) -> FloatArray:
    """Return the sensor's clutter intensity (m,) at detections (m, 2), per m2 on the map."""
    if sensor.polar is None:
        return np.full(len(z_m), float(sensor.clutter_density_per_m2))
    return sensor.polar.clutter_per_m_rad / cell_area_m2(sensor, z_m)


def cell_area_m2(sensor: Sensor, z_m: FloatArray) -> FloatArray:
    """Return the map area (m,) of a unit cell of sensor coordinates at detections (m, 2)."""
    if sensor.polar is None:
        return np.ones(len(z_m))
    return np.maximum(
        np.hypot(z_m[:, 0] - sensor.polar.east_m, z_m[:, 1] - sensor.polar.north_m), _MIN_RANGE_M
    )


def noise_m2(sensor: Sensor, z_m: FloatArray) -> FloatArray:
    """Return the covariances (m, 2, 2) of detections (m, 2) on the map."""
    if sensor.polar is None:
        return np.broadcast_to(sensor.noise_cov_m2, (len(z_m), 2, 2))
    range_m, bearing_rad = sensor_coordinates(sensor, z_m).T
    sin = np.sin(bearing_rad)
    cos = np.cos(bearing_rad)
    along = np.stack([sin, cos], axis=-1)
    across = np.stack([cos, -sin], axis=-1)
    return np.asarray(
        sensor.polar.range_std_m**2 * along[:, :, None] * along[:, None, :]
        + (np.maximum(range_m, _MIN_RANGE_M) * sensor.polar.bearing_std_rad)[:, None, None] ** 2
        * (across[:, :, None] * across[:, None, :])
    )


def covers(sensor: Sensor, places_m: FloatArray) -> BoolArray:
    """Return True for each position (n, 2) in the field of view where terrain hides no part of an object."""
    inside = _is_in_field(sensor, places_m)
    if sensor.visibility is not None:
        from gcs.terrain.line_of_sight import visible_share  # Loads numba.

        inside &= visible_share(sensor.visibility, places_m) >= _MIN_SHARE
    return inside


def _is_in_field(sensor: Sensor, places_m: FloatArray) -> BoolArray:
    if sensor.polar is None:
        (west, east), (south, north) = field_bounds_m(sensor)
        x = places_m[:, 0]
        y = places_m[:, 1]
        return np.asarray((west <= x) & (x <= east) & (south <= y) & (y <= north))
    range_m, bearing_rad = sensor_coordinates(sensor, places_m).T
    centre_rad, half_rad = sensor.polar.bearing_rad
    off_rad = np.abs(np.angle(np.exp(1j * (bearing_rad - centre_rad))))
    least_m, most_m = sensor.polar.range_m
    return np.asarray((least_m <= range_m) & (range_m <= most_m) & (off_rad <= half_rad + 1e-12))


def expected_clutter(sensor: Sensor) -> float:
    """Return the mean number of false detections in a scan; infinite for an unbounded field of view."""
    if sensor.polar is None:
        (west, east), (south, north) = field_bounds_m(sensor)
        return float(sensor.clutter_density_per_m2 * (east - west) * (north - south))
    least_m, most_m = sensor.polar.range_m
    half_rad = min(sensor.polar.bearing_rad[1], math.pi)
    return sensor.polar.clutter_per_m_rad * (most_m - least_m) * 2.0 * half_rad


def field_bounds_m(sensor: Sensor) -> FloatArray:
    """Return the bounds (2, 2) of a position sensor's field of view, one row per coordinate."""
    west, south, east, north = sensor.field_of_view_m
    return np.array([[west, east], [south, north]], dtype=np.float64)
