"""Commands of other ground stations that choose a mode: which they are, and whether a vehicle obeys.

Nothing that steers is sent to a vehicle from such a command on: its heartbeat shows the mode up to a second
later. AUTO is no other mode: the vehicle flies its mission.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import AutopilotProfile
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.frames.codec import OWN_IDS, Frame, Message, is_for
from gcs.mavlink.router.access_policy import command_of

_SET_MODE: Final[int] = dialect.MAV_CMD_DO_SET_MODE
_COMMANDS: Final[frozenset[int]] = frozenset(
    {
        _SET_MODE,
        dialect.MAV_CMD_NAV_LOITER_UNLIM,
        dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        dialect.MAV_CMD_NAV_LAND,
        dialect.MAV_CMD_NAV_TAKEOFF,
        dialect.MAV_CMD_DO_FOLLOW,
        dialect.MAV_CMD_DO_ORBIT,
        dialect.MAV_CMD_DO_FLIGHTTERMINATION,
        dialect.MAV_CMD_DO_LAND_START,
        dialect.MAV_CMD_DO_GO_AROUND,
        dialect.MAV_CMD_DO_REPOSITION,
        dialect.MAV_CMD_DO_PAUSE_CONTINUE,
        dialect.MAV_CMD_DO_PARACHUTE,
        dialect.MAV_CMD_DO_SET_STANDARD_MODE,
    }
)
_MESSAGES: Final[frozenset[int]] = frozenset(
    {
        dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
        dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
    }
)
_GUIDED_ITEM: Final = 2
"""`current` of a mission item that ArduPilot flies to at once."""


def chooses_mode(frame: Frame, profile: AutopilotProfile | None) -> bool:
    """Return True if a frame of another station may put a vehicle of this firmware into another mode."""
    if frame.message_id == dialect.MAVLINK_MSG_ID_SET_MODE:
        message = frame.message()
        return message is None or profile is None or profile.mode_name(message.custom_mode) != AUTO
    if frame.message_id in (dialect.MAVLINK_MSG_ID_MISSION_ITEM, dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT):
        message = frame.message()
        return message is not None and message.current == _GUIDED_ITEM
    number = command_of(frame)
    if number == _SET_MODE:
        message = frame.message()
        if message is None or profile is None:
            return True
        return (message.param2, message.param3) != profile.mode_numbers(AUTO)
    return number in _COMMANDS or frame.message_id in _MESSAGES


def obeys_other_station(message: Message) -> bool:
    """Return True if a vehicle's message tells another station that it carries out such a command."""
    if message.get_type() != "COMMAND_ACK" or message.command not in _COMMANDS:
        return False
    is_accepted = message.result in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS)
    return is_accepted and message.target_system != 0 and not is_for(message, OWN_IDS)
