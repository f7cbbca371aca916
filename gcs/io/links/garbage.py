"""Garbage on links: bytes that form no MAVLink frame are counted, and recorded as a sample only.

A radio without a vehicle, a wrong baud rate or an attacker can send megabytes of them a second. Frames always
pass.
"""

from __future__ import annotations

from collections import Counter
from typing import Final

from gcs.mavlink.frames.codec import FrameTable
from gcs.mavlink.frames.fast_scan import Scanner
from gcs.model import NS_PER_S

_BYTES_PER_S: Final = 2_000
_MAX_SAVED_BYTES: Final = 65_536
"""Budget saved in a quiet minute: a whole datagram."""
_OVERHEAD_BYTES: Final = 100
"""Per datagram in a recording."""
_MIN_NOTICE_INTERVAL_NS: Final = 60 * NS_PER_S


class GarbageFilter:
    """Drops bytes that form no frame, beyond 2 kB a second over all links."""

    def __init__(self) -> None:
        self._scan = Scanner()
        self._budget = float(_MAX_SAVED_BYTES)
        self._t_ns = 0
        self._left_out: Counter[str] = Counter()
        """Bytes by link, not reported yet."""
        self._reported_ns: int | None = None

    def filter_datagram(self, t_ns: int, link: str, frames: FrameTable) -> FrameTable:
        """Return the accepted part of a datagram: all, its frames, or nothing."""
        if not frames.bad_bytes:
            return frames
        self._budget += max(0, t_ns - self._t_ns) / NS_PER_S * _BYTES_PER_S
        self._budget = min(self._budget, _MAX_SAVED_BYTES)
        self._t_ns = t_ns
        cost = frames.bad_bytes + _OVERHEAD_BYTES
        if cost <= self._budget:
            self._budget -= cost
            return frames
        self._left_out[link] += frames.bad_bytes
        return self._scan(b"".join(frame.data for frame in frames))

    def take_dropped(self, t_ns: int) -> dict[str, int]:
        """Return the number of dropped bytes by link, once a minute at most."""
        if not self._left_out or (
            self._reported_ns is not None and t_ns - self._reported_ns < _MIN_NOTICE_INTERVAL_NS
        ):
            return {}
        self._reported_ns = t_ns
        left_out = self._left_out
        self._left_out = Counter()
        return left_out
