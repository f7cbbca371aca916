"""What another ground station may send to a vehicle.

=============  ===============================================================================================
full           everything but a mission message that is for nobody in particular (ArduPilot takes a
               MISSION_COUNT for system 0 as its own: one such frame truncates the missions of all)
read-only      questions to one vehicle that change nothing: parameters and missions read, and the
               commands that ask for a message, the version, the capabilities, the home position or the
               pre-arm checks.
               Everything else is kept back.
both           nothing of the mission protocol while a mission of ours is on its way to that vehicle: two
               uploads at a time leave a mix. What is kept back is asked again by every ground station.
=============  ===============================================================================================

A read-only guest may not set message rates either: on a slow radio they decide what else gets through.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Role
from gcs.mavlink.frames.codec import Frame, payload_byte

MISSION_PROTOCOL: Final[frozenset[int]] = frozenset(
    {
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST_PARTIAL_LIST,
        dialect.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST,
        dialect.MAVLINK_MSG_ID_MISSION_ITEM,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST,
        dialect.MAVLINK_MSG_ID_MISSION_SET_CURRENT,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
        dialect.MAVLINK_MSG_ID_MISSION_COUNT,
        dialect.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
        dialect.MAVLINK_MSG_ID_MISSION_ACK,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT,
    }
)
MISSION_WRITES: Final[frozenset[int]] = frozenset(
    {
        dialect.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST,
        dialect.MAVLINK_MSG_ID_MISSION_ITEM,
        dialect.MAVLINK_MSG_ID_MISSION_COUNT,
        dialect.MAVLINK_MSG_ID_MISSION_CLEAR_ALL,
        dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT,
    }
)
COMMANDS: Final[frozenset[int]] = frozenset(
    {dialect.MAVLINK_MSG_ID_COMMAND_LONG, dialect.MAVLINK_MSG_ID_COMMAND_INT}
)
QUESTIONS: Final[frozenset[int]] = frozenset(
    {
        dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        dialect.MAVLINK_MSG_ID_MISSION_ACK,
    }
)
ASKING_COMMANDS: Final[frozenset[int]] = frozenset(
    {
        dialect.MAV_CMD_GET_HOME_POSITION,
        dialect.MAV_CMD_GET_MESSAGE_INTERVAL,
        dialect.MAV_CMD_REQUEST_MESSAGE,
        dialect.MAV_CMD_REQUEST_PROTOCOL_VERSION,
        dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
        dialect.MAV_CMD_RUN_PREARM_CHECKS,
    }
)
_COMMAND_AT: Final = 28
"""Offset of the command's number in COMMAND_LONG and COMMAND_INT: behind seven 4-byte fields."""


def command_of(frame: Frame) -> int | None:
    """Number of the command that a frame carries, None when it carries none."""
    if frame.message_id not in COMMANDS:
        return None
    return payload_byte(frame, _COMMAND_AT) | payload_byte(frame, _COMMAND_AT + 1) << 8


def refusal(role: Role, frame: Frame, target_system: int, *, is_busy: bool) -> str:
    """Say why a guest's frame is kept from a vehicle; empty when it may go there.

    Parameters
    ----------
    role
        Of the endpoint where the guest is.
    target_system
        0 for all.
    is_busy
        Whether a mission of ours is on its way to that vehicle.
    """
    mission = frame.message_id in MISSION_PROTOCOL
    if mission and target_system == 0:
        return "mission message for all vehicles"
    if role == "read-only" and not _is_question(frame):
        return "read-only"
    if role == "read-only" and target_system == 0:
        return "read-only: a question to all vehicles"
    return "mission transfer under way" if mission and is_busy else ""


def _is_question(frame: Frame) -> bool:
    return frame.message_id in QUESTIONS or command_of(frame) in ASKING_COMMANDS
