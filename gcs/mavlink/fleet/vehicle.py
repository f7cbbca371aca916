"""State of one vehicle from its messages: position, mode, mission item, health and link quality.

Fields: https://mavlink.io/en/messages/common.html. Position and ground speed come from GLOBAL_POSITION_INT
(1e-7 degrees, mm, cm/s), mode and arming from HEARTBEAT, the current item from MISSION_CURRENT. Loss is
counted by gaps in the sequence of the autopilot's frames; a late frame is deducted.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.geo import LocalFrame
from gcs.mavlink.autopilots import mode_name
from gcs.mavlink.fleet.checks.link_timeouts import STALE_AFTER_NS, lost_after_ns
from gcs.mavlink.fleet.checks.position_checks import (
    MAX_DISTANCE_M,
    MAX_LATE_NS,
    MIN_JUMP_NS,
    position_problem,
)
from gcs.mavlink.fleet.checks.position_plausibility import Report
from gcs.mavlink.fleet.checks.report_consistency import Sample
from gcs.mavlink.fleet.fleet_state import Liveness, VehicleLink
from gcs.mavlink.fleet.heartbeat import heartbeat_key
from gcs.mavlink.fleet.high_latency import (
    HighLatency,
    has_fix,
    heartbeat_of,
    position_of,
    sys_status_of,
)
from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.fleet.stream_requests import StreamRequests
from gcs.mavlink.fleet.telemetry_table import (
    ADDRESS,
    BATTERY_PERCENT,
    BEST_FIX,
    BOOT_MS,
    BOOT_OFFSET_NS,
    CHECK_NEXT,
    DUE_NS,
    ESTIMATOR_FLAGS,
    FIX_TYPE,
    FRAMES,
    HEARD_NS,
    HEARTBEAT_KEY,
    IN_LATE_RUN,
    IS_SIGNED,
    LANDED_STATE,
    LAST_SEQUENCE,
    LOST,
    NONE,
    POSITION_NS,
    POSITIONS,
    SENSORS_FAILED,
    SENSORS_GOOD,
    THROTTLE_PERCENT,
    VehicleRecord,
)
from gcs.mavlink.frames.codec import Encoder, Message, next_sequence
from gcs.mavlink.mission.items import Home
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, NoticeCode, Notify, VehicleState

_ARMED: Final = dialect.MAV_MODE_FLAG_SAFETY_ARMED
_UNKNOWN_HEADING: Final = 65535
_SLOW_M_S: Final = 0.5
_MAX_WIND_M_S: Final = 200.0
"""A greater wind is an error of the estimate."""
_OLD_POSITION_NS: Final = ns(1.0)


@dataclass(frozen=True, slots=True)
class Health:
    """Link and equipment of a vehicle, for display."""

    system_id: int
    liveness: Liveness
    heard_t_ns: int
    address: Address | None
    autopilot: int
    """MAV_AUTOPILOT."""
    home: Home | None
    fix_type: int | None
    """GPS_FIX_TYPE; None if none is reported."""
    battery_percent: int | None
    boots: int
    """Reboots seen."""
    frames: int
    lost: int
    conflicts: int
    """Frames that used its id from another address."""
    refused: dict[str, int]
    """Refused position reports, by reason."""
    signed: bool
    """True if its last frame was signed. Where there is a key, signatures are checked before frames come
    here."""


class Readings(NamedTuple):
    """Newest telemetry that shows the health of a vehicle; None for what it has not sent."""

    fix_type: int | None
    """GPS_FIX_TYPE."""
    battery_percent: int | None
    sensors_failed: int | None
    """MAV_SYS_STATUS_SENSOR bits that are enabled and not healthy."""
    sensors_good: int | None
    """MAV_SYS_STATUS_SENSOR bits that are enabled and healthy."""
    throttle_percent: int | None
    estimator_flags: int | None
    """EKF_STATUS_FLAGS or ESTIMATOR_STATUS_FLAGS; the lowest five bits have the same meaning in both."""


class Vehicle:
    """State of one expected vehicle. Only frames of its own autopilot reach it.

    Parameters
    ----------
    link : VehicleLink
        What is known of it.
    record : (WIDTH,) array
        Its row of the telemetry table: fields that routine telemetry changes, here or in the kernel.
    """

    def __init__(
        self,
        system_id: int,
        link: VehicleLink,
        record: VehicleRecord,
        frame: LocalFrame,
        encoder: Encoder,
        stream_requests: StreamRequests,
        max_speed_m_s: float,
    ) -> None:
        self.system_id = system_id
        self.link = link
        self.record = record
        self.stream_requests = stream_requests
        self._encoder = encoder
        self._frame = frame
        self._max_speed_m_s = max_speed_m_s
        self._state: VehicleState | None = None
        """Derived from link and record; None after a change."""
        self._state_positions = 0
        """`POSITIONS` of that state."""
        self._handlers: dict[str, Callable[[Message, int, Notify], None]] = {
            "HEARTBEAT": self._on_heartbeat,
            "HIGH_LATENCY2": self._on_high_latency,
            "GLOBAL_POSITION_INT": self._on_position,
            "MISSION_CURRENT": self._on_mission_current,
            "HOME_POSITION": self._on_home,
            "SYS_STATUS": self._on_sys_status,
            "GPS_RAW_INT": self._on_gps,
            "VFR_HUD": self._on_hud,
            "EKF_STATUS_REPORT": self._on_estimator,
            "ESTIMATOR_STATUS": self._on_estimator,
            "EXTENDED_SYS_STATE": self._on_extended_state,
            "WIND": self._on_wind,
            "WIND_COV": self._on_wind,
            "COMMAND_ACK": self._on_command_ack,
        }

    @property
    def heard_t_ns(self) -> int:
        """Time of its autopilot's last frame."""
        return self.record.item(HEARD_NS)

    @property
    def signed(self) -> bool:
        """True if its last frame was signed."""
        return bool(self.record[IS_SIGNED])

    @property
    def lost(self) -> int:
        """Frames missing in the sequence."""
        return self.record.item(LOST)

    def encode(self, message: Message) -> bytes:
        """Return the next frame to it."""
        frame = self._encoder.pack(message, self.link.sequence)
        self.link.sequence = next_sequence(self.link.sequence)
        return frame

    def set_address(self, address: Address, number: int) -> None:
        """Set the address, and its number in the telemetry table; request the streams again."""
        if self.link.address != address:
            self._note_move(self.heard_t_ns)
        self.link.address = address
        self.record[ADDRESS] = number
        self.record[LAST_SEQUENCE] = NONE
        self.record[DUE_NS] = 0
        self.record[HEARTBEAT_KEY] = NONE
        self.stream_requests.begin()

    def _note_move(self, last_t_ns: int) -> None:
        """Note that its frames come by another link from now on, and the last one came at `last_t_ns`."""
        self.link.last_link_t_ns = last_t_ns
        self.link.last_link_boot_ms = self.record.item(BOOT_MS)
        self.record[IN_LATE_RUN] = False

    def is_behind(self, t_ns: int) -> bool:
        """Return True if a frame that is heard now may be older than those before a change of link.

        The link may be late by `MAX_LATE_NS`. A position report that is newer than all before shows that it
        has caught up; so does a reboot. Without an earlier report there is nothing to compare with.
        """
        boot_ms = self.record.item(BOOT_MS)
        is_newer = boot_ms == NONE or boot_ms != self.link.last_link_boot_ms
        return not is_newer and t_ns - self.link.last_link_t_ns <= MAX_LATE_NS

    def count(self, sequence: int, t_ns: int) -> None:
        """Count one frame of its autopilot and the gap before it."""
        record = self.record
        record[FRAMES] += 1
        record[HEARD_NS] = t_ns
        if record[LAST_SEQUENCE] == NONE:
            record[LAST_SEQUENCE] = sequence
            return
        ahead = (sequence - record.item(LAST_SEQUENCE)) % 256
        if 0 < ahead < 128:
            record[LOST] += ahead - 1
            record[LAST_SEQUENCE] = sequence
        elif ahead >= 128:
            record[LOST] = max(0, self.lost - 1)

    def forward_next_heartbeat(self) -> None:
        """Have its next heartbeat processed here, even if it is unchanged."""
        self.record[HEARTBEAT_KEY] = NONE

    def poll(self, t_ns: int) -> list[Message]:
        """Return the requests to it that are due."""
        if t_ns >= self.link.requests.idle_until_ns and self.record[POSITIONS]:
            # The kernel only stores it.
            self.stream_requests.heard("GLOBAL_POSITION_INT", self.record.item(POSITION_NS))
        return self.stream_requests.poll(t_ns)

    def apply_message(self, message: Message, t_ns: int, notify: Notify) -> None:
        """Apply one message to the state."""
        name = message.get_type()
        if name != "HOME_POSITION":  # Noted there, if it is plausible.
            self.stream_requests.heard(name, t_ns)
        handler = self._handlers.get(name)
        if handler is not None:
            handler(message, t_ns, notify)

    def state(self) -> VehicleState | None:
        """Return its state; None before its first accepted position."""
        positions = self.record.item(POSITIONS)
        if positions and (self._state is None or positions != self._state_positions):
            self._state_positions = positions
            link = self.link
            t_ns, east_m, north_m, alt_msl_m, speed_m_s, course_rad, climb_m_s = self._last_position()
            self._state = VehicleState(
                self.system_id, t_ns, east_m, north_m, alt_msl_m, speed_m_s, course_rad,
                link.mode, link.armed, link.mission_seq, climb_m_s, self._grounded_by_autopilot(),
                self.record.item(LANDED_STATE) == dialect.MAV_LANDED_STATE_LANDING,
                *self._resolution(),
            )  # fmt: skip
        return self._state

    def _resolution(self) -> tuple[float, float]:
        """Return period and standard deviation of high-latency reports; zeros with usual telemetry."""
        slow = self.link.high_latency
        return (0.0, 0.0) if slow is None else (slow.period_ns / NS_PER_S, slow.std_m)

    def _grounded_by_autopilot(self) -> bool | None:
        """Return whether the autopilot itself says that it stands on the ground; None if it says nothing.

        PX4 reports MAV_LANDED_STATE; so does ArduPilot on request. Its heartbeat is STANDBY while it does not
        fly, also armed (`GCS_MAVLINK_Plane::vehicle_system_status`).
        """
        if self.link.high_latency is not None:
            return None
        landed = self.record.item(LANDED_STATE)
        status = self.link.system_status
        if landed > dialect.MAV_LANDED_STATE_UNDEFINED:
            return landed == dialect.MAV_LANDED_STATE_ON_GROUND
        if self.link.autopilot != dialect.MAV_AUTOPILOT_ARDUPILOTMEGA or status == dialect.MAV_STATE_CRITICAL:
            return None
        return status == dialect.MAV_STATE_STANDBY

    def _last_position(self) -> tuple[int, float, float, float, float, float, float]:
        """Return time, east, north, height above sea level, ground speed, course and climb rate."""
        t_ns, lat, lon, alt_mm, v_north_cm_s, v_east_cm_s, v_down_cm_s, heading_cdeg = self.record[
            POSITION_NS:POSITIONS
        ].tolist()
        east_m, north_m = self._frame.to_local(lat * 1e-7, lon * 1e-7)
        v_north_m_s = v_north_cm_s * 0.01
        v_east_m_s = v_east_cm_s * 0.01
        speed_m_s = math.hypot(v_east_m_s, v_north_m_s)
        if speed_m_s < _SLOW_M_S and heading_cdeg != _UNKNOWN_HEADING:
            course_rad = math.radians(heading_cdeg * 0.01)
            course_rad = math.atan2(math.sin(course_rad), math.cos(course_rad))
        else:
            course_rad = math.atan2(v_east_m_s, v_north_m_s)
        return t_ns, east_m, north_m, alt_mm * 1e-3, speed_m_s, course_rad, v_down_cm_s * -0.01

    def health(self) -> Health:
        """Return its link and equipment."""
        link = self.link
        return Health(
            system_id=self.system_id,
            liveness=link.liveness,
            heard_t_ns=self.heard_t_ns,
            address=link.address,
            autopilot=link.autopilot,
            home=link.home,
            fix_type=self._value_or_none(FIX_TYPE),
            battery_percent=self._value_or_none(BATTERY_PERCENT),
            boots=link.boots,
            frames=self.record.item(FRAMES),
            lost=self.lost,
            conflicts=link.conflicts,
            refused=dict(link.checks.refused),
            signed=self.signed,
        )

    def readings(self) -> Readings:
        """Return the newest telemetry that shows its health."""
        return Readings(
            fix_type=self._value_or_none(FIX_TYPE),
            battery_percent=self._value_or_none(BATTERY_PERCENT),
            sensors_failed=self._value_or_none(SENSORS_FAILED),
            sensors_good=self._value_or_none(SENSORS_GOOD),
            throttle_percent=self._value_or_none(THROTTLE_PERCENT),
            estimator_flags=self._value_or_none(ESTIMATOR_FLAGS),
        )

    def _value_or_none(self, column: int) -> int | None:
        value = self.record.item(column)
        return None if value == NONE else value

    # ------------------------------------------------------------ messages

    def _on_heartbeat(self, message: Message, t_ns: int, notify: Notify) -> None:
        self._end_high_latency(notify)
        if not self.is_behind(t_ns):
            self._apply_heartbeat(message, notify)

    def _on_high_latency(self, message: Message, t_ns: int, notify: Notify) -> None:
        """Apply a high-latency report, unless usual telemetry says more."""
        record = self.record
        link = self.link
        if link.high_latency is None:
            if record[POSITIONS] and t_ns - record[POSITION_NS] <= STALE_AFTER_NS:
                return
            self._note_move(t_ns)
            link.high_latency = HighLatency()
            record[[LANDED_STATE, ESTIMATOR_FLAGS]] = NONE
            notify(NoticeCode.HIGH_LATENCY)
        link.high_latency.add_report(message)
        self._apply_position(position_of(message), t_ns, notify)
        if not self.is_behind(t_ns):
            self._apply_heartbeat(heartbeat_of(message, armed=link.armed), notify)
        known = NONE not in (record[SENSORS_FAILED], record[SENSORS_GOOD])
        sensors = record.item(SENSORS_FAILED) | record.item(SENSORS_GOOD) if known else 0
        self._on_sys_status(sys_status_of(message, sensors), t_ns, notify)
        record[THROTTLE_PERCENT] = message.throttle
        record[FIX_TYPE] = NONE if has_fix(message) else dialect.GPS_FIX_TYPE_NO_FIX
        link.mission_seq = message.wp_num
        self._state = None
        record[CHECK_NEXT] = True  # so that usual telemetry comes here
        record[HEARTBEAT_KEY] = NONE

    def _end_high_latency(self, notify: Notify) -> None:
        """Note that usual telemetry comes again."""
        if self.link.high_latency is not None:
            self.link.high_latency = None
            self._state = None
            self.record[DUE_NS] = 0
            self.stream_requests.begin()
            notify(NoticeCode.HIGH_LATENCY_OVER)

    def _apply_heartbeat(self, message: Message, notify: Notify) -> None:
        link = self.link
        link.is_awaited = False
        if (message.autopilot, message.type) != (link.autopilot, link.vehicle_type):
            self._set_autopilot(message, notify)
        mode = mode_name(message)
        armed = bool(message.base_mode & _ARMED)
        if link.mode and mode != link.mode:
            notify(NoticeCode.MODE_CHANGED, before=link.mode, mode=mode)
        if link.mode and armed != link.armed:
            notify(NoticeCode.ARMED if armed else NoticeCode.DISARMED)
        if (mode, armed, message.system_status) != (link.mode, link.armed, link.system_status):
            link.mode = mode
            link.armed = armed
            link.system_status = message.system_status
            self._state = None
        self.record[HEARTBEAT_KEY] = heartbeat_key(message)

    def _set_autopilot(self, heartbeat: Message, notify: Notify) -> None:
        """Note its firmware."""
        before = (self.link.autopilot, self.link.vehicle_type)
        self.link.autopilot = heartbeat.autopilot
        self.link.vehicle_type = heartbeat.type
        if before[0] != dialect.MAV_AUTOPILOT_INVALID:
            notify(
                NoticeCode.TYPE_CHANGED,
                autopilot=heartbeat.autopilot,
                vehicle_type=heartbeat.type,
                autopilot_before=before[0],
                vehicle_type_before=before[1],
            )
        if self.link.profile is None:
            notify(NoticeCode.FIRMWARE_UNKNOWN, autopilot=heartbeat.autopilot, vehicle_type=heartbeat.type)

    def _on_position(self, message: Message, t_ns: int, notify: Notify) -> None:
        self._end_high_latency(notify)
        self._apply_position(message, t_ns, notify)

    def _apply_position(self, message: Message, t_ns: int, notify: Notify) -> None:
        checks = self.link.checks
        self._resume_from_record()
        min_jump_ns = MAX_LATE_NS if self.is_behind(t_ns) else MIN_JUMP_NS
        order = checks.clock.add_report(self.record, message.time_boot_ms, t_ns, min_jump_ns)
        if order == "rebooted":
            self._reboot(notify)
        problem = self._check_position(message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
        if order == "late" and problem:
            problem = "late"
        elif not problem:
            report = self._report(
                t_ns, message.time_boot_ms, message.lat, message.lon, message.vx, message.vy
            )
            problem = self._check_motion(report, notify, late=order == "late")
        if problem:
            checks.refused[problem] = checks.refused.get(problem, 0) + 1
            return
        self.record[POSITION_NS:POSITIONS] = (
            t_ns, message.lat, message.lon, message.alt, message.vx, message.vy, message.vz, message.hdg
        )  # fmt: skip
        self.record[POSITIONS] += 1
        checks.positions = self.record.item(POSITIONS)

    def _report(
        self, t_ns: int, boot_ms: int, lat: int, lon: int, v_north_cm_s: int, v_east_cm_s: int
    ) -> Report:
        east_m, north_m = self._frame.to_local(lat * 1e-7, lon * 1e-7)
        return Report(t_ns, boot_ms, east_m, north_m, math.hypot(v_east_cm_s, v_north_cm_s) * 0.01)

    def _resume_from_record(self) -> None:
        """Continue the checks from the last position that the kernel stored."""
        checks = self.link.checks
        if self.record.item(POSITIONS) == checks.positions:
            return
        checks.positions = self.record.item(POSITIONS)
        t_ns, lat, lon, _, v_north_cm_s, v_east_cm_s, _, _ = self.record[POSITION_NS:POSITIONS].tolist()
        last = self._report(t_ns, self.record.item(BOOT_MS), lat, lon, v_north_cm_s, v_east_cm_s)
        checks.motion.resume(last)
        checks.duplicates.resume(last)

    def _check_motion(self, report: Report, notify: Notify, *, late: bool) -> str:
        """Compare a report with those before; return why it is refused."""
        checks = self.link.checks
        max_speed_m_s = self._max_speed_m_s
        checks.duplicates.add_report(report, max_speed_m_s, notify)
        problem = "late" if late else checks.motion.check_report(report, max_speed_m_s, notify)
        self.record[CHECK_NEXT] = bool(problem) or checks.duplicates.is_watching
        return problem

    def check_position_age(self, t_ns: int, notify: Notify) -> None:
        """Notify when no position is accepted for a while, and when one is again."""
        if not self.record[POSITIONS]:
            return
        checks = self.link.checks
        silent_ns = t_ns - max(self.record.item(POSITION_NS), self.link.returned_t_ns)
        is_late = silent_ns > lost_after_ns(self.link)
        if not checks.has_no_position and is_late:
            checks.has_no_position = True
            why = ", ".join(f"{count} {reason}" for reason, count in checks.refused.items())
            notify(NoticeCode.NO_POSITION, silence_s=silent_ns / NS_PER_S, reasons=why)
        elif checks.has_no_position and not is_late:
            checks.has_no_position = False
            notify(NoticeCode.POSITION_BELIEVED)

    def check_consistency(self, t_ns: int, notify: Notify) -> None:
        """Compare the newest position with the one a second ago."""
        checks = self.link.checks
        positions = self.record.item(POSITIONS)
        if not positions or not checks.consistency.is_due(t_ns):
            return
        at_t_ns, lat, lon, alt_mm, v_north_cm_s, v_east_cm_s, _, _ = self.record[
            POSITION_NS:POSITIONS
        ].tolist()
        if t_ns - at_t_ns > _OLD_POSITION_NS:
            return
        east_m, north_m = self._frame.to_local(lat * 1e-7, lon * 1e-7)
        sample = Sample(
            t_ns,
            self.record.item(BOOT_MS),
            self.record.item(BOOT_OFFSET_NS),
            east_m,
            north_m,
            alt_mm * 1e-3,
            v_east_cm_s * 0.01,
            v_north_cm_s * 0.01,
            self.record.item(FRAMES),
            self.link.armed,
        )
        home = self.link.home
        checks.consistency.add_sample(sample, None if home is None else home.alt_msl_m, notify)

    def check_battery(self, notify: Notify) -> None:
        """Notify when the battery of an armed vehicle is low."""
        charge_percent = self.record.item(BATTERY_PERCENT)
        if charge_percent != NONE:
            self.link.battery.check(charge_percent, notify, armed=self.link.armed)

    def _check_position(self, lat_deg: float, lon_deg: float, alt_msl_m: float) -> str:
        if NONE < self.record[BEST_FIX] < dialect.GPS_FIX_TYPE_3D_FIX:
            return "no fix"
        return position_problem(lat_deg, lon_deg, alt_msl_m, self._frame, MAX_DISTANCE_M)

    def _reboot(self, notify: Notify) -> None:
        """Reset the state after a boot; mode and arming come with the next heartbeat."""
        self.link.boots += 1
        self.link.mission_seq = -1
        self.link.home = None
        self.record[BEST_FIX] = self.record[LAST_SEQUENCE] = self.record[HEARTBEAT_KEY] = NONE
        self.record[LANDED_STATE] = self.record[ESTIMATOR_FLAGS] = NONE
        self.record[SENSORS_FAILED] = self.record[SENSORS_GOOD] = NONE
        self.link.checks.motion.begin()
        self.stream_requests.begin()
        notify(NoticeCode.REBOOTED)

    def _on_mission_current(self, message: Message, _t_ns: int, _notify: Notify) -> None:
        if message.seq != self.link.mission_seq:
            self.link.mission_seq = message.seq
            self._state = None

    def _on_home(self, message: Message, t_ns: int, _notify: Notify) -> None:
        home = Home(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
        if not position_problem(*home, self._frame, MAX_DISTANCE_M):
            self.link.home = home
            self.stream_requests.heard("HOME_POSITION", t_ns)

    def _on_sys_status(self, message: Message, _t_ns: int, _notify: Notify) -> None:
        percent = message.battery_remaining
        self.record[BATTERY_PERCENT] = percent if 0 <= percent <= 100 else NONE
        enabled = message.onboard_control_sensors_enabled
        healthy = message.onboard_control_sensors_health
        self.record[SENSORS_FAILED] = enabled & ~healthy
        self.record[SENSORS_GOOD] = enabled & healthy

    def _on_gps(self, message: Message, _t_ns: int, _notify: Notify) -> None:
        self.record[FIX_TYPE] = message.fix_type
        self.record[BEST_FIX] = max(message.fix_type, self.record.item(BEST_FIX))

    def _on_hud(self, message: Message, _t_ns: int, _notify: Notify) -> None:
        self.record[THROTTLE_PERCENT] = message.throttle

    def _on_estimator(self, message: Message, _t_ns: int, _notify: Notify) -> None:
        self.record[ESTIMATOR_FLAGS] = message.flags

    def _on_extended_state(self, message: Message, _t_ns: int, _notify: Notify) -> None:
        self.record[LANDED_STATE] = message.landed_state

    def _on_wind(self, message: Message, _t_ns: int, _notify: Notify) -> None:
        if message.get_type() == "WIND_COV":
            wind_m_s = (message.wind_y, message.wind_x)
        elif math.isfinite(message.direction):
            from_rad = math.radians(message.direction)
            wind_m_s = (-message.speed * math.sin(from_rad), -message.speed * math.cos(from_rad))
        else:
            wind_m_s = (math.nan, math.nan)
        is_known = math.hypot(*wind_m_s) <= _MAX_WIND_M_S  # it may be no number
        self.link.wind_m_s = wind_m_s if is_known else None

    def _on_command_ack(self, message: Message, t_ns: int, notify: Notify) -> None:
        refused = self.stream_requests.acknowledged(message, t_ns)
        if refused:
            notify(NoticeCode.MESSAGE_REFUSED, messages=refused)
