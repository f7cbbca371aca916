"""MAVLink frames of a vehicle: out of a datagram, and into datagrams.

A frame starts with 0xFD (MAVLink 2) or 0xFE (MAVLink 1), then comes the payload's length
(https://mavlink.io/en/guide/serialization.html). Each datagram is read from empty: what it breaks off in is
never joined with the next, and bytes that make no valid frame are stepped over one at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

MAX_DATAGRAM_BYTES = 1400
_SIGNED = 0x01


class FrameReader:
    """Decodes datagrams one by one, and counts the invalid bytes.

    If the `signing` state has a key, frames without a valid signature are invalid.
    """

    def __init__(self, signing: Any = None) -> None:
        self._codec = mavlink.MAVLink(None)
        self._codec.signing = signing or self._codec.signing
        self.bad_bytes = 0

    def messages(self, data: bytes) -> Iterator[Any]:
        """Yield every message whose checksum holds and whose id is known."""
        at, end = 0, len(data)
        while at < end:
            length = _frame_length(data, at)
            message = self._decode(data[at : at + length]) if 0 < length <= end - at else None
            if message is None:
                self.bad_bytes += 1
                at += 1
                continue
            at += length
            if message.get_msgId() >= 0:
                yield message

    def _decode(self, frame: bytes) -> Any | None:
        try:
            return self._codec.decode(bytearray(frame))
        except mavlink.MAVError:
            return None


def _frame_length(data: bytes, at: int) -> int:
    """Bytes of the frame that starts here by its own header; 0 when none does."""
    magic = data[at]
    if magic == 0xFD and len(data) - at >= 12:
        return data[at + 1] + 12 + (13 if data[at + 2] & _SIGNED else 0)
    if magic == 0xFE and len(data) - at >= 8:
        return data[at + 1] + 8
    return 0


class Outbox:
    """Frames that wait to be sent, of one system id and component 1, numbered in order."""

    def __init__(self, system_id: int, signing: Any = None) -> None:
        self._codec = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._codec.signing = signing or self._codec.signing
        self._datagrams: list[bytearray] = []

    def send(self, message: Any) -> None:
        """Queue one message."""
        frame = self.encode(message)
        datagrams = self._datagrams
        if datagrams and len(datagrams[-1]) + len(frame) <= MAX_DATAGRAM_BYTES:
            datagrams[-1] += frame
        else:
            datagrams.append(bytearray(frame))

    def encode(self, message: Any) -> bytes:
        """One frame, with the next sequence number."""
        frame: bytes = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) & 0xFF
        return frame

    def pop_datagrams(self) -> list[bytes]:
        """Everything queued, as datagrams of at most 1400 bytes."""
        if not self._datagrams:
            return []
        datagrams, self._datagrams = [bytes(d) for d in self._datagrams], []
        return datagrams
