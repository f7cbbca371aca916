"""Sketch of a mission, read from a source by `gcs init`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, TypeAlias

Place: TypeAlias = tuple[float, float]
"""Latitude and longitude in degrees."""

MAX_PLACES: Final = 1000
"""Positions of each kind, from one file."""


@dataclass(frozen=True, slots=True)
class Start:
    """Start of a vehicle."""

    place: Place
    system_id: int = 1
    course_deg: float | None = None
    """Degrees clockwise from north; None when unknown."""
    note: str = ""


@dataclass(frozen=True, slots=True)
class FenceArea:
    """An inclusion or exclusion area: corners, or a circle."""

    stay_in: bool
    corners: tuple[Place, ...] = ()
    circle: tuple[float, float, float] | None = None
    """Latitude and longitude in degrees, radius in metres."""
    name: str = ""

    @property
    def outline(self) -> tuple[Place, ...]:
        """Positions that the map must contain."""
        return self.corners if self.circle is None else (self.circle[:2],)


@dataclass(slots=True)
class Sketch:
    """Values from a source; the rest of the mission file gets defaults."""

    starts: list[Start] = field(default_factory=list)
    targets: list[tuple[Place, str]] = field(default_factory=list)
    """Position and name; the name may be empty."""
    areas: list[FenceArea] = field(default_factory=list)
    rally: list[tuple[float, float, float]] = field(default_factory=list)
    """Latitude and longitude in degrees, height above home in metres."""
    ground_msl_m: float | None = None
    speed_m_s: float | None = None
    extent: list[Place] = field(default_factory=list)
    """Other positions that the map must contain."""
    notes: list[str] = field(default_factory=list)
    """What was left out or decided, with reasons."""


def is_place(lat_deg: float, lon_deg: float) -> bool:
    """True if the position is on Earth and known: latitude and longitude 0 mean "unknown"."""
    return -90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0 and abs(lat_deg) + abs(lon_deg) > 0.01
