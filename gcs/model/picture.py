"""Tracks of one kind, and vehicle states from telemetry."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.model.basics import FloatArray, Kind, Label


@dataclass(frozen=True, slots=True)
class Track:
    """Track of one object."""

    label: Label
    mean: FloatArray
    """(4,) east_m, north_m, v_east_m_s, v_north_m_s."""
    cov: FloatArray
    """(4, 4)."""
    existence: float
    """Existence probability in [0, 1] of this label."""
    estimated: bool = False
    """True if the track is in the MAP-cardinality estimate: the best hypothesis of the most probable
    number. An object with an ambiguous label is in it once."""


@dataclass(frozen=True, slots=True)
class Picture:
    """All tracks of one kind after one scan."""

    t_ns: int
    scan_t_ns: int
    kind: Kind
    tracks: tuple[Track, ...]
    """Ordered by label."""
    cardinality: FloatArray
    """(n + 1,) probability of each cardinality."""


@dataclass(frozen=True, slots=True)
class LaggedPicture:
    """The objects of one kind some scans ago, as known from the scans since (`tracking.lag_scans`)."""

    t_ns: int
    """Time of arrival of the last scan."""
    scan_t_ns: int
    """Time of measurement of the scan that it is of."""
    kind: Kind
    tracks: tuple[Track, ...]
    """Ordered by label; existence is that of now."""


@dataclass(frozen=True, slots=True)
class VehicleState:
    """Last state that a vehicle reported over MAVLink."""

    system_id: int
    t_ns: int
    """Arrival time of the last position report."""
    east_m: float
    north_m: float
    alt_msl_m: float
    ground_speed_m_s: float
    course_rad: float
    mode: str
    """Mode name of its autopilot, such as AUTO or LOITER; empty before the first heartbeat."""
    armed: bool
    mission_seq: int
    """Current mission item; -1 when unknown."""
    climb_m_s: float = 0.0
    """Vertical speed, up."""
    grounded: bool | None = None
    """Whether its autopilot says that it stands on the ground; None if it says nothing."""
    is_landing: bool = False
    """True if its autopilot says that it lands."""
    period_s: float = 0.0
    """Time between its reports while it is heard by HIGH_LATENCY2 alone; 0 with usual telemetry."""
    std_m: float = 0.0
    """Standard deviation of the position in such a report; 0 with usual telemetry."""
