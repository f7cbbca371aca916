"""State of the airspace: no-fly zones, incursions."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class AirspaceState:
    """No-fly zones and warnings."""
