"""Sensor models and scans."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.model.basics import FloatArray


@dataclass(frozen=True, slots=True)
class Polar:
    """Model of a range/bearing sensor. Bearings are clockwise from north; clutter is uniform in both."""

    east_m: float
    """Position of the sensor."""
    north_m: float
    range_std_m: float
    bearing_std_rad: float
    range_m: tuple[float, float]
    """Minimum and maximum range."""
    bearing_rad: tuple[float, float]
    """Centre and half width of the sector; a half width of pi is all around."""
    clutter_per_m_rad: float
    """Clutter intensity in range x bearing."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """Model that a sensor announces. Clutter is Poisson, uniform over the field of view.

    `polar` is the exact model of a range/bearing sensor. Its other fields are for display: clutter and noise
    at mid range, and the bounding box of the field of view.
    """

    name: str
    detection_probability: float
    clutter_density_per_m2: float
    noise_cov_m2: FloatArray
    """(2, 2) covariance of a detection, east/north."""
    field_of_view_m: tuple[float, float, float, float]
    """east_min, north_min, east_max, north_max."""
    polar: Polar | None = None


@dataclass(frozen=True, slots=True)
class Scan:
    """One scan of a sensor: unlabelled detections in arbitrary order."""

    t_ns: int
    """Arrival time."""
    measured_t_ns: int
    """Measurement time."""
    sensor: Sensor
    z_m: FloatArray
    """(m, 2) detections, east/north; m may be 0."""
