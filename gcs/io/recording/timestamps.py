"""When frames of a log were heard: by the log's stamps, or by the vehicles' own clocks where it has none.

A raw stream says not when. But vehicles say in their telemetry how long ago they were booted
(``time_boot_ms`` of ATTITUDE, GLOBAL_POSITION_INT and others: https://mavlink.io/en/messages/common.html),
several times a second. So frames are put on one time line that begins with the first such word; a vehicle
that is heard later is placed where the line is then, and one that was booted anew goes on from there. Between
two words time stands still, so the line is good to a fraction of a second. How long everybody was off, it
cannot know.
"""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.io.recording.tlog import LogClock, Logged
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Frame

TimedBy: TypeAlias = Literal["stamps", "boot clocks"]

START_NS: Final = 1_000_000_000_000
"""Where a line of boot clocks begins. Not 0, which is a time in nobody's log."""
_MS_NS: Final = 1_000_000
_BACK_MS: Final = 2_000
_AHEAD_MS: Final = 24 * 3600 * 1000
_SAY_BOOT_TIME: Final = frozenset(
    {
        dialect.MAVLINK_MSG_ID_ATTITUDE,
        dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        dialect.MAVLINK_MSG_ID_RC_CHANNELS,
        dialect.MAVLINK_MSG_ID_SCALED_PRESSURE,
    }
)
"""Messages of autopilots whose payload begins with ``time_boot_ms``, an unsigned number of four bytes."""


class TimeLine:
    """Gives each frame of a log its time, in nanoseconds.

    Parameters
    ----------
    stamped : bool
        Whether the log has stamps. The times of one without are of the run alone, from `START_NS` on.
    """

    def __init__(self, *, stamped: bool) -> None:
        self._stamps = LogClock() if stamped else None
        self._boot = _BootClocks()

    @property
    def timed_by(self) -> TimedBy | None:
        """Where the times come from; None while nothing said any."""
        if self._stamps is not None:
            return "stamps"
        return "boot clocks" if self._boot.heard else None

    @property
    def jumps(self) -> int:
        """How often the log's clock was set while it was written, or a vehicle was booted anew."""
        return self._boot.jumps if self._stamps is None else self._stamps.jumps

    def __call__(self, part: Logged) -> int:
        """Return the time of the next frame of the log."""
        if self._stamps is not None:
            return self._stamps(part.t_ns)
        return self._boot(part.frame) if part.standing == "good" else self._boot.t_ns


class _BootClocks:
    def __init__(self) -> None:
        self.t_ns = START_NS
        self.jumps = 0
        self._last_ms: dict[int, int] = {}
        self._booted_ns: dict[int, int] = {}
        """Time on the line at which each system was booted."""

    @property
    def heard(self) -> bool:
        """Whether any vehicle said its time."""
        return bool(self._last_ms)

    def __call__(self, frame: Frame) -> int:
        """Move the line on to what a frame says; never back."""
        if frame.message_id in _SAY_BOOT_TIME and frame.component_id == AUTOPILOT_COMPONENT_ID:
            system_id, boot_ms = frame.system_id, _boot_ms(frame)
            last_ms = self._last_ms.get(system_id)
            anew = last_ms is not None and not -_BACK_MS <= boot_ms - last_ms <= _AHEAD_MS
            if last_ms is None or anew:
                self.jumps += anew
                self._booted_ns[system_id] = self.t_ns - boot_ms * _MS_NS
            self._last_ms[system_id] = boot_ms
            self.t_ns = max(self.t_ns, self._booted_ns[system_id] + boot_ms * _MS_NS)
        return self.t_ns


def _boot_ms(frame: Frame) -> int:
    """First field of a payload, whose trailing zeros MAVLink 2 leaves out."""
    data = frame.data
    head = 10 if data[0] == 0xFD else 6
    return int.from_bytes(data[head : head + min(4, data[1])], "little")
