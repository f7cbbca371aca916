"""Telemetry of one vehicle, made from its onboard log.

Onboard logs have some hundred records a second. Positions are kept at `POSITION_S`, other states at `STATE_S`
and whenever a mode, an arming or a text changes. The messages are those of the guide
(https://mavlink.io/en/messages/common.html) that ground stations record.
"""

from __future__ import annotations

import contextlib
import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.errors import RecordingError
from gcs.io.recording.tlog import tlog_entries
from gcs.mavlink.frames.codec import Encoder, Message
from gcs.model import NS_PER_S

POSITION_S: Final = 0.2
STATE_S: Final = 1.0
_TEXT_BYTES: Final = 50
_UNKNOWN: Final = 65_535
_MAX_T_NS: Final = 4_102_444_800 * NS_PER_S
"""The year 2100; later times are damaged."""
_MAX_CM_S: Final = 32_767


@dataclass(slots=True)
class OnboardTelemetry:
    """Messages of one vehicle in any order, with their times since the boot of the autopilot."""

    system_id: int
    autopilot: int
    """MAV_AUTOPILOT."""
    vehicle_type: int = dialect.MAV_TYPE_FIXED_WING
    shift_ns: int = 0
    """From the times given, of the autopilot's clock, to UTC; 0 if it is not known."""
    _messages: list[tuple[int, Message]] = field(default_factory=list)
    _last_t_ns: dict[str, int] = field(default_factory=dict)
    _state: tuple[int, bool] | None = None
    """Mode and arming of the last heartbeat."""
    _home: tuple[float, float, int] | None = None
    """Last home position, rounded."""

    def add_position(
        self,
        t_ns: int,
        place_deg: tuple[float, float],
        alt_msl_m: float,
        height_m: float,
        velocity_m_s: Sequence[float],
    ) -> None:
        """Add a position, its height above home, and its velocity north, east and down."""
        if not self._is_due("position", t_ns, POSITION_S):
            return
        north, east, down = (_centimetres(one) for one in velocity_m_s)
        course_cdeg = round(math.degrees(math.atan2(east, north)) % 360.0 * 100.0) % 36_000
        self._add(
            t_ns,
            dialect.MAVLink_global_position_int_message(
                self._boot_ms(t_ns),
                round(place_deg[0] * 1e7),
                round(place_deg[1] * 1e7),
                round(alt_msl_m * 1e3),
                round(height_m * 1e3),
                north,
                east,
                down,
                course_cdeg if north or east else _UNKNOWN,
            ),
        )

    def add_state(self, t_ns: int, custom_mode: int, *, armed: bool) -> None:
        """Add a heartbeat, if it is due or says something new."""
        if not self._is_due("state", t_ns, STATE_S) and self._state == (custom_mode, armed):
            return
        self._state = custom_mode, armed
        base = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        status = dialect.MAV_STATE_ACTIVE if armed else dialect.MAV_STATE_STANDBY
        self._add(
            t_ns,
            dialect.MAVLink_heartbeat_message(
                self.vehicle_type, self.autopilot, base, custom_mode, status, 3
            ),
        )

    def add_home(self, t_ns: int, place_deg: tuple[float, float], alt_msl_m: float) -> None:
        """Add a home position, if it is more than a metre from the last one."""
        rounded = round(place_deg[0], 5), round(place_deg[1], 5), round(alt_msl_m)
        if rounded == self._home:
            return
        self._home = rounded
        lat, lon = (round(one * 1e7) for one in place_deg)
        zeros = 0.0, 0.0, 0.0
        message = dialect.MAVLink_home_position_message(
            lat, lon, round(alt_msl_m * 1e3), *zeros, [1.0, 0.0, 0.0, 0.0], *zeros
        )
        self._add(t_ns, message)

    def add_item(self, t_ns: int, seq: int) -> None:
        """Add the mission item that the vehicle flies to."""
        self._add(t_ns, dialect.MAVLink_mission_current_message(seq))

    def add_battery(self, t_ns: int, volt: float, ampere: float, percent: float) -> None:
        """Add the state of the battery; NaN where it is not known."""
        if not self._is_due("battery", t_ns, STATE_S):
            return
        self._add(
            t_ns,
            dialect.MAVLink_sys_status_message(
                0,
                0,
                0,
                0,
                _whole(volt * 1e3, 0, _UNKNOWN, _UNKNOWN),
                _whole(ampere * 1e2, -1, _MAX_CM_S, -1),
                _whole(percent, -1, 100, -1),
                *(0,) * 6,
            ),
        )

    def add_text(self, t_ns: int, text: str, severity: int = dialect.MAV_SEVERITY_INFO) -> None:
        """Add a text of the autopilot; a long one is cut."""
        data = text.encode("ascii", "replace")[:_TEXT_BYTES]
        self._add(t_ns, dialect.MAVLink_statustext_message(min(max(severity, 0), 7), data))

    def entries(self, source: str = "") -> Iterator[bytes]:
        """Yield the entries of a ``.tlog``, in the order of time.

        Raises
        ------
        RecordingError
            If there is no position. `source` is the name of the log in the message.
        """
        if "position" not in self._last_t_ns:
            raise RecordingError(source, "has no positions: the autopilot had no estimate, or logged none")
        encode = Encoder(self.system_id, 1)
        for t_ns, message in sorted(self._messages, key=itemgetter(0)):
            with contextlib.suppress(struct.error):  # a damaged value
                yield tlog_entries(t_ns + self.shift_ns, encode(message))

    def _add(self, t_ns: int, message: Message) -> None:
        if 0 <= t_ns < _MAX_T_NS:
            self._messages.append((t_ns, message))

    def _is_due(self, kind: str, t_ns: int, period_s: float) -> bool:
        last = self._last_t_ns.get(kind)
        if last is not None and 0 <= t_ns - last < round(period_s * NS_PER_S):
            return False
        self._last_t_ns[kind] = t_ns
        return True

    @staticmethod
    def _boot_ms(t_ns: int) -> int:
        return max(t_ns, 0) // 1_000_000 % (1 << 32)


def _centimetres(metres: float) -> int:
    return _whole(metres * 100.0, -_MAX_CM_S, _MAX_CM_S, 0)


def _whole(value: float, least: int, most: int, unknown: int) -> int:
    return min(max(round(value), least), most) if math.isfinite(value) else unknown
