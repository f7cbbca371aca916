"""MAVLink frames to messages and back, one datagram at a time.

Frame layout (https://mavlink.io/en/guide/serialization.html)::

    MAVLink 2: FD len incompat compat seq sys comp id(3) payload(len) crc(2) [signature(13)]
    MAVLink 1: FE len                 seq sys comp id(1) payload(len) crc(2)

The checksum is CRC-16/MCRF4XX over everything after the first byte, plus one byte that depends on the
message's definition: so a frame of an unknown id can be skipped, never checked.

Every datagram is scanned from empty: what one sender truncated can never swallow the next sender's frame. A
false start costs one byte, not the length it claims, so good frames behind a damaged one are found. Bytes
that look like a frame of an unknown id are noise when a good frame starts within them. The number of false
starts per datagram is bounded, so that hostile bytes cannot buy much time. Nothing here raises on any input.
Signatures are accepted unread.

The scan and the checksum are ours (a checksum must not depend on an environment variable, as it does in
pymavlink); fields are unpacked by the dialect that pymavlink generates.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from operator import itemgetter
from typing import Any, Final, NamedTuple, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

Message: TypeAlias = Any
"""A message object of the dialect, such as ``dialect.MAVLink_heartbeat_message``."""

GCS_SYSTEM_ID = 255
GCS_COMPONENT_ID: int = dialect.MAV_COMP_ID_PATHPLANNER
"""Not the 190 of QGroundControl and Mission Planner: on one network an answer to them is none to us."""
AUTOPILOT_COMPONENT_ID = 1

_MAGIC_V1, _MAGIC_V2 = 0xFE, 0xFD
_HEADER_V1, _HEADER_V2 = 6, 10
_CRC = 2
_SIGNATURE = 13
_SIGNED = 0x01
_MAX_FALSE_STARTS = 64
_MARKER = re.compile(b"[\xfd\xfe]")
_FIELD_CODE = re.compile(r"\d*[a-zA-Z]")


def _plain_definitions() -> dict[int, tuple[Any, Callable[[bytes], Any], int, Callable[[Any], Any]]]:
    """Class, unpacker, payload size and order of the fields of each message that holds numbers alone."""
    return {
        message_id: (
            definition,
            definition.unpacker.unpack,
            definition.unpacker.size,
            itemgetter(*definition.orders) if len(definition.orders) > 1 else tuple,
        )
        for message_id, definition in dialect.mavlink_map.items()
        if sum(definition.lengths) == len(definition.lengths) and "s" not in definition.unpacker.format
    }


_PLAIN = _plain_definitions()


class Frame(NamedTuple):
    """One frame whose checksum holds."""

    system_id: int
    component_id: int
    sequence: int
    message_id: int
    signed: bool
    data: bytes

    def message(self) -> Message | None:
        """Unpack the fields; None when they do not fit the message's definition.

        As pymavlink's ``decode`` does it, without a second look at the checksum. Messages with arrays or
        texts, which are rare, are left to it.
        """
        plain = _PLAIN.get(self.message_id)
        if plain is None:
            return self._decoded()
        definition, unpack, size, in_order = plain
        data, begin = self.data, _HEADER_V2 if self.data[0] == _MAGIC_V2 else _HEADER_V1
        payload = data[begin : begin + min(data[1], size)]
        message = definition(*in_order(unpack(payload.ljust(size, b"\0"))))
        flags = data[2:4] if begin == _HEADER_V2 else b"\0\0"
        message._header = dialect.MAVLink_header(
            self.message_id, flags[0], flags[1], data[1], self.sequence, self.system_id, self.component_id
        )
        crc_at = begin + data[1]
        message._crc = data[crc_at] | data[crc_at + 1] << 8
        message._msgbuf, message._payload = data, data[begin:crc_at]
        return message

    def _decoded(self) -> Message | None:
        try:
            return dialect.MAVLink(None).decode(bytearray(self.data))
        except (dialect.MAVError, ValueError, TypeError, IndexError):
            return None


class ScanResult(NamedTuple):
    """What one datagram held."""

    frames: list[Frame]
    bad_bytes: int
    """Bytes that belong to no frame."""
    crc_errors: int
    """Whole frames of a known id whose checksum does not hold."""
    unchecked: list[Frame]
    """Well-placed frames of an id that the dialect does not have: to be sent on, not to be read."""

    @property
    def unknown(self) -> int:
        """Number of frames of unknown ids."""
        return len(self.unchecked)


class SimpleFrames:
    """The frames of one datagram at a time, by `scan`: the plain form of `fast_scan.Frames`."""

    def __init__(self) -> None:
        self.take(b"")

    def take(self, data: bytes) -> None:
        """Frame a datagram, from empty."""
        self._frames, self.bad_bytes, self.crc_errors, unchecked = scan(data)
        self.found = self.checked = len(self._frames)
        self.unknown = len(unchecked)

    def is_checked(self, row: int) -> bool:  # noqa: ARG002  others have no row here
        """Whether the frame's checksum is known to hold."""
        return True

    def frame(self, row: int) -> Frame:
        """Return the frame of a row; the first is 1."""
        return self._frames[row - 1]


def scan(data: bytes) -> ScanResult:
    """Find the frames of a datagram, from empty."""
    frames: list[Frame] = []
    unchecked: list[Frame] = []
    bad_bytes = crc_errors = false_starts = 0
    tries = _MAX_FALSE_STARTS
    at, end = 0, len(data)
    while at < end:
        length = _frame_length(data, at, end)
        if length:
            frame = checked_frame(data, at, length)
            if frame is not None:
                frames.append(frame)
                at += length
                continue
            if _message_id(data, at) not in dialect.mavlink_map:
                if at + length == end or data[at + length] in (_MAGIC_V1, _MAGIC_V2):
                    covers_good, tries = _covers_good_frame(data, at, length, tries)
                    if not covers_good:
                        unchecked.append(_frame(data, at, length))
                        at += length
                        continue
            else:
                crc_errors += 1
            false_starts += 1
            if false_starts >= _MAX_FALSE_STARTS:
                bad_bytes += end - at
                break
        marker = _MARKER.search(data, at + 1)
        next_at = marker.start() if marker else end
        bad_bytes += next_at - at
        at = next_at
    return ScanResult(frames, bad_bytes, crc_errors, unchecked)


def _covers_good_frame(data: bytes, at: int, length: int, tries: int) -> tuple[bool, int]:
    """Return True if a good frame starts within the one claimed at `at`, and how many tries are left.

    A try is a checksum worked out; without any left, the claim is accepted.
    """
    end, stop = len(data), at + length
    while tries and (marker := _MARKER.search(data, at + 1, stop)):
        at = marker.start()
        inner = _frame_length(data, at, end)
        if inner and _message_id(data, at) in dialect.mavlink_map:
            tries -= 1
            if checked_frame(data, at, inner) is not None:
                return True, tries
    return False, tries


def decode(data: bytes) -> tuple[list[Message], ScanResult]:
    """Messages of a datagram, and what the scan found; for callers that want every message."""
    found = scan(data)
    return [message for frame in found.frames if (message := frame.message()) is not None], found


class Encoder:
    """Messages to MAVLink 2 frames from one sender to one peer; the sequence counter is the peer's own.

    One counter per peer, so that a vehicle which counts gaps sees its own loss and not other vehicles'
    traffic.
    """

    def __init__(self, system_id: int = GCS_SYSTEM_ID, component_id: int = GCS_COMPONENT_ID) -> None:
        self._packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=component_id)

    def __call__(self, message: Message) -> bytes:
        """Pack one message and count it."""
        frame: bytes = message.pack(self._packer)
        self._packer.seq = (self._packer.seq + 1) % 256
        return frame


def _frame_length(data: bytes, at: int, end: int) -> int:
    """Length of the frame that may start at `at`, 0 when none can."""
    magic = data[at]
    if magic == _MAGIC_V2 and at + _HEADER_V2 + _CRC <= end:
        flags = data[at + 2]
        if flags & ~_SIGNED:
            return 0
        length = _HEADER_V2 + data[at + 1] + _CRC + (_SIGNATURE if flags & _SIGNED else 0)
    elif magic == _MAGIC_V1 and at + _HEADER_V1 + _CRC <= end:
        length = _HEADER_V1 + data[at + 1] + _CRC
    else:
        return 0
    return length if at + length <= end else 0


def _message_id(data: bytes, at: int) -> int:
    if data[at] == _MAGIC_V1:
        return data[at + 5]
    return data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16


def checked_frame(data: bytes, at: int, length: int) -> Frame | None:
    """Return the frame that fills `length` bytes from `at`, when its id is known and its checksum holds."""
    definition = dialect.mavlink_map.get(_message_id(data, at))
    if definition is None:
        return None
    crc_at = at + length - _CRC - (_SIGNATURE if _is_signed(data, at) else 0)
    crc = dialect.x25crc(data[at + 1 : crc_at] + bytes((definition.crc_extra,))).crc
    if crc != data[crc_at] | data[crc_at + 1] << 8:
        return None
    return _frame(data, at, length)


def _is_signed(data: bytes, at: int) -> bool:
    return data[at] == _MAGIC_V2 and bool(data[at + 2] & _SIGNED)


def _frame(data: bytes, at: int, length: int) -> Frame:
    sender = at + (5 if data[at] == _MAGIC_V2 else 3)
    return Frame(
        data[sender],
        data[sender + 1],
        data[sender - 1],
        _message_id(data, at),
        _is_signed(data, at),
        data[at : at + length],
    )


def _target_offsets() -> dict[int, tuple[int, int | None]]:
    """Offset of target system and target component in the payload of each message that has them."""
    found: dict[int, tuple[int, int | None]] = {}
    for message_id, definition in dialect.mavlink_map.items():
        at, where = 0, {}
        fields = _FIELD_CODE.findall(definition.unpacker.format.lstrip("<"))
        for name, code in zip(definition.ordered_fieldnames, fields, strict=True):
            where[name] = at
            at += struct.calcsize("<" + code)
        system = where.get("target_system", where.get("target"))
        if system is not None:
            found[message_id] = (system, where.get("target_component"))
    return found


_TARGET_OFFSETS: Final = _target_offsets()


def target_of(frame: Frame) -> tuple[int, int] | None:
    """Return the (system, component) that a frame is for, 0 meaning all; None for one that names nobody."""
    offsets = _TARGET_OFFSETS.get(frame.message_id)
    if offsets is None:
        return None
    system, component = offsets
    return payload_byte(frame, system), 0 if component is None else payload_byte(frame, component)


def payload_byte(frame: Frame, offset: int) -> int:
    """One byte of a frame's payload, 0 where it was left out."""
    data = frame.data
    begin = _HEADER_V2 if data[0] == _MAGIC_V2 else _HEADER_V1
    return data[begin + offset] if offset < data[1] else 0
