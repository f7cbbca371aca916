"""A byte stream cut where frames end, so that what is handed on can be scanned from empty like a datagram.

TCP and serial ports deliver bytes, not frames: a read may end anywhere. Whole frames, and the noise between
them, are handed on as they came (so that noise is counted as it is in datagrams); an unfinished frame waits
for the next read. It waits in 279 bytes at most. Nothing here raises on any input, and false starts in one
read are bounded, as they are in `gcs.mavlink.frames.codec.scan`.
"""

from __future__ import annotations

import re
from typing import Final

from gcs.mavlink.frames.codec import checked_frame

_MARKER: Final = re.compile(b"[\xfd\xfe]")
_V2: Final = 0xFD
_SIGNED: Final = 0x01
_MAX_FALSE_STARTS: Final = 64


class FrameStream:
    """One stream; a new connection needs a new one."""

    def __init__(self) -> None:
        self._waiting = b""

    def take(self, data: bytes) -> bytes:
        """Take what was read; return what is ready: it ends where a frame does, or with noise."""
        data = self._waiting + data
        ready = _ready(data)
        self._waiting = data[ready:]
        return data[:ready]


def _ready(data: bytes) -> int:
    """Number of bytes before the unfinished frame at the end."""
    at, end, false_starts = 0, len(data), 0
    while marker := _MARKER.search(data, at):
        at = marker.start()
        length = _claimed_length(data, at, end)
        if at + length > end:
            return at
        if length and checked_frame(data, at, length) is not None:
            at += length
            continue
        false_starts += 1
        if false_starts >= _MAX_FALSE_STARTS:
            return end
        at += 1
    return end


def _claimed_length(data: bytes, at: int, end: int) -> int:
    """Length that the frame at `at` says it has: 0 when it is none, past the end while that is not known."""
    if data[at] == _V2:
        if at + 3 > end:
            return end - at + 1
        if data[at + 2] & ~_SIGNED:
            return 0
        return 12 + data[at + 1] + (13 if data[at + 2] & _SIGNED else 0)
    return 8 + data[at + 1] if at + 2 <= end else end - at + 1
