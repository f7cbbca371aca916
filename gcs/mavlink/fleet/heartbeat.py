"""HEARTBEAT (https://mavlink.io/en/services/heartbeat.html): ours, and checks of received ones."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Frame, Message
from gcs.mavlink.services.retry import ns

HEARTBEAT_PERIOD_NS: Final = ns(0.25)
"""Time between two of our heartbeats to one address.

A vehicle's GCS failsafe acts when every heartbeat of its timeout is lost. At 25 % loss and a timeout of 5 s
that happens 10 times an hour at 1 Hz, and practically never at 4 Hz. MAVLink's 1 Hz is a lower bound. Four
heartbeats take 84 bytes a second.
"""
_HEARTBEAT: Final[int] = dialect.MAVLINK_MSG_ID_HEARTBEAT
_NO_AUTOPILOT: Final[int] = dialect.MAV_AUTOPILOT_INVALID
_NOT_A_VEHICLE: Final[tuple[int, ...]] = (
    dialect.MAV_TYPE_GCS,
    dialect.MAV_TYPE_ONBOARD_CONTROLLER,
    dialect.MAV_TYPE_GIMBAL,
)


def is_heartbeat(frame: Frame) -> bool:
    """Return True if a frame is a HEARTBEAT."""
    return frame.message_id == _HEARTBEAT


def is_from_autopilot(heartbeat: Message | None) -> bool:
    """Return True if a HEARTBEAT is an autopilot's, not a ground station's or a payload's."""
    if heartbeat is None:
        return False
    autopilot: int = heartbeat.autopilot
    return autopilot != _NO_AUTOPILOT and heartbeat.type not in _NOT_A_VEHICLE


def heartbeat_key(heartbeat: Message) -> int:
    """Return the first eight payload bytes of a HEARTBEAT as one number (little endian, signed)."""
    fields = (heartbeat.type, heartbeat.autopilot, heartbeat.base_mode, heartbeat.system_status)
    raw = heartbeat.custom_mode.to_bytes(4, "little") + bytes(fields)
    return int.from_bytes(raw, "little", signed=True)


def heartbeat(instance: int = 0) -> Message:
    """Return our heartbeat, as a ground station.

    `instance` is the number of a running service (`gcs.mavlink.fleet.own_ids`); autopilots ignore it.
    """
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, instance, dialect.MAV_STATE_ACTIVE, 3
    )
