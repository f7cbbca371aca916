"""`gcs.mavlink.frames.codec.scan` as a compiled kernel, about a hundred times as fast.

One call scans a datagram into the rows of a `FrameTable`, without Python objects. `scan` is the reference:
same frames, same counters, same bound on false starts.

The checksum is CRC-16/MCRF4XX (https://mavlink.io/en/guide/serialization.html), four bytes per step. Table k
holds a byte's effect on the checksum when k more zero bytes follow.

Message ids and CRC_EXTRA are arguments of the kernel: numba's cache does not notice a new pymavlink.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs import jit
from gcs.mavlink.frames.codec import (
    CHECKED,
    COMPONENT,
    LENGTH,
    MAX_FALSE_STARTS,
    MESSAGE_ID,
    OFFSET,
    SEQUENCE,
    SIGNED,
    SYSTEM,
    WIDTH,
    FrameTable,
)
from gcs.model import ByteArray, Int16Array, Int32Array

Bytes: TypeAlias = bytes | ByteArray

_MIN_FRAME_BYTES: Final = 8


def _crc_steps() -> Int32Array:
    steps = np.zeros((4, 256), np.int32)
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x8408 if crc & 1 else 0)
        steps[0, byte] = crc
    for k in range(1, 4):
        steps[k] = (steps[k - 1] >> 8) ^ steps[0, steps[k - 1] & 0xFF]
    return steps


CRC_TABLES: Final = _crc_steps()


def _crc_extras() -> Int16Array:
    """Return CRC_EXTRA by message id; -1 for unknown ids."""
    extras = np.full(max(dialect.mavlink_map) + 1, -1, np.int16)
    for message_id, definition in dialect.mavlink_map.items():
        extras[message_id] = definition.crc_extra
    return extras


CRC_EXTRAS: Final = _crc_extras()


@jit.leaf
def _uint16(data: Bytes, at: int) -> int:
    """Return two bytes as a signed integer: numba would make a float of signed and unsigned operands."""
    return jit.int64(data[at]) | (jit.int64(data[at + 1]) << 8)


@jit.leaf
def _message_id(data: Bytes, at: int) -> int:
    if data[at] == 0xFE:
        return jit.int64(data[at + 5])
    return _uint16(data, at + 7) | (jit.int64(data[at + 9]) << 16)


@jit.leaf
def _crc(data: Bytes, begin: int, end: int, extra: int) -> int:
    """Return the checksum of `data[begin:end]` and the CRC_EXTRA byte."""
    crc = jit.int64(0xFFFF)
    at = begin
    while at + 4 <= end:
        crc ^= _uint16(data, at)
        crc = (
            CRC_TABLES[3, crc & 0xFF]
            ^ CRC_TABLES[2, crc >> 8]
            ^ CRC_TABLES[1, data[at + 2]]
            ^ CRC_TABLES[0, data[at + 3]]
        )
        at += 4
    while at < end:
        crc = (crc >> 8) ^ CRC_TABLES[0, (crc ^ jit.int64(data[at])) & 0xFF]
        at += 1
    return (crc >> 8) ^ CRC_TABLES[0, (crc ^ extra) & 0xFF]


@jit.leaf
def frame_at(data: Bytes, at: int, end: int, extras: Int16Array, frames: Int32Array, row: int) -> int:
    """Put the frame that may start at `at` into `frames[row]`.

    Returns its length; 0 if there is no frame, and less than 0 if its checksum does not
    hold. What it writes then is of no meaning.
    """
    if data[at] == 0xFD:
        if at + 12 > end or data[at + 2] > 1:
            return 0
        signed = jit.int64(data[at + 2])
        crc_at = at + 10 + jit.int64(data[at + 1])
        sender = at + 4
    elif data[at] == 0xFE:
        if at + 8 > end:
            return 0
        signed = jit.int64(0)
        crc_at = at + 6 + jit.int64(data[at + 1])
        sender = at + 2
    else:
        return 0
    length = crc_at + 2 + 13 * signed - at
    if at + length > end:
        return 0
    message_id = _message_id(data, at)
    checked = 1 if message_id < len(extras) and extras[message_id] >= 0 else 0
    if checked:
        if _crc(data, at + 1, crc_at, extras[message_id]) != _uint16(data, crc_at):
            return -length
    elif at + length < end and data[at + length] != 0xFD and data[at + length] != 0xFE:
        return -length
    frames[row, OFFSET] = at
    frames[row, LENGTH] = length
    frames[row, MESSAGE_ID] = message_id
    frames[row, SEQUENCE] = data[sender]
    frames[row, SYSTEM] = data[sender + 1]
    frames[row, COMPONENT] = data[sender + 2]
    frames[row, SIGNED] = signed
    frames[row, CHECKED] = checked
    return length


@jit.leaf
def _covers_good_frame(
    data: Bytes, at: int, length: int, extras: Int16Array, frames: Int32Array, row: int, tries: int
) -> tuple[bool, int]:
    """Return True if a good frame starts within the one claimed at `at`, and the number of checksums left.

    As in `gcs.mavlink.frames.codec`; `frames[row]` is overwritten.
    """
    end = len(data)
    stop = at + length
    at += 1
    while tries > 0 and at < stop:
        inner = frame_at(data, at, end, extras, frames, row)
        if inner != 0:
            message_id = _message_id(data, at)
            if message_id < len(extras) and extras[message_id] >= 0:
                tries -= 1
                if inner > 0:
                    return True, tries
        at += 1
    return False, tries


@jit.leaf
def _scan_datagram(data: Bytes, extras: Int16Array, frames: Int32Array) -> tuple[int, int, int, int]:
    """Fill `frames`; return their number, bad bytes, checksum errors and the number of unknown frames."""
    count = bad_bytes = crc_errors = unknown = false_starts = 0
    tries = MAX_FALSE_STARTS
    at = 0
    end = len(data)
    while at < end:
        length = frame_at(data, at, end, extras, frames, count)
        if length > 0 and not frames[count, CHECKED]:
            covers_good, tries = _covers_good_frame(data, at, length, extras, frames, count + 1, tries)
            length = -length if covers_good else length
        if length > 0:
            unknown += 1 - frames[count, CHECKED]
            count += 1
            at += length
            continue
        if length < 0:
            false_starts += 1
            message_id = _message_id(data, at)
            crc_errors += 1 if message_id < len(extras) and extras[message_id] >= 0 else 0
            if false_starts >= MAX_FALSE_STARTS:
                bad_bytes += end - at
                break
        next_at = at + 1
        while next_at < end and data[next_at] != 0xFD and data[next_at] != 0xFE:
            next_at += 1
        bad_bytes += next_at - at
        at = next_at
    return count, bad_bytes, crc_errors, unknown


@jit.kernel
def _scan_kernel(data: Bytes, extras: Int16Array, frames: Int32Array) -> tuple[int, int, int, int]:
    return _scan_datagram(data, extras, frames)


class Scanner:
    """Scans datagrams; not for several threads at once."""

    def __init__(self) -> None:
        self._rows = np.zeros((256, WIDTH), np.int32)

    def __call__(self, data: bytes) -> FrameTable:
        """Return the frames of a datagram."""
        if len(self._rows) < len(data) // _MIN_FRAME_BYTES + 2:
            self._rows = np.zeros((len(data) // _MIN_FRAME_BYTES + 2, WIDTH), np.int32)
        count, bad_bytes, crc_errors, unknown = _scan_kernel(data, CRC_EXTRAS, self._rows)
        return FrameTable(data, self._rows[:count].copy(), bad_bytes, crc_errors, unknown)


def warm_up_calls() -> list[jit.Call]:
    """Return one call of each kernel."""
    return [(_scan_kernel, b"\xfd", CRC_EXTRAS, np.zeros((2, WIDTH), np.int32))]
