"""Records of sensor models and scans."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.model.basics import Float32Array, FloatArray


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
    is_slant: bool = False
    """True if its ranges are slant ranges, which the terrain projects to the ground plane."""


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Place and height from which a sensor looks."""

    east_m: float
    north_m: float
    height_m: float
    is_agl: bool
    """True if the height is above the ground, False if it is above mean sea level."""


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """Share of an object's possible heights that a sensor sees over the terrain."""

    east_m: float
    """Position of the sensor."""
    north_m: float
    range_step_m: float
    share: Float32Array
    """(bearings, ranges), 0 ... 1; bearings clockwise from north, ranges from 0."""


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
    viewpoint: Viewpoint | None = None
    """None: terrain is not in its way."""
    visibility: Visibility | None = None
    """What it sees of one kind of object. The sensor does not announce it: the elevation model gives it."""


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
    heights_msl_m: FloatArray | None = None
    """(m,) heights of the detections; None if the sensor does not measure them. Tracks have no height."""
