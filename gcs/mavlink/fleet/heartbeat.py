"""HEARTBEAT (https://mavlink.io/en/services/heartbeat.html): whose one is, what it says, and ours."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Frame, Message
from gcs.mavlink.services.retry import ns

HEARTBEAT_PERIOD_NS: Final = ns(0.25)
"""Time between two heartbeats of ours to one address.

A vehicle's ground-station failsafe acts when every heartbeat of its timeout is lost. At 25 % loss and a
timeout of 5 s, one heartbeat a second lets that happen 10 times an hour per vehicle; four a second, once in
thousands of years. At 50 % it is 110 times an hour, and once in 70 hours. The MAVLink guide's 1 Hz is a lower
bound (https://mavlink.io/en/services/heartbeat.html); four take 84 bytes a second of a radio.
"""
_HEARTBEAT: Final[int] = dialect.MAVLINK_MSG_ID_HEARTBEAT
_NO_AUTOPILOT: Final[int] = dialect.MAV_AUTOPILOT_INVALID
_NOT_A_VEHICLE: Final[tuple[int, ...]] = (
    dialect.MAV_TYPE_GCS,
    dialect.MAV_TYPE_ONBOARD_CONTROLLER,
    dialect.MAV_TYPE_GIMBAL,
)


def is_heartbeat(frame: Frame) -> bool:
    """Whether a frame is one."""
    return frame.message_id == _HEARTBEAT


def is_vehicles(heartbeat: Message | None) -> bool:
    """Whether a HEARTBEAT is an autopilot's own, not a ground station's or a payload's."""
    if heartbeat is None:
        return False
    autopilot: int = heartbeat.autopilot
    return autopilot != _NO_AUTOPILOT and heartbeat.type not in _NOT_A_VEHICLE


def as_number(heartbeat: Message) -> int:
    """Return what one says as one number: its first eight bytes, little endian and signed."""
    told = (heartbeat.type, heartbeat.autopilot, heartbeat.base_mode, heartbeat.system_status)
    raw = heartbeat.custom_mode.to_bytes(4, "little") + bytes(told)
    return int.from_bytes(raw, "little", signed=True)


def heartbeat() -> Message:
    """Return ours, of a ground station."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
    )
