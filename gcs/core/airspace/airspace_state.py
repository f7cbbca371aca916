"""State of the airspace: no-fly zones, incursions, heights above ground."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.model import NoFlyZone


@dataclass(slots=True)
class AirspaceState:
    """No-fly zones and warnings."""

    zones: dict[str, NoFlyZone] = field(default_factory=dict)
    """Closed zones by name."""
    incursions_s: dict[tuple[int, str], float] = field(default_factory=dict)
    """Time to each imminent incursion at the last check, by vehicle and zone."""
    next_zone_check_t_ns: int = 0
    near_ground: dict[int, int] = field(default_factory=dict)
    """Time at which each vehicle that was told was last too near to the ground."""
    next_ground_check_t_ns: int = 0
