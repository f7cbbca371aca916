"""Telemetry of a simulated vehicle: which messages it sends, with what content and how often.

Message definitions: https://mavlink.io/en/messages/common.html and ardupilotmega.html. Default rates are
ArduPlane's, about 1 Hz; the groups of REQUEST_DATA_STREAM follow ArduPlane's ``SR*`` streams.

Positions have white Gaussian noise of `gps_noise_std_m` on each axis; velocities and attitude are exact.
Before the position is known, reports are as ArduPlane's: near latitude and longitude zero, without a fix.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.model import NS_PER_S
from sim_vehicles.autopilots.arduplane import Autopilot
from sim_vehicles.autopilots.autopilot_traits import PX4, Mode
from sim_vehicles.autopilots.mission_protocol import NEVER_NS
from sim_vehicles.vehicle.faults import FaultKind
from sim_vehicles.vehicle.guidance import REFERENCE_S, Straight

_MIN_PERIOD_NS = NS_PER_S // 50
_NO_ORIGIN_E7 = (1000, -300)
_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL
    | mavlink.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
    | mavlink.MAV_SYS_STATUS_SENSOR_YAW_POSITION
    | mavlink.MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL
    | mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
    | mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | mavlink.MAV_SYS_STATUS_AHRS
    | mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
)
_BATTERY = mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
_AIRSPEED = mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
_RC = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
_ESTIMATE = mavlink.MAV_SYS_STATUS_AHRS
_XY_CONTROL = mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
_GPS = mavlink.MAV_SYS_STATUS_SENSOR_GPS
_GEOFENCE = mavlink.MAV_SYS_STATUS_GEOFENCE
_PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
_EKF_READY = (
    mavlink.EKF_ATTITUDE
    | mavlink.EKF_VELOCITY_HORIZ
    | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_HORIZ_REL
    | mavlink.EKF_POS_HORIZ_ABS
    | mavlink.EKF_POS_VERT_ABS
    | mavlink.EKF_PRED_POS_HORIZ_REL
    | mavlink.EKF_PRED_POS_HORIZ_ABS
)
_MODE_BITS = {
    Mode.AUTO: mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED,
    Mode.RTL: mavlink.MAV_MODE_FLAG_GUIDED_ENABLED,
    Mode.LOITER: mavlink.MAV_MODE_FLAG_GUIDED_ENABLED,
    Mode.GUIDED: mavlink.MAV_MODE_FLAG_GUIDED_ENABLED,
    Mode.TAKEOFF: mavlink.MAV_MODE_FLAG_GUIDED_ENABLED,
    Mode.CIRCLE: mavlink.MAV_MODE_FLAG_GUIDED_ENABLED,
}
_BLOCKED_M_S = 1.0
"""Airspeed that a blocked sensor measures."""
_GLITCHING = 0x8000
"""EKF_GPS_GLITCHING of ArduPilot, which this dialect does not name."""
_NO_ABSOLUTE = mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_PRED_POS_HORIZ_ABS
_CHARGE_STATES = (
    mavlink.MAV_BATTERY_CHARGE_STATE_OK,
    mavlink.MAV_BATTERY_CHARGE_STATE_LOW,
    mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL,
    mavlink.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
)
_DEAD_RECKONING_S = 10.0
"""From the loss of the fix until ArduPilot's estimate says that it has no absolute position."""
_GLITCH_SEEN_S = 2.0
_PX4_GPS_DROPPED_S = 7.5
_PX4_POSITION_LOST_S = 33.0
_AIRSPEED_DISABLED_S = 4.0


def _signed_deg(angle_deg: float) -> int:
    return int((angle_deg + 180.0) % 360.0 - 180.0)


class Telemetry:
    """Builds messages from the state of a vehicle."""

    def __init__(self, autopilot: Autopilot, gps_noise_std_m: float, rng: np.random.Generator) -> None:
        self._autopilot = autopilot
        self._airframe = autopilot.airframe
        self._geodesy = autopilot.geodesy
        self._noise_std_m = gps_noise_std_m
        self._rng = rng
        self._builders: dict[int, Callable[[int], Any]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self.heartbeat,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self.sys_status,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self.system_time,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self.gps_raw_int,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self.attitude,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self.global_position_int,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: self.mission_current,
            mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: self.nav_controller_output,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self.vfr_hud,
            mavlink.MAVLINK_MSG_ID_WIND: self.wind,
            mavlink.MAVLINK_MSG_ID_WIND_COV: self.wind_cov,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self.battery_status,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self.ekf_status_report,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: self.estimator_status,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self.extended_sys_state,
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self.autopilot_version,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self.home_position,
            mavlink.MAVLINK_MSG_ID_HIGH_LATENCY2: self.high_latency2,
        }

    def __contains__(self, message_id: int) -> bool:
        return message_id in self._builders

    def build(self, message_id: int, t_ns: int) -> Any | None:
        """Return the message at `t_ns`; None if it has no content yet."""
        return self._builders[message_id](t_ns)

    def _boot_ms(self, t_ns: int) -> int:
        return ((t_ns - self._autopilot.boot_t_ns) // 1_000_000) & 0xFFFFFFFF

    def _lat_lon_alt(self, t_ns: int, error_m: tuple[float, float]) -> tuple[int, int, int]:
        """Return 1e-7 degrees, 1e-7 degrees and millimetres above sea level, with noise."""
        airframe = self._airframe
        alt_mm = round((self._geodesy.frame.alt_msl_m + airframe.alt_rel_m) * 1e3)
        if not self._autopilot.is_position_known(t_ns):
            return (*_NO_ORIGIN_E7, alt_mm)
        std = self._noise_std_m
        normal = self._rng.standard_normal
        east_m, north_m = error_m
        lat, lon = self._geodesy.to_geodetic(
            airframe.east_m + east_m + std * normal(), airframe.north_m + north_m + std * normal()
        )
        return round(lat * 1e7), round(lon * 1e7), alt_mm

    def heartbeat(self, t_ns: int) -> Any:
        """Return type, mode and arming."""
        autopilot = self._autopilot
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | _MODE_BITS.get(autopilot.mode, 0)
        if autopilot.mode is Mode.MANUAL:
            base |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        else:
            base |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        if autopilot.armed:
            base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        status = mavlink.MAV_STATE_ACTIVE if autopilot.is_active(t_ns) else mavlink.MAV_STATE_STANDBY
        if autopilot.failsafe.is_critical:
            status = mavlink.MAV_STATE_CRITICAL
        traits = autopilot.traits
        custom_mode = traits.custom_mode(autopilot.mode)
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_FIXED_WING, traits.mav_autopilot, base, custom_mode, status, 3
        )

    def _battery_percent(self, t_ns: int) -> int:
        return round(self._autopilot.battery.percent(t_ns))

    def _battery_mv(self, t_ns: int) -> int:
        return self._autopilot.battery.voltage_mv(t_ns)

    def sys_status(self, t_ns: int) -> Any:
        """Return the sensors present, enabled and healthy, and the battery."""
        autopilot = self._autopilot
        faults = autopilot.faults
        known = autopilot.is_position_known(t_ns)
        ready = autopilot.prearm_failure(t_ns) is None
        is_px4 = autopilot.traits is PX4
        present = _SENSORS | _BATTERY | _GPS | _PREARM | _RC
        fence = autopilot.fence
        enabled = present | (_GEOFENCE if fence.is_enabled else 0)
        present |= _GEOFENCE
        health = (
            (0 if fence.is_breached and not is_px4 else _GEOFENCE)
            | _SENSORS
            | (0 if autopilot.failsafe.battery_level else _BATTERY)
            | (0 if autopilot.failsafe.is_rc_lost else _RC)
            | (_GPS if known else 0)
            | (_PREARM if ready else 0)
        )
        if is_px4 and FaultKind.AIRSPEED in faults:
            health &= ~_AIRSPEED
        elif faults.has_lasted(FaultKind.AIRSPEED, _AIRSPEED_DISABLED_S, t_ns):
            enabled &= ~_AIRSPEED  # It is disabled, not unhealthy.
        if not is_px4:
            if FaultKind.GPS in faults:
                health &= ~_GPS
            if autopilot.position_error_m(t_ns) != (0.0, 0.0):
                health &= ~_ESTIMATE
        else:  # It drops a receiver from what is there; that of the GPS stays healthy, a fence has no bit.
            if fence.is_breached or FaultKind.AIRSPEED in faults:
                health &= ~_PREARM
            if autopilot.failsafe.is_rc_lost:
                present &= ~_RC
            if faults.has_lasted(FaultKind.GPS, _PX4_GPS_DROPPED_S, t_ns):
                present &= ~_GPS
                enabled &= ~_GPS
            if faults.has_lasted(FaultKind.GPS, _PX4_POSITION_LOST_S, t_ns):
                health &= ~_XY_CONTROL
        battery = self._battery_mv(t_ns), 1200, self._battery_percent(t_ns)
        return mavlink.MAVLink_sys_status_message(present, enabled, health, 180, *battery, *[0] * 6)

    def system_time(self, t_ns: int) -> Any:
        """Return the run time."""
        return mavlink.MAVLink_system_time_message(t_ns // 1000, self._boot_ms(t_ns))

    def gps_raw_int(self, t_ns: int) -> Any:
        """Return the receiver's fix."""
        has_fault = FaultKind.GPS in self._autopilot.faults
        if has_fault or not self._autopilot.is_position_known(t_ns):
            fix = mavlink.GPS_FIX_TYPE_NO_FIX
            satellites = 0
            if has_fault and self._autopilot.traits is PX4:
                fix = mavlink.GPS_FIX_TYPE_NO_GPS
            elif has_fault:
                satellites = 3
            return mavlink.MAVLink_gps_raw_int_message(
                t_ns // 1000, fix, 0, 0, 0, 9999, 9999, 0, 0, satellites
            )
        airframe = self._airframe
        lat, lon, alt = self._lat_lon_alt(t_ns, self._autopilot.receiver_error_m())
        speed = math.hypot(airframe.speed_m_s, airframe.sideslip_m_s)
        course_cdeg = int(math.degrees(airframe.course_rad) * 100.0) % 36000
        accuracy_mm = round(self._noise_std_m * 1e3)
        return mavlink.MAVLink_gps_raw_int_message(
            t_ns // 1000, mavlink.GPS_FIX_TYPE_3D_FIX, lat, lon, alt, 121, 200, round(speed * 100),
            course_cdeg, 10, alt, accuracy_mm, accuracy_mm, 200,
        )  # fmt: skip

    def attitude(self, t_ns: int) -> Any:
        """Return bank, heading and their rates; pitch is not simulated."""
        a = self._airframe
        yaw = (a.heading_rad + math.pi) % (2.0 * math.pi) - math.pi
        return mavlink.MAVLink_attitude_message(
            self._boot_ms(t_ns), a.roll_rad, 0.0, yaw, a.roll_rate_rad_s, 0.0, a.yaw_rate_rad_s
        )

    def global_position_int(self, t_ns: int) -> Any:
        """Return position and velocity over ground."""
        a = self._airframe
        lat, lon, alt_mm = self._lat_lon_alt(t_ns, self._autopilot.position_error_m(t_ns))
        east, north = a.velocity_m_s
        return mavlink.MAVLink_global_position_int_message(
            self._boot_ms(t_ns), lat, lon, alt_mm, round((a.alt_rel_m - self._autopilot.home.alt_m) * 1e3),
            round(north * 100), round(east * 100), round(-a.climb_m_s * 100),
            int(math.degrees(a.heading_rad) * 100.0) % 36000,
        )  # fmt: skip

    def mission_current(self, _t_ns: int) -> Any:
        """Return the current item; `total` excludes home."""
        autopilot = self._autopilot
        not_in_mission = 2 if autopilot.traits is PX4 else 0
        return mavlink.MAVLink_mission_current_message(
            autopilot.seq, max(len(autopilot.mission) - autopilot.traits.home_items, 0),
            int(autopilot.mission_state),
            1 if autopilot.mode in (Mode.AUTO, Mode.LAND) else not_in_mission,
        )  # fmt: skip

    def nav_controller_output(self, _t_ns: int) -> Any:
        """Return desired course, bearing and distance of the waypoint, and cross-track error."""
        a = self._airframe
        goal = self._autopilot.goal
        nav_deg = 0.0
        point_deg = 0.0
        distance_m = 0.0
        off_m = 0.0
        if isinstance(goal, Straight):
            nav_deg = point_deg = math.degrees(goal.heading_rad)
        else:
            nav_deg = math.degrees(goal.bearing_rad(a, REFERENCE_S * a.speed_m_s))
            point_deg = math.degrees(math.atan2(goal.east_m - a.east_m, goal.north_m - a.north_m))
            distance_m = goal.distance_m(a)
            off_m = goal.cross_track_m(a)
        return mavlink.MAVLink_nav_controller_output_message(
            math.degrees(a.roll_rad), 0.0, _signed_deg(nav_deg), _signed_deg(point_deg),
            min(round(distance_m), 65535), self._autopilot.alt_command_m - a.alt_rel_m, 0.0, off_m,
        )  # fmt: skip

    def vfr_hud(self, _t_ns: int) -> Any:
        """Return speeds, heading, altitude and climb."""
        a = self._airframe
        autopilot = self._autopilot
        speed = math.hypot(a.speed_m_s, a.sideslip_m_s)
        airspeed = a.speed_m_s
        if FaultKind.AIRSPEED in autopilot.faults:
            airspeed = math.nan if autopilot.traits is PX4 else _BLOCKED_M_S
        throttle = 50 if autopilot.flying else 0
        if autopilot.armed and FaultKind.ENGINE in autopilot.faults:
            throttle = 100  # It asks for thrust.
        return mavlink.MAVLink_vfr_hud_message(
            airspeed, speed, int(math.degrees(a.heading_rad) % 360.0), throttle,
            self._geodesy.frame.alt_msl_m + a.alt_rel_m, a.climb_m_s,
        )  # fmt: skip

    def wind(self, _t_ns: int) -> Any | None:
        """Return where ArduPlane's wind comes from, and its speed; None if the airframe estimates none."""
        a = self._airframe
        speed_m_s = math.hypot(a.wind_east_m_s, a.wind_north_m_s)
        if speed_m_s == 0.0 and not a.estimates_calm:
            return None
        from_deg = math.degrees(math.atan2(-a.wind_east_m_s, -a.wind_north_m_s))
        return mavlink.MAVLink_wind_message(from_deg, speed_m_s, 0.0)

    def wind_cov(self, t_ns: int) -> Any | None:
        """Return the velocity of PX4's wind; None if the airframe estimates none."""
        a = self._airframe
        if a.wind_east_m_s == 0.0 and a.wind_north_m_s == 0.0 and not a.estimates_calm:
            return None
        return mavlink.MAVLink_wind_cov_message(
            t_ns // 1000, a.wind_north_m_s, a.wind_east_m_s, 0.0, 0.1, 0.1, a.alt_rel_m, 0.5, 0.5
        )

    def battery_status(self, t_ns: int) -> Any:
        """Return the battery."""
        percent = self._battery_percent(t_ns)
        level = self._autopilot.failsafe.battery_level
        return mavlink.MAVLink_battery_status_message(
            0, mavlink.MAV_BATTERY_FUNCTION_ALL, mavlink.MAV_BATTERY_TYPE_LIPO, 2500,
            [self._battery_mv(t_ns)] + [65535] * 9, 1200, 33 * (100 - percent), -1, percent, 0,
            _CHARGE_STATES[level],
        )  # fmt: skip

    def ekf_status_report(self, t_ns: int) -> Any:
        """Return the state of the position estimate (ArduPilot)."""
        flags = _EKF_READY if self._autopilot.is_position_known(t_ns) else mavlink.EKF_ATTITUDE
        faults = self._autopilot.faults
        if faults.has_lasted(FaultKind.GPS, _DEAD_RECKONING_S, t_ns):
            flags &= ~_NO_ABSOLUTE
        if faults.has_lasted(FaultKind.GLITCH, _GLITCH_SEEN_S, t_ns):
            flags |= _GLITCHING
        return mavlink.MAVLink_ekf_status_report_message(flags, 0.05, 0.05, 0.05, 0.05, 0.0)

    def estimator_status(self, t_ns: int) -> Any:
        """Return the state of the position estimate (PX4)."""
        ready = self._autopilot.is_position_known(t_ns)
        flags = (_EKF_READY if ready else 0) | mavlink.ESTIMATOR_ATTITUDE
        faults = self._autopilot.faults
        if faults.has_lasted(FaultKind.GPS, _PX4_GPS_DROPPED_S, t_ns):
            flags &= ~mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
        if FaultKind.GLITCH in faults:
            flags |= mavlink.ESTIMATOR_GPS_GLITCH
        ratios = [0.05] * 6
        return mavlink.MAVLink_estimator_status_message(t_ns // 1000, flags, *ratios, 1.0, 1.0)

    def extended_sys_state(self, t_ns: int) -> Any:
        """Return the landed state."""
        state = self._autopilot.landed_state(t_ns)
        return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, state)

    def autopilot_version(self, _t_ns: int) -> Any:
        """Return capabilities and version of ArduPlane 4.6.0 or PX4 1.15.0, without FTP."""
        capabilities = (
            mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
            | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
            | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
            | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
        )
        capabilities |= (
            mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
            if self._autopilot.traits is PX4
            else mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
        )
        major, minor = (1, 15) if self._autopilot.traits is PX4 else (4, 6)
        version = (major << 24) | (minor << 16) | mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL
        system_id = int(self._autopilot.parameters["SYSID_THISMAV"])
        return mavlink.MAVLink_autopilot_version_message(
            capabilities, version, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, system_id
        )

    def high_latency2(self, t_ns: int) -> Any:
        """Return the summary for a satellite link, with the failure flags of GPS, battery and estimate."""
        a = self._airframe
        autopilot = self._autopilot
        is_px4 = autopilot.traits is PX4
        heartbeat = self.heartbeat(t_ns)
        lat, lon, alt_mm = self._lat_lon_alt(t_ns, autopilot.position_error_m(t_ns))
        failed = mavlink.HL_FAILURE_FLAG_GPS if FaultKind.GPS in autopilot.faults else 0
        failed |= mavlink.HL_FAILURE_FLAG_BATTERY if autopilot.failsafe.battery_level else 0
        if autopilot.position_error_m(t_ns) != (0.0, 0.0):
            failed |= mavlink.HL_FAILURE_FLAG_ESTIMATOR
        armed = ((heartbeat.base_mode + 128) & 0xFF) - 128  # as a signed byte
        return mavlink.MAVLink_high_latency2_message(
            self._boot_ms(t_ns), heartbeat.type, heartbeat.autopilot,
            heartbeat.custom_mode >> (16 if is_px4 else 0), lat, lon, round(alt_mm * 1e-3),
            round(self._geodesy.frame.alt_msl_m + autopilot.alt_command_m),
            int(math.degrees(a.heading_rad) % 360.0) // 2, 0, 0, self.vfr_hud(t_ns).throttle,
            min(round(a.speed_m_s * 5.0), 255), 0, min(round(math.hypot(*a.velocity_m_s) * 5.0), 255),
            0, 0, round(self._noise_std_m * 10.0) if is_px4 else 0, 0, -128, 0,
            self._battery_percent(t_ns), autopilot.seq, failed, -128 if is_px4 else armed, -128, -128,
        )  # fmt: skip

    def home_position(self, t_ns: int) -> Any | None:
        """Return the destination of RTL; None before there is an origin."""
        if not self._autopilot.is_position_known(t_ns):
            return None
        home = self._autopilot.mission_home()
        no_turn = [1.0, 0.0, 0.0, 0.0]
        return mavlink.MAVLink_home_position_message(
            home.x, home.y, round(home.z * 1e3), 0.0, 0.0, 0.0, no_turn, 0.0, 0.0, 0.0, t_ns // 1000
        )


# Message ids by stream of REQUEST_DATA_STREAM.
_GROUPS: dict[int, tuple[int, ...]] = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_WIND,
    ),
}
_GROUPS[mavlink.MAV_DATA_STREAM_ALL] = tuple(message_id for group in _GROUPS.values() for message_id in group)

_DEFAULT_PERIOD_NS = dict.fromkeys(
    (mavlink.MAVLINK_MSG_ID_HEARTBEAT, *_GROUPS[mavlink.MAV_DATA_STREAM_ALL]), NS_PER_S
)
_PX4_PERIOD_NS = {
    number: period_ns
    for number, period_ns in _DEFAULT_PERIOD_NS.items()
    if number not in (mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, mavlink.MAVLINK_MSG_ID_WIND)
} | dict.fromkeys(
    (
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        mavlink.MAVLINK_MSG_ID_WIND_COV,
    ),
    NS_PER_S,
)


class Streams:
    """Schedule of the messages; the first of each is due at the start."""

    def __init__(self, start_t_ns: int, px4: bool = False) -> None:
        self._default_ns = _PX4_PERIOD_NS if px4 else _DEFAULT_PERIOD_NS
        self._period_ns = dict(self._default_ns)
        self._due_ns = dict.fromkeys(self._period_ns, start_t_ns)
        self.due_ns = start_t_ns

    def pop_due(self, t_ns: int) -> list[int]:
        """Return the message ids due at `t_ns`, and schedule their next ones; missed ones are skipped."""
        if t_ns < self.due_ns:
            return []
        due = [message_id for message_id, at_ns in self._due_ns.items() if at_ns <= t_ns]
        for message_id in due:
            period_ns = self._period_ns[message_id]
            self._due_ns[message_id] += period_ns * ((t_ns - self._due_ns[message_id]) // period_ns + 1)
        self.due_ns = min(self._due_ns.values(), default=NEVER_NS)
        return due

    def set_interval(self, message_id: int, interval_us: int, t_ns: int) -> None:
        """Apply SET_MESSAGE_INTERVAL: microseconds, 0 for the default, negative to stop."""
        period_ns = interval_us * 1000 if interval_us else self._default_ns.get(message_id, -1)
        if period_ns < 0:
            self._period_ns.pop(message_id, None)
            self._due_ns.pop(message_id, None)
        else:
            self._period_ns[message_id] = max(period_ns, _MIN_PERIOD_NS)
            self._due_ns[message_id] = t_ns + self._period_ns[message_id]
        self.due_ns = min(self._due_ns.values(), default=NEVER_NS)

    def interval_us(self, message_id: int) -> int:
        """Return the interval for MESSAGE_INTERVAL; -1 if it is not sent."""
        period_ns = self._period_ns.get(message_id)
        return -1 if period_ns is None else period_ns // 1000

    def set_group(self, stream_id: int, rate_hz: int, is_on: bool, t_ns: int) -> None:
        """Apply REQUEST_DATA_STREAM; ignore an unknown stream."""
        interval_us = 1_000_000 // rate_hz if is_on and rate_hz > 0 else -1
        for message_id in _GROUPS.get(stream_id, ()):
            self.set_interval(message_id, interval_us, t_ns)
