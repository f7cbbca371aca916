"""Autopilot profiles: one table per firmware of how it takes, flies and gives back a mission.

`profile_of` chooses by what a vehicle's HEARTBEAT says. A firmware that is not here is tracked, and never
tasked: what it would make of a mission is not known.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.ardupilot import ARDUPLANE
from gcs.mavlink.autopilots.base import AutopilotProfile, Envelope, FenceLimits, WantedParameter
from gcs.mavlink.autopilots.px4 import PX4
from gcs.mavlink.frames.codec import Message

__all__ = [
    "ARDUPLANE",
    "PROFILES",
    "PX4",
    "AutopilotProfile",
    "Envelope",
    "FenceLimits",
    "WantedParameter",
    "mode_name",
    "profile_of",
]

PROFILES: Final = (ARDUPLANE, PX4)
_VTOL_TYPES: Final = range(19, 26)
_FIXED_WINGS: Final = frozenset({dialect.MAV_TYPE_FIXED_WING, *_VTOL_TYPES})
"""ArduPilot's copters and rovers give other meanings to the same mode numbers."""


def profile_of(autopilot: int, vehicle_type: int = dialect.MAV_TYPE_FIXED_WING) -> AutopilotProfile | None:
    """Return the profile of a heartbeat's MAV_AUTOPILOT and MAV_TYPE; None when there is none."""
    if vehicle_type not in _FIXED_WINGS:
        return None
    return next((profile for profile in PROFILES if profile.autopilot == autopilot), None)


def mode_name(heartbeat: Message) -> str:
    """Name of the mode that a HEARTBEAT tells; its number, for a firmware that is not known."""
    profile = profile_of(heartbeat.autopilot, heartbeat.type)
    return f"MODE({heartbeat.custom_mode})" if profile is None else profile.mode_name(heartbeat.custom_mode)
