"""Access of other ground stations: which of their frames reach a vehicle (`access` of their endpoint).

=============  ===============================================================================================
full           everything but a mission message without a target (ArduPilot takes a MISSION_COUNT for
               system 0 as its own: one such frame truncates the missions of all vehicles)
read-only      requests to one vehicle that change nothing: parameters and missions read, and the commands
               that request a message, version, capabilities, home position or prearm checks
both           no mission protocol during our own transfer to that vehicle: two uploads at a time leave an
               inconsistent mission. Ground stations repeat the requests that are refused.
=============  ===============================================================================================

Read-only stations may not set message intervals: on a slow radio these decide what else gets through.
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
READ_ONLY_MESSAGES: Final[frozenset[int]] = frozenset(
    {
        dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        dialect.MAVLINK_MSG_ID_MISSION_ACK,
    }
)
READ_ONLY_COMMANDS: Final[frozenset[int]] = frozenset(
    {
        dialect.MAV_CMD_GET_HOME_POSITION,
        dialect.MAV_CMD_GET_MESSAGE_INTERVAL,
        dialect.MAV_CMD_REQUEST_MESSAGE,
        dialect.MAV_CMD_REQUEST_PROTOCOL_VERSION,
        dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
        dialect.MAV_CMD_RUN_PREARM_CHECKS,
    }
)
_COMMAND_OFFSET: Final = 28
"""Payload offset of the command in COMMAND_LONG and COMMAND_INT: after seven 4-byte fields."""


def command_of(frame: Frame) -> int | None:
    """Return the command that a frame carries; None if it carries none."""
    if frame.message_id not in COMMANDS:
        return None
    return payload_byte(frame, _COMMAND_OFFSET) | (payload_byte(frame, _COMMAND_OFFSET + 1) << 8)


def refusal(role: Role, frame: Frame, target_system: int, *, is_busy: bool) -> str:
    """Return why a ground station's frame is refused; empty if it may pass.

    Parameters
    ----------
    role
        Access of the station's endpoint.
    target_system
        0 for all.
    is_busy
        True during our mission transfer to that vehicle.
    """
    mission = frame.message_id in MISSION_PROTOCOL
    if mission and target_system == 0:
        return "mission message for all vehicles"
    if role == "read-only" and not _is_read_only(frame):
        return "read-only"
    if role == "read-only" and target_system == 0:
        return "read-only: a request to all vehicles"
    return "mission transfer under way" if mission and is_busy else ""


def _is_read_only(frame: Frame) -> bool:
    return frame.message_id in READ_ONLY_MESSAGES or command_of(frame) in READ_ONLY_COMMANDS
