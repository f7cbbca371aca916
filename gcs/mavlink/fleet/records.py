"""State of the fleet: what telemetry, addresses and links tell."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class VehicleLink:
    """Link and telemetry of one vehicle."""


@dataclass(slots=True)
class FleetState:
    """Links and addresses of all vehicles."""
