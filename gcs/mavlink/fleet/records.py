"""State of the fleet: what telemetry, addresses and links tell."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class ModeRecord:
    """Modes that one vehicle showed, and that we commanded (`gcs.mavlink.fleet.mode_authority`)."""

    mode: str = ""
    """Mode of the last heartbeat; empty before the first."""
    previous: str = ""
    """Mode before that."""
    commanded: str = ""
    """Mode that we commanded last; empty if another was chosen since."""
    tasked: bool = False
    """True if the vehicle was in AUTO, or was commanded to it."""
    has_ended: bool = False
    """True if the vehicle is in RTL because its mission is complete."""


@dataclass(slots=True)
class VehicleLink:
    """Link and telemetry of one vehicle."""


@dataclass(slots=True)
class FleetState:
    """Links and addresses of all vehicles."""
