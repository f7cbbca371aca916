"""Run clock: monotonic time that starts at the Unix time; steps of the wall clock. Time is read only here.

The wall clock is read once, at the start. Steps by an operator, NTP or GPS do not affect heartbeats and
timeouts. `ClockWatch` detects such a step, or a suspended machine; it becomes a `ClockStep` event.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Final

from gcs.model import NS_PER_S

_STEADY: Final = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
STEP_NS = NS_PER_S // 5
"""A wall clock that moved this far against the monotonic one has been set; smaller moves are NTP's
slewing."""


def steady_ns() -> int:
    """Return the time of a clock that is never set, and on Linux counts the time of a suspended machine."""
    return time.clock_gettime_ns(_STEADY)


def unix_ns() -> int:
    """Return the Unix time, for data kept between runs."""
    return time.time_ns()


def unix_offset_ns() -> int:
    """Return the Unix time less the monotonic time, now."""
    return time.time_ns() - time.monotonic_ns()


@dataclass(frozen=True, slots=True)
class RunClock:
    """Run time as a line through (Unix time, run time). At speed 1 and without offset it begins as Unix time.

    All processes of a simulated run share the line.
    """

    epoch_ns: int = 0
    """A Unix time in nanoseconds."""
    start_t_ns: int = 0
    """The run time at that Unix time."""
    speed: float = 1.0
    _offset_ns: int = field(default_factory=unix_offset_ns)
    """Unix time less monotonic time when the clock was made."""

    def now_ns(self) -> int:
        """Return the run time now."""
        passed_ns = time.monotonic_ns() + self._offset_ns - self.epoch_ns
        if self.speed == 1.0:
            return self.start_t_ns + passed_ns
        return self.start_t_ns + int(passed_ns * self.speed)

    def not_before(self, t_ns: int) -> RunClock:
        """Return a clock that shows `t_ns` now, if this one is behind it."""
        return replace(self, start_t_ns=self.start_t_ns + max(0, t_ns - self.now_ns()))

    def wall_s_until(self, t_ns: int) -> float:
        """Return the seconds to wait for run time `t_ns`; negative when it has passed."""
        return (t_ns - self.now_ns()) / self.speed / NS_PER_S


class ClockWatch:
    """Detects steps of the wall clock, and suspension of the machine."""

    def __init__(self) -> None:
        self._offset_ns = unix_offset_ns()

    def step_ns(self) -> int:
        """Return the step of the wall clock since the last call; 0 for none."""
        offset_ns = unix_offset_ns()
        step_ns = offset_ns - self._offset_ns
        if abs(step_ns) < STEP_NS:
            return 0
        self._offset_ns = offset_ns
        return step_ns
