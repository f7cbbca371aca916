"""What a sensor says of itself, and what it saw."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.model.basics import FloatArray


@dataclass(frozen=True, slots=True)
class Polar:
    """How a range/bearing sensor sees: bearings run clockwise from north, clutter is uniform in both."""

    east_m: float
    """Where it stands."""
    north_m: float
    range_std_m: float
    bearing_std_rad: float
    range_m: tuple[float, float]
    """Least and greatest range at which it sees."""
    bearing_rad: tuple[float, float]
    """Centre of the sector that it sees, and how far it sees to either side: pi is all around."""
    clutter_per_m_rad: float
    """Clutter intensity in a cell of range x bearing."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """What a sensor says of itself. Clutter is Poisson, uniform over the field of view.

    A range/bearing sensor has `polar`, which says exactly how it sees. What its other fields hold is for
    those who only draw: clutter and noise at the middle of its range, and the box around its field of view.
    """

    name: str
    detection_probability: float
    clutter_density_per_m2: float
    noise_cov_m2: FloatArray
    """(2, 2) covariance of a detection's east/north."""
    field_of_view_m: tuple[float, float, float, float]
    """east_min, north_min, east_max, north_max: outside it the sensor sees nothing."""
    polar: Polar | None = None


@dataclass(frozen=True, slots=True)
class Scan:
    """One scan of a sensor: detections without identity, in no meaningful order."""

    t_ns: int
    """When it arrived."""
    measured_t_ns: int
    """When it was measured."""
    sensor: Sensor
    z_m: FloatArray
    """(m, 2) east/north of each detection, whatever the sensor measures; m may be 0."""
