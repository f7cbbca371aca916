"""Bytes that form no MAVLink frame: counted, and passed on as a sample only.

A radio without a vehicle, a wrong baud rate or an attacker can send megabytes a second of them. What central
command takes is recorded, so what it does not need is left out before: frames always pass, other bytes only
within a budget, which is enough to see what they are.
"""

from __future__ import annotations

from collections import Counter
from typing import Final

from gcs.mavlink.frames.fast_scan import LENGTH, OFFSET, Frames
from gcs.model import NS_PER_S

_BYTES_PER_S: Final = 2_000
_MAX_SAVED_BYTES: Final = 65_536
"""What a quiet minute saves up: a whole datagram."""
_OVERHEAD_BYTES: Final = 100
"""Of a datagram in a recording."""
_TELL_EVERY_NS: Final = 60 * NS_PER_S


class GarbageFilter:
    """Leaves out what forms no frame, beyond a sample of 2 kB a second over all links."""

    def __init__(self) -> None:
        self._frames = Frames()
        self._budget, self._t_ns = float(_MAX_SAVED_BYTES), 0
        self._left_out: Counter[str] = Counter()
        """Bytes by link, not told yet."""
        self._told_ns: int | None = None

    def take(self, t_ns: int, link: str, data: bytes) -> bytes:
        """Return what is taken of a datagram: all of it, or its frames, or nothing."""
        frames = self._frames
        frames.take(data)
        if not frames.bad_bytes:
            return data
        self._budget += max(0, t_ns - self._t_ns) / NS_PER_S * _BYTES_PER_S
        self._budget, self._t_ns = min(self._budget, _MAX_SAVED_BYTES), t_ns
        price = frames.bad_bytes + _OVERHEAD_BYTES
        if price <= self._budget:
            self._budget -= price
            return data
        self._left_out[link] += frames.bad_bytes
        rows = frames.table[1 : frames.found + 1, [OFFSET, LENGTH]].tolist()
        return b"".join(data[offset : offset + length] for offset, length in rows)

    def news(self, t_ns: int) -> list[tuple[str, str]]:
        """Return for each link what was left out, a minute after the last time at the earliest."""
        if not self._left_out or (self._told_ns is not None and t_ns - self._told_ns < _TELL_EVERY_NS):
            return []
        self._told_ns, left_out = t_ns, self._left_out
        self._left_out = Counter()
        return [
            (link, f"{count} bytes that form no MAVLink frame were dropped; a sample of them is recorded")
            for link, count in left_out.items()
        ]
