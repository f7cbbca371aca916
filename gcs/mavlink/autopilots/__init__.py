"""Autopilot profiles: one table per firmware of how it stores, flies and returns a mission.

`profile` (its fields), `arduplane_profile`, `px4_profile`, `modes` (mode names), `preflight_parameters`
(parameters that the preflight check reads).
`profile_of` chooses by a vehicle's HEARTBEAT. A vehicle with another firmware is tracked and never tasked.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.arduplane_profile import ARDUPLANE
from gcs.mavlink.autopilots.profile import AutopilotProfile, FailsafeText, FenceLimits
from gcs.mavlink.autopilots.px4_profile import PX4
from gcs.mavlink.frames.codec import Message

__all__ = [
    "ARDUPLANE",
    "PROFILES",
    "PX4",
    "AutopilotProfile",
    "FailsafeText",
    "FenceLimits",
    "mode_name",
    "profile_of",
]

PROFILES: Final = (ARDUPLANE, PX4)
_BY_AUTOPILOT: Final = {profile.autopilot: profile for profile in PROFILES}
_VTOL_TYPES: Final = range(19, 26)
_FIXED_WINGS: Final = frozenset({dialect.MAV_TYPE_FIXED_WING, *_VTOL_TYPES})
"""ArduPilot's copters and rovers use the same mode numbers with other meanings."""


def profile_of(autopilot: int, vehicle_type: int = dialect.MAV_TYPE_FIXED_WING) -> AutopilotProfile | None:
    """Return the profile for a heartbeat's MAV_AUTOPILOT and MAV_TYPE; None if there is none."""
    return _BY_AUTOPILOT.get(autopilot) if vehicle_type in _FIXED_WINGS else None


def mode_name(heartbeat: Message) -> str:
    """Return the mode of a HEARTBEAT; its number for an unknown firmware."""
    profile = profile_of(heartbeat.autopilot, heartbeat.type)
    return f"MODE({heartbeat.custom_mode})" if profile is None else profile.mode_name(heartbeat.custom_mode)
