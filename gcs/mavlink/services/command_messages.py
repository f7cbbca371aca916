"""COMMAND_LONG messages that we send, each always to one vehicle's autopilot.

Source: https://mavlink.io/en/messages/common.html#mav_commands.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import AutopilotProfile, profile_of
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Message
from gcs.model import system_of

SET_MODE: Final[int] = dialect.MAV_CMD_DO_SET_MODE
MESSAGE_INTERVAL: Final[int] = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
REQUEST_MESSAGE: Final[int] = dialect.MAV_CMD_REQUEST_MESSAGE


def command(vehicle: int, number: int, *params: float) -> Message:
    """Return a COMMAND_LONG; parameters left out are 0."""
    filled = (*params, *([0.0] * (7 - len(params))))
    return dialect.MAVLink_command_long_message(
        system_of(vehicle), AUTOPILOT_COMPONENT_ID, number, 0, *filled
    )


def select(vehicle: int, profile: AutopilotProfile, item: int) -> Message:
    """Return the message that makes a vehicle fly to an item of its mission, from where it is.

    MISSION_SET_CURRENT, not the command DO_SET_MISSION_CURRENT: ArduPlane starts the leg of that one at the
    waypoint that it flew to before (`GCS_MAVLink_Plane.cpp`: `next_wp_crosstrack` is cleared too late), and
    tracks that line. The message may be repeated. Its answer is MISSION_CURRENT with the number as it was
    sent. ArduPlane takes 0 for its first item: then 0 is an answer that it gives to nothing else.
    """
    named = item if item > profile.home_items else 0
    return dialect.MAVLink_mission_set_current_message(system_of(vehicle), AUTOPILOT_COMPONENT_ID, named)


def set_mode(vehicle: int, autopilot: int, name: str) -> Message:
    """Return the command that switches the mode; the heartbeat shows whether it did.

    Raises
    ------
    KeyError
        The autopilot is unknown, or has no such mode.
    """
    profile = profile_of(autopilot)
    if profile is None:
        raise KeyError(autopilot)
    custom = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    return command(vehicle, SET_MODE, custom, *profile.mode_numbers(name))
