"""Frames out of a byte stream (TCP, serial port): complete frames are passed on like a datagram.

Noise between frames is passed on too, so that it is counted as in datagrams. An incomplete frame, 279 bytes
at most, waits for the next read. Nothing raises on any input, and false starts per read are bounded.
"""

from __future__ import annotations

from gcs.mavlink.frames.codec import MAGIC_V2, MAX_FALSE_STARTS, SIGNED_FLAG, START_BYTE, checked_frame


class FrameStream:
    """One stream; a new connection needs a new one."""

    def __init__(self) -> None:
        self._pending = b""

    def add_bytes(self, data: bytes) -> bytes:
        """Add bytes that were read; return those that are complete: they end with a frame or with noise."""
        data = self._pending + data
        ready = _complete_length(data)
        self._pending = data[ready:]
        return data[:ready]


def _complete_length(data: bytes) -> int:
    """Return the number of bytes before the incomplete frame at the end."""
    at = 0
    end = len(data)
    false_starts = 0
    while marker := START_BYTE.search(data, at):
        at = marker.start()
        length = _claimed_length(data, at, end)
        if at + length > end:
            return at
        if length and checked_frame(data, at, length) is not None:
            at += length
            continue
        false_starts += 1
        if false_starts >= MAX_FALSE_STARTS:
            return end
        at += 1
    return end


def _claimed_length(data: bytes, at: int, end: int) -> int:
    """Return the length that the header at `at` claims: 0 if invalid, beyond the end if unknown yet."""
    if data[at] == MAGIC_V2:
        if at + 3 > end:
            return end - at + 1
        if data[at + 2] & ~SIGNED_FLAG:
            return 0
        return 12 + data[at + 1] + (13 if data[at + 2] & SIGNED_FLAG else 0)
    return 8 + data[at + 1] if at + 2 <= end else end - at + 1
