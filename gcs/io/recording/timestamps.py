"""Times of log frames: from the log's stamps, or from the vehicles' boot clocks in a raw stream.

A raw stream has no stamps. Vehicles report the time since boot (``time_boot_ms`` of ATTITUDE,
GLOBAL_POSITION_INT and others: https://mavlink.io/en/messages/common.html) several times a second. All
vehicles share one time line, which begins with the first such message. A vehicle that appears later, or that
rebooted, joins at the current time of the line. Time does not advance between two such messages, so the line
has an error of a fraction of a second. Periods without any message are lost.
"""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.io.recording.tlog import LogFrame
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Frame

TimeSource: TypeAlias = Literal["stamps", "boot clocks"]

START_NS: Final = 1_000_000_000_000
"""Start of the time line of a raw stream; 0 would mean no time."""
_MS_NS: Final = 1_000_000
_MAX_BACK_MS: Final = 2_000
_MAX_AHEAD_MS: Final = 24 * 3600 * 1000
_BOOT_TIME_MESSAGE_IDS: Final = frozenset(
    {
        dialect.MAVLINK_MSG_ID_ATTITUDE,
        dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        dialect.MAVLINK_MSG_ID_RC_CHANNELS,
        dialect.MAVLINK_MSG_ID_SCALED_PRESSURE,
    }
)
"""Messages of autopilots whose payload begins with ``time_boot_ms`` (uint32)."""


class FrameTimes:
    """Computes the time of each frame of a log, in nanoseconds.

    Parameters
    ----------
    stamped : bool
        True if the log has stamps. Otherwise times begin at `START_NS`.
    """

    def __init__(self, *, stamped: bool) -> None:
        self._stamps = _StampClock() if stamped else None
        self._boot = _BootClocks()

    @property
    def timed_by(self) -> TimeSource | None:
        """Source of the times; None before the first one."""
        if self._stamps is not None:
            return "stamps"
        return "boot clocks" if self._boot.has_time else None

    @property
    def jumps(self) -> int:
        """Number of clock steps and reboots so far."""
        return self._boot.jumps if self._stamps is None else self._stamps.jumps

    def __call__(self, part: LogFrame) -> int:
        """Return the time of the next frame of the log."""
        if self._stamps is not None:
            return self._stamps(part.t_ns)
        return self._boot(part.frame) if part.validity == "good" else self._boot.t_ns


class _StampClock:
    """Makes one time line of a log's stamps, although the clock may have been set meanwhile.

    A step back by more than `_MAX_BACK_NS`, or ahead by more than `_MAX_AHEAD_NS`, is a clock step: the line
    continues without it. Smaller steps back are datagrams out of order, and are kept.
    """

    _MAX_BACK_NS = 60 * 1_000_000_000
    _MAX_AHEAD_NS = 24 * 3600 * 1_000_000_000

    def __init__(self) -> None:
        self.jumps = 0
        self._last_ns: int | None = None
        self._offset_ns = 0

    def __call__(self, stamp_ns: int) -> int:
        """Return the time of a stamp on the line."""
        t_ns = stamp_ns + self._offset_ns
        if self._last_ns is not None and not -self._MAX_BACK_NS <= t_ns - self._last_ns <= self._MAX_AHEAD_NS:
            self.jumps += 1
            self._offset_ns += self._last_ns - t_ns
            t_ns = self._last_ns
        self._last_ns = t_ns if self._last_ns is None else max(t_ns, self._last_ns)
        return t_ns


class _BootClocks:
    """Time line of the boot clocks of all vehicles."""

    def __init__(self) -> None:
        self.t_ns = START_NS
        self.jumps = 0
        self._last_ms: dict[int, int] = {}
        self._booted_ns: dict[int, int] = {}
        """Time on the line at which each system booted."""

    @property
    def has_time(self) -> bool:
        """True if a vehicle has reported its time."""
        return bool(self._last_ms)

    def __call__(self, frame: Frame) -> int:
        """Advance the line to the time of a frame; return its time."""
        if frame.message_id in _BOOT_TIME_MESSAGE_IDS and frame.component_id == AUTOPILOT_COMPONENT_ID:
            system_id = frame.system_id
            boot_ms = _boot_ms(frame)
            last_ms = self._last_ms.get(system_id)
            has_rebooted = last_ms is not None and not -_MAX_BACK_MS <= boot_ms - last_ms <= _MAX_AHEAD_MS
            if last_ms is None or has_rebooted:
                self.jumps += has_rebooted
                self._booted_ns[system_id] = self.t_ns - boot_ms * _MS_NS
            self._last_ms[system_id] = boot_ms
            self.t_ns = max(self.t_ns, self._booted_ns[system_id] + boot_ms * _MS_NS)
        return self.t_ns


def _boot_ms(frame: Frame) -> int:
    """Return the first field of a payload; MAVLink 2 omits trailing zeros."""
    data = frame.data
    head = 10 if data[0] == 0xFD else 6
    return int.from_bytes(data[head : head + min(4, data[1])], "little")
