"""MAVLink frames of a vehicle, read from datagrams and written to datagrams, and their signatures.

A frame starts with 0xFD (MAVLink 2) or 0xFE (MAVLink 1) and the payload's length
(https://mavlink.io/en/guide/serialization.html). A frame never continues in the next datagram. Bytes outside
valid frames are skipped one at a time.

Signing uses pymavlink's own code, as an independent peer of central command. As on an ArduPilot telemetry
port, a vehicle with a key signs everything, and rejects unsigned frames except RADIO_STATUS. SETUP_SIGNING
with a key of zeros ends signing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

MAX_DATAGRAM_BYTES = 1400
_SIGNED = 0x01
_EPOCH_S = 1_420_070_400
_NS_PER_TICK = 10_000
_UNSIGNED_IDS = (mavlink.MAVLINK_MSG_ID_RADIO_STATUS, mavlink.MAVLINK_MSG_ID_RADIO)


class Signing:
    """Signing state that the vehicle's reader and outbox share."""

    def __init__(self, key: bytes | None = None) -> None:
        self.state: Any = mavlink.MAVLink(None).signing
        self.state.allow_unsigned_callback = lambda _mav, message_id: message_id in _UNSIGNED_IDS
        if key is not None:
            self.set_up(key, 0)

    def set_up(self, key: bytes, timestamp: int) -> None:
        """Sign and check with a key from now on; end signing if it is all zeros."""
        state = self.state
        state.secret_key = key if any(key) else None
        state.sign_outgoing = any(key)
        state.timestamp = max(state.timestamp, timestamp)
        state.stream_timestamps.clear()

    def advance_time(self, t_ns: int) -> None:
        """Advance the signing time; received timestamps advance it too."""
        now = t_ns // _NS_PER_TICK - _EPOCH_S * 100_000
        self.state.timestamp = max(self.state.timestamp, now)


class FrameReader:
    """Decodes datagrams one by one, and counts the invalid bytes.

    If the `signing` state has a key, frames without a valid signature are invalid.
    """

    def __init__(self, signing: Any = None) -> None:
        self._codec = mavlink.MAVLink(None)
        self._codec.signing = signing or self._codec.signing
        self.bad_bytes = 0

    def messages(self, data: bytes) -> Iterator[Any]:
        """Yield every message with a valid checksum and a known id."""
        at = 0
        end = len(data)
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
    """Return the length of the frame that starts here by its header; 0 for none."""
    magic = data[at]
    if magic == 0xFD and len(data) - at >= 12:
        return data[at + 1] + 12 + (13 if data[at + 2] & _SIGNED else 0)
    if magic == 0xFE and len(data) - at >= 8:
        return data[at + 1] + 8
    return 0


class Outbox:
    """Queue of frames of one system id and component 1, numbered in order."""

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
        """Return one frame with the next sequence number."""
        frame: bytes = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) & 0xFF
        return frame

    def pop_datagrams(self) -> list[bytes]:
        """Return everything queued, as datagrams of at most 1400 bytes."""
        datagrams = [bytes(d) for d in self._datagrams]
        self._datagrams = []
        return datagrams
