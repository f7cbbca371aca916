"""What `gcs init` knows of a mission before there is a mission file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, TypeAlias

Place: TypeAlias = tuple[float, float]
"""Latitude and longitude in degrees."""

MAX_PLACES: Final = 1000
"""Of each kind, from one file."""


@dataclass(frozen=True, slots=True)
class Start:
    """A vehicle, and where it starts."""

    place: Place
    system_id: int = 1
    course_deg: float | None = None
    """Clockwise from north; None when it is not known."""
    note: str = ""


@dataclass(frozen=True, slots=True)
class FenceArea:
    """An area to stay in or out of: corners, or a circle."""

    stay_in: bool
    corners: tuple[Place, ...] = ()
    circle: tuple[float, float, float] | None = None
    """Latitude and longitude in degrees, radius in metres."""

    @property
    def outline(self) -> tuple[Place, ...]:
        """Places that a map of the area must hold."""
        return self.corners if self.circle is None else (self.circle[:2],)


@dataclass(slots=True)
class Sketch:
    """What a source tells; the rest gets defaults."""

    starts: list[Start] = field(default_factory=list)
    targets: list[tuple[Place, str]] = field(default_factory=list)
    """With a name, where there is one."""
    areas: list[FenceArea] = field(default_factory=list)
    rally: list[tuple[float, float, float]] = field(default_factory=list)
    """Latitude and longitude in degrees, height above home in metres."""
    ground_msl_m: float | None = None
    speed_m_s: float | None = None
    notes: list[str] = field(default_factory=list)
    """What was left out of the mission file, and why."""


def is_place(lat_deg: float, lon_deg: float) -> bool:
    """Return True for a place on Earth that is not latitude and longitude 0, which means "not known"."""
    return -90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0 and abs(lat_deg) + abs(lon_deg) > 0.01
