"""HIGH_LATENCY2: the one message of a vehicle on a satellite link or another slow one.

https://mavlink.io/en/messages/common.html#HIGH_LATENCY2. ArduPilot sends it every 5 s on a port of
SERIALn_PROTOCOL 43 after MAV_CMD_CONTROL_HIGH_LATENCY (`GCS_MAVLINK::send_high_latency2`), PX4 every 66 s in
the mode iridium (`streams/HIGH_LATENCY2.hpp`), both without HEARTBEAT. Each report is read as the usual
messages that it stands for.

* The mode has 16 bits: ArduPilot's number, or PX4's main and sub mode. ArduPilot sends base_mode in custom0;
  PX4 does not say whether it is armed: it counts as before, and as armed once it moves or has throttle,
  which is zero while it is disarmed.
* Height is in whole metres, ground speed in steps of 0.2 m/s along the heading; the vertical speed is
  unknown. ArduPilot gives no accuracy. The time on the way is unknown.
* ArduPilot sets the failure flag of a sensor that it does not have. So a flag counts for sensors that
  SYS_STATUS has shown before, and for those that every vehicle has.

HIGH_LATENCY, deprecated in 2020, is sent by neither; it counts as a frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Frame, Message
from gcs.mavlink.services.retry import ns

_HIGH_LATENCY2: Final[int] = dialect.MAVLINK_MSG_ID_HIGH_LATENCY2
_MIN_PERIOD_NS: Final = ns(5.0)
_FIRST_PERIOD_NS: Final = ns(66.0)
"""Assumed before the second report; that of PX4."""
_MAX_PERIOD_NS: Final = ns(120.0)
_NS_PER_MS: Final = 1_000_000
_MIN_STD_M: Final = 10.0
_DELAY_STD_S: Final = 5.0
"""Standard deviation of the time on the way, assumed: a message takes seconds by satellite."""
_UNKNOWN_ACCURACY: Final = (0, 255)
_GROUND_SPEED_M_S: Final = 0.2
"""Unit of the ground speed."""
_MOVING_M_S: Final = 3.0
_BITS: Final = {
    dialect.HL_FAILURE_FLAG_GPS: dialect.MAV_SYS_STATUS_SENSOR_GPS,
    dialect.HL_FAILURE_FLAG_DIFFERENTIAL_PRESSURE: dialect.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE,
    dialect.HL_FAILURE_FLAG_ABSOLUTE_PRESSURE: dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,
    dialect.HL_FAILURE_FLAG_3D_ACCEL: dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    dialect.HL_FAILURE_FLAG_3D_GYRO: dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO,
    dialect.HL_FAILURE_FLAG_3D_MAG: dialect.MAV_SYS_STATUS_SENSOR_3D_MAG,
    dialect.HL_FAILURE_FLAG_TERRAIN: dialect.MAV_SYS_STATUS_TERRAIN,
    dialect.HL_FAILURE_FLAG_BATTERY: dialect.MAV_SYS_STATUS_SENSOR_BATTERY,
    dialect.HL_FAILURE_FLAG_RC_RECEIVER: dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER,
    dialect.HL_FAILURE_FLAG_ENGINE: dialect.MAV_SYS_STATUS_SENSOR_PROPULSION,
    dialect.HL_FAILURE_FLAG_GEOFENCE: dialect.MAV_SYS_STATUS_GEOFENCE,
    dialect.HL_FAILURE_FLAG_ESTIMATOR: dialect.MAV_SYS_STATUS_AHRS,
}
"""MAV_SYS_STATUS_SENSOR bit of each HL_FAILURE_FLAG that has one."""
_COMMON: Final[int] = (
    dialect.MAV_SYS_STATUS_SENSOR_GPS
    | dialect.MAV_SYS_STATUS_SENSOR_PROPULSION
    | dialect.MAV_SYS_STATUS_GEOFENCE
    | dialect.MAV_SYS_STATUS_AHRS
)
"""Sensors of every vehicle."""


@dataclass(slots=True)
class HighLatency:
    """Reports of a vehicle that is heard by HIGH_LATENCY2 alone."""

    period_ns: int = _FIRST_PERIOD_NS
    """Time between the last two, by the vehicle's clock."""
    boot_ms: int | None = None
    """Its time since boot at the last one; None before it."""
    std_m: float = _MIN_STD_M
    """Standard deviation of the reported position."""

    def add_report(self, message: Message) -> None:
        """Note a report."""
        if self.boot_ms is not None and message.timestamp > self.boot_ms:
            period_ns = (message.timestamp - self.boot_ms) * _NS_PER_MS
            self.period_ns = min(max(period_ns, _MIN_PERIOD_NS), _MAX_PERIOD_NS)
        self.boot_ms = message.timestamp
        accuracy_m = _MIN_STD_M if message.eph in _UNKNOWN_ACCURACY else message.eph * 0.1
        travel_m = _DELAY_STD_S * message.groundspeed * _GROUND_SPEED_M_S
        self.std_m = math.hypot(max(accuracy_m, _MIN_STD_M), travel_m)


def is_high_latency(frame: Frame) -> bool:
    """Return True if a frame is a HIGH_LATENCY2."""
    return frame.message_id == _HIGH_LATENCY2


def heartbeat_of(report: Message, *, armed: bool) -> Message:
    """Return the HEARTBEAT that a report stands for.

    PX4 does not say whether it is armed: it is if it was (`armed`), if it moves, or if it has throttle.
    """
    is_ardupilot = report.autopilot == dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    base_mode = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    if is_ardupilot:
        base_mode = report.custom0 & 0xFF
    elif armed or report.throttle or report.groundspeed * _GROUND_SPEED_M_S >= _MOVING_M_S:
        base_mode |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
    custom_mode = report.custom_mode << (0 if is_ardupilot else 16)
    return dialect.MAVLink_heartbeat_message(
        report.type, report.autopilot, base_mode, custom_mode, dialect.MAV_STATE_ACTIVE, 3
    )


def position_of(report: Message) -> Message:
    """Return the GLOBAL_POSITION_INT that a report stands for; without height above home and climb."""
    heading_deg = 2 * report.heading
    speed_cm_s = 100.0 * _GROUND_SPEED_M_S * report.groundspeed
    v_north_cm_s = round(speed_cm_s * math.cos(math.radians(heading_deg)))
    v_east_cm_s = round(speed_cm_s * math.sin(math.radians(heading_deg)))
    return dialect.MAVLink_global_position_int_message(
        report.timestamp, report.latitude, report.longitude, report.altitude * 1000, 0,
        v_north_cm_s, v_east_cm_s, 0, heading_deg * 100 % 36000,
    )  # fmt: skip


def sys_status_of(report: Message, known_sensors: int) -> Message:
    """Return the SYS_STATUS that a report stands for, with the sensors that SYS_STATUS has shown before."""
    sensors = known_sensors or _COMMON
    if report.battery >= 0:
        sensors |= dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    failed = sum(bit for flag, bit in _BITS.items() if report.failure_flags & flag)
    return dialect.MAVLink_sys_status_message(
        sensors, sensors, sensors & ~failed, 0, 65535, -1, report.battery, *[0] * 6
    )


def has_fix(report: Message) -> bool:
    """Return True if a report does not flag the GPS."""
    return not report.failure_flags & dialect.HL_FAILURE_FLAG_GPS
