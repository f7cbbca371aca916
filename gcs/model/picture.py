"""What is there: tracks of one kind, and what vehicles say of themselves."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.model.basics import FloatArray, Kind, Label


@dataclass(frozen=True, slots=True)
class Track:
    """One object as a tracker sees it."""

    label: Label
    mean: FloatArray
    """(4,) east_m, north_m, v_east_m_s, v_north_m_s."""
    cov: FloatArray
    """(4, 4)."""
    existence: float
    """Existence probability in [0, 1] of this label."""
    estimated: bool = False
    """Whether it is in the MAP-cardinality estimate: the best hypothesis of the most probable number.
    An object whose label is ambiguous (born at one scan or at the next?) is in it once, however its
    existence is shared out."""


@dataclass(frozen=True, slots=True)
class Picture:
    """All tracks of one kind after one scan."""

    t_ns: int
    scan_t_ns: int
    kind: Kind
    tracks: tuple[Track, ...]
    """Ordered by label."""
    cardinality: FloatArray
    """(n + 1,) probability of each number of objects."""


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What a vehicle last said of itself over MAVLink."""

    system_id: int
    t_ns: int
    """When its last position report arrived."""
    east_m: float
    north_m: float
    alt_msl_m: float
    ground_speed_m_s: float
    course_rad: float
    mode: str
    """Mode name of its autopilot, such as AUTO or LOITER; empty before the first heartbeat."""
    armed: bool
    mission_seq: int
    """Item that it flies to, -1 when unknown."""
