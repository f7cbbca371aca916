"""MAVLink frames to messages and back, one datagram at a time, and our own system and component ids.

Frame layout (https://mavlink.io/en/guide/serialization.html), bytes:

=============  ==================  ==================  =============================================
field          MAVLink 2           MAVLink 1           meaning
=============  ==================  ==================  =============================================
magic          0     0xFD          0     0xFE          start of frame
len            1                   1                   payload length
incompat       2                   -                   incompatibility flags; 0x01: signed
compat         3                   -                   compatibility flags, ignored
seq            4                   2                   sequence number, to count lost frames
sysid          5                   3                   sender's system id
compid         6                   4                   sender's component id
msgid          7-9   (little e.)   5                   message id
payload        10 ...              6 ...               fields by size; v2: trailing zeros truncated
checksum       2 bytes             2 bytes             CRC-16/MCRF4XX, see below
signature      13 bytes, if signed  -                  `gcs.mavlink.frames.signing`
=============  ==================  ==================  =============================================

The checksum covers everything after the magic byte, plus the CRC_EXTRA byte of the message's definition. So a
frame with an unknown message id can be skipped, not checked.

Each datagram is scanned from empty: a truncated frame of one sender never affects the next sender's. A false
start costs one byte, not the length it claims. A frame with an unknown id counts as noise if a good frame
starts within it. False starts per datagram are bounded. Nothing raises on any input. Signatures are not
checked here.

Scan and checksum are our own, since pymavlink's checksum depends on an environment variable. pymavlink's
dialect unpacks the fields.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from operator import itemgetter
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.model import Int32Array

Message: TypeAlias = Any
"""Message object of the dialect, such as ``dialect.MAVLink_heartbeat_message``."""

GCS_SYSTEM_ID = 255
GCS_COMPONENT_ID: int = dialect.MAV_COMP_ID_PATHPLANNER
"""Not 190 as QGroundControl and Mission Planner: answers to them are then not for us."""
AUTOPILOT_COMPONENT_ID = 1
OWN_IDS = (GCS_SYSTEM_ID, GCS_COMPONENT_ID)
"""Our system and component id."""

OFFSET, LENGTH, MESSAGE_ID, SYSTEM, COMPONENT, SEQUENCE, SIGNED, CHECKED, WIDTH = range(9)
"""Columns of `FrameTable.rows`. CHECKED is 0 for a frame of an id that the dialect lacks."""

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
HEADER_BYTES_V1 = 6
HEADER_BYTES_V2 = 10
_CRC_BYTES = 2
_SIGNATURE_BYTES = 13
SIGNED_FLAG = 0x01
MAX_FALSE_STARTS = 64
SETUP_SIGNING: Final[int] = dialect.MAVLINK_MSG_ID_SETUP_SIGNING
"""Message that carries a key."""
START_BYTE = re.compile(b"[\xfd\xfe]")
_FIELD_CODE = re.compile(r"\d*[a-zA-Z]")


def _numeric_messages() -> dict[int, tuple[Any, Callable[[bytes], Any], int, Callable[[Any], Any]]]:
    """Return class, unpacker, payload size and field order of messages with numeric scalars only."""
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


_NUMERIC_MESSAGES = _numeric_messages()


class Frame(NamedTuple):
    """One frame with a valid checksum."""

    system_id: int
    component_id: int
    sequence: int
    message_id: int
    signed: bool
    data: bytes

    def message(self) -> Message | None:
        """Unpack the fields; return None if they do not fit the message's definition.

        Equal to pymavlink's ``decode`` without the checksum. Messages with arrays or texts, which are rare,
        are left to it.
        """
        numeric = _NUMERIC_MESSAGES.get(self.message_id)
        if numeric is None:
            return self._decode_any()
        definition, unpack, size, in_order = numeric
        data = self.data
        begin = HEADER_BYTES_V2 if data[0] == MAGIC_V2 else HEADER_BYTES_V1
        payload = data[begin : begin + min(data[1], size)]
        message = definition(*in_order(unpack(payload.ljust(size, b"\0"))))
        flags = data[2:4] if begin == HEADER_BYTES_V2 else b"\0\0"
        message._header = dialect.MAVLink_header(
            self.message_id, flags[0], flags[1], data[1], self.sequence, self.system_id, self.component_id
        )
        crc_at = begin + data[1]
        message._crc = data[crc_at] | (data[crc_at + 1] << 8)
        message._msgbuf = data
        message._payload = data[begin:crc_at]
        return message

    def _decode_any(self) -> Message | None:
        try:
            return dialect.MAVLink(None).decode(bytearray(self.data))
        except (dialect.MAVError, ValueError, TypeError, IndexError):
            return None


class FrameTable:
    """Frames of one datagram, in order, found once and shared. Equal bytes give an equal table.

    Parameters
    ----------
    data : bytes
        The datagram.
    rows : (n, WIDTH) array
        A row for each frame.
    bad_bytes : int
        Bytes that belong to no frame.
    crc_errors : int
        Complete frames of a known id with a wrong checksum.
    unknown : int
        Frames of an id that the dialect lacks: forwarded, not read.
    """

    __slots__ = ("bad_bytes", "count", "crc_errors", "data", "rows", "unknown")

    def __init__(self, data: bytes, rows: Int32Array, bad_bytes: int, crc_errors: int, unknown: int) -> None:
        self.data = data
        self.rows = rows
        self.count = len(rows)
        self.bad_bytes = bad_bytes
        self.crc_errors = crc_errors
        self.unknown = unknown

    def __iter__(self) -> Iterator[Frame]:
        return (self._frame(row) for row in self.rows.tolist())

    def is_checked(self, row: int) -> bool:
        """Return True if the checksum of a row's frame is valid."""
        return bool(self.rows.item(row, CHECKED))

    def frame(self, row: int) -> Frame:
        """Return the frame of a row."""
        return self._frame(self.rows[row].tolist())

    def _frame(self, row: list[int]) -> Frame:
        offset, length, message_id, system, component, sequence, signed, _ = row
        data = self.data[offset : offset + length]
        return Frame(system, component, sequence, message_id, bool(signed), data)

    @property
    def frames(self) -> list[Frame]:
        """Frames with a valid checksum."""
        return [self._frame(row) for row in self.rows.tolist() if row[CHECKED]]


def scan(data: bytes) -> FrameTable:
    """Return the frames of a datagram."""
    rows: list[tuple[int, ...]] = []
    bad_bytes = crc_errors = unknown = false_starts = 0
    tries = MAX_FALSE_STARTS
    at = 0
    end = len(data)
    while at < end:
        length = _frame_length(data, at, end)
        if length:
            if _has_valid_checksum(data, at, length):
                rows.append(_row(data, at, length, 1))
                at += length
                continue
            if _message_id(data, at) not in dialect.mavlink_map:
                if at + length == end or data[at + length] in (MAGIC_V1, MAGIC_V2):
                    covers_good, tries = _covers_good_frame(data, at, length, tries)
                    if not covers_good:
                        rows.append(_row(data, at, length, 0))
                        unknown += 1
                        at += length
                        continue
            else:
                crc_errors += 1
            false_starts += 1
            if false_starts >= MAX_FALSE_STARTS:
                bad_bytes += end - at
                break
        marker = START_BYTE.search(data, at + 1)
        next_at = marker.start() if marker else end
        bad_bytes += next_at - at
        at = next_at
    return FrameTable(data, np.array(rows, np.int32).reshape(-1, WIDTH), bad_bytes, crc_errors, unknown)


def _covers_good_frame(data: bytes, at: int, length: int, tries: int) -> tuple[bool, int]:
    """Return True if a good frame starts within the one claimed at `at`, and the number of checksums left.

    With none left, the claim is accepted.
    """
    end = len(data)
    stop = at + length
    while tries and (marker := START_BYTE.search(data, at + 1, stop)):
        at = marker.start()
        inner = _frame_length(data, at, end)
        if inner and _message_id(data, at) in dialect.mavlink_map:
            tries -= 1
            if _has_valid_checksum(data, at, inner):
                return True, tries
    return False, tries


def decode(data: bytes) -> tuple[list[Message], FrameTable]:
    """Return the messages of a datagram, and its frames."""
    found = scan(data)
    return [message for frame in found.frames if (message := frame.message()) is not None], found


class Encoder:
    """Packs messages as MAVLink 2 frames for one peer, with a sequence of its own.

    One sequence per peer: a vehicle that counts gaps then sees its own loss only.
    """

    def __init__(self, system_id: int = GCS_SYSTEM_ID, component_id: int = GCS_COMPONENT_ID) -> None:
        self._packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._sequence = 0

    def __call__(self, message: Message) -> bytes:
        """Pack one message and count it."""
        frame = self.pack(message, self._sequence)
        self._sequence = next_sequence(self._sequence)
        return frame

    def pack(self, message: Message, sequence: int) -> bytes:
        """Pack one message with a sequence number of the caller."""
        self._packer.seq = sequence
        return message.pack(self._packer)


def next_sequence(sequence: int) -> int:
    """Return the sequence number of the next frame."""
    return (sequence + 1) % 256


def _frame_length(data: bytes, at: int, end: int) -> int:
    """Return the length of the frame that may start at `at`; 0 if there is none."""
    magic = data[at]
    if magic == MAGIC_V2 and at + HEADER_BYTES_V2 + _CRC_BYTES <= end:
        flags = data[at + 2]
        if flags & ~SIGNED_FLAG:
            return 0
        length = (
            HEADER_BYTES_V2 + data[at + 1] + _CRC_BYTES + (_SIGNATURE_BYTES if flags & SIGNED_FLAG else 0)
        )
    elif magic == MAGIC_V1 and at + HEADER_BYTES_V1 + _CRC_BYTES <= end:
        length = HEADER_BYTES_V1 + data[at + 1] + _CRC_BYTES
    else:
        return 0
    return length if at + length <= end else 0


def _message_id(data: bytes, at: int) -> int:
    if data[at] == MAGIC_V1:
        return data[at + 5]
    return data[at + 7] | (data[at + 8] << 8) | (data[at + 9] << 16)


def checked_frame(data: bytes, at: int, length: int) -> Frame | None:
    """Return the frame of `length` bytes at `at` if its id is known and its checksum is valid."""
    return frame_at(data, at, length) if _has_valid_checksum(data, at, length) else None


def _has_valid_checksum(data: bytes, at: int, length: int) -> bool:
    definition = dialect.mavlink_map.get(_message_id(data, at))
    if definition is None:
        return False
    crc_at = at + length - _CRC_BYTES - (_SIGNATURE_BYTES if _is_signed(data, at) else 0)
    crc = dialect.x25crc(data[at + 1 : crc_at] + bytes((definition.crc_extra,))).crc
    return bool(crc == (data[crc_at] | (data[crc_at + 1] << 8)))


def _is_signed(data: bytes, at: int) -> bool:
    return data[at] == MAGIC_V2 and bool(data[at + 2] & SIGNED_FLAG)


def _row(data: bytes, at: int, length: int, checked: int) -> tuple[int, ...]:
    frame = frame_at(data, at, length)
    return (
        at,
        length,
        frame.message_id,
        frame.system_id,
        frame.component_id,
        frame.sequence,
        frame.signed,
        checked,
    )


def frame_at(data: bytes, at: int, length: int) -> Frame:
    """Return the frame of `length` bytes at `at`, unchecked."""
    sender = at + (5 if data[at] == MAGIC_V2 else 3)
    return Frame(
        data[sender],
        data[sender + 1],
        data[sender - 1],
        _message_id(data, at),
        _is_signed(data, at),
        data[at : at + length],
    )


def _target_offsets() -> dict[int, tuple[int, int | None]]:
    """Return the payload offsets of target system and target component, by message id."""
    found: dict[int, tuple[int, int | None]] = {}
    for message_id, definition in dialect.mavlink_map.items():
        at = 0
        where = {}
        fields = _FIELD_CODE.findall(definition.unpacker.format.lstrip("<"))
        for name, code in zip(definition.ordered_fieldnames, fields, strict=True):
            where[name] = at
            at += struct.calcsize("<" + code)
        system = where.get("target_system", where.get("target"))
        if system is not None:
            found[message_id] = (system, where.get("target_component"))
    return found


_TARGET_OFFSETS: Final = _target_offsets()


def is_for(message: Message, own: tuple[int, int]) -> bool:
    """Return True if a message with a target is for our system and component id, or for all."""
    return message.target_system in (0, own[0]) and message.target_component in (0, own[1])


def target_of(frame: Frame) -> tuple[int, int] | None:
    """Return the target (system, component) of a frame, 0 meaning all; None if its message has no target.

    Read without unpacking: fields are ordered by size. MANUAL_CONTROL calls its target system ``target``.
    """
    offsets = _TARGET_OFFSETS.get(frame.message_id)
    if offsets is None:
        return None
    system, component = offsets
    return payload_byte(frame, system), 0 if component is None else payload_byte(frame, component)


def payload_byte(frame: Frame, offset: int) -> int:
    """Return one byte of a frame's payload; truncated bytes are 0."""
    data = frame.data
    begin = HEADER_BYTES_V2 if data[0] == MAGIC_V2 else HEADER_BYTES_V1
    return data[begin + offset] if offset < data[1] else 0
