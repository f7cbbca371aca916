"""Timestamps of a log made one time line: stamps that go back or far ahead are corrected."""

from __future__ import annotations

from typing import Final

_MAX_BACK_NS: Final = 60 * 1_000_000_000
_MAX_AHEAD_NS: Final = 24 * 3600 * 1_000_000_000


class LogClock:
    """Makes one time line of a log's stamps, although the clock may have been set meanwhile.

    A step back by more than `_MAX_BACK_NS`, or ahead by more than `_MAX_AHEAD_NS`, is a clock step: the line
    continues without it. Smaller steps back are datagrams out of order, and are kept.

    Attributes
    ----------
    jumps : int
        Number of clock steps so far.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self._last_ns: int | None = None
        self._offset_ns = 0

    def time_of(self, stamp_ns: int) -> int:
        """Return the time of the log's next stamp on the line, in nanoseconds."""
        t_ns = stamp_ns + self._offset_ns
        if self._last_ns is not None and not -_MAX_BACK_NS <= t_ns - self._last_ns <= _MAX_AHEAD_NS:
            self.jumps += 1
            self._offset_ns += self._last_ns - t_ns
            t_ns = self._last_ns
        self._last_ns = t_ns if self._last_ns is None else max(t_ns, self._last_ns)
        return t_ns
