"""Telemetry logs (``.tlog``) as QGroundControl, Mission Planner and MAVProxy write and read them.

A tlog is a plain sequence of (8-byte big-endian microseconds since the Unix epoch, one MAVLink frame),
without a header (https://ardupilot.org/planner/docs/mission-planner-telemetry-logs.html). A datagram of
several frames becomes several entries. Bytes outside frames are left out, since readers expect one frame
after each time stamp.

Logs of other programs are read in bounded memory. A frame is valid if its checksum holds. A frame of an
unknown id, or of another dialect, is accepted between frames. All other bytes are damage, and reading goes on
at the next valid frame. A raw stream (as it came from a serial port) has no time stamps, and is no log.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from itertools import islice
from typing import BinaryIO, Literal, NamedTuple, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.errors import RecordingError
from gcs.mavlink.frames.codec import Frame, checked_frame, frame_at, scan

_STAMP = struct.Struct(">Q")
_MAX_STAMP_US = 4_102_444_800_000_000
"""The year 2100. Later stamps are invalid."""
_BLOCK_BYTES = 1024 * 1024
_MAX_ENTRY_BYTES = 2 * (8 + 280)
"""An entry, and the start of the next one."""
_MARKER = re.compile(b"[\xfd\xfe]")
_SAMPLE_PARTS = 200
_SAMPLE_BYTES = 16 * 1024 * 1024


Validity: TypeAlias = Literal["good", "unknown id", "bad checksum"]


class LogFrame(NamedTuple):
    """A frame of a log."""

    offset: int
    """Byte of the file at which the entry begins."""
    t_ns: int
    """Time stamp, or the last valid one."""
    frame: Frame
    validity: Validity
    """Only the content of a good frame is reliable. A bad checksum is damage or another dialect."""


class UnreadableBytes(NamedTuple):
    """A range of bytes without frames."""

    offset: int
    length: int


def tlog_entries(t_ns: int, datagram: bytes) -> bytes:
    """Return the tlog entries of a datagram; `t_ns` is the time since the Unix epoch."""
    stamp = _STAMP.pack(t_ns // 1000)
    return b"".join(stamp + frame for frame in split_frames(datagram))


def read_log(file: BinaryIO) -> Iterator[LogFrame | UnreadableBytes]:
    """Read a tlog to its end."""
    lead = _STAMP.size
    data = b""
    base = 0
    at = 0
    t_ns = 0
    ended = False
    bad_from: int | None = None
    while True:
        if len(data) - at < _MAX_ENTRY_BYTES and not ended:
            block = file.read(_BLOCK_BYTES)
            data = data[at:] + block
            base = base + at
            at = 0
            ended = not block
            continue
        if at >= len(data):
            break
        found = _entry(data, at + lead, in_step=bad_from is None)
        if found is None:
            bad_from = base + at if bad_from is None else bad_from
            marker = _MARKER.search(data, at + lead + 1)
            kept = 0 if ended else lead
            at = marker.start() - lead if marker else len(data) - kept
            continue
        if bad_from is not None:
            yield UnreadableBytes(bad_from, base + at - bad_from)
            bad_from = None
        frame, validity = found
        (stamp_us,) = _STAMP.unpack_from(data, at)
        if stamp_us <= _MAX_STAMP_US:
            t_ns = stamp_us * 1000
        yield LogFrame(base + at, t_ns, frame, validity)
        at += lead + len(frame.data)
    if bad_from is not None:
        yield UnreadableBytes(bad_from, base + at - bad_from)


def check_log(file: BinaryIO, name: str) -> None:
    """Check that a file is a telemetry log, by the entries in its first 16 MB. The file is rewound.

    Raises
    ------
    RecordingError
        If they have no MAVLink frame, or frames without time stamps: no entry follows another. `name` is the
        file's name in the message.
    """
    frames = 0
    in_step = 0
    follows = True
    head = io.BytesIO(file.read(_SAMPLE_BYTES))
    for part in islice(read_log(head), _SAMPLE_PARTS):
        is_frame = isinstance(part, LogFrame)
        frames += is_frame
        in_step += is_frame and follows
        follows = is_frame
    if file.seek(0, io.SEEK_END) == 0:
        raise RecordingError(name, "is empty")
    if frames == 0:
        problem = "is no recording, and no MAVLink frame is in its first 16 MB"
        raise RecordingError(name, f"{problem}: expected a recording (.mcap, or its folder) or a .tlog")
    if frames > 1 and in_step == 0:
        raise RecordingError(name, "is MAVLink without time stamps: expected a .tlog")
    file.seek(0)


def _entry(data: bytes, at: int, *, in_step: bool) -> tuple[Frame, Validity] | None:
    """Return the frame at `at` and its validity; None if there is no plausible frame."""
    end = len(data)
    length = _length(data, at, end) if at < end else 0
    if not length:
        return None
    frame = checked_frame(data, at, length)
    if frame is not None:
        return frame, "good"
    next_at = at + length + _STAMP.size
    if not in_step or not (at + length == end or (next_at < end and data[next_at] in b"\xfd\xfe")):
        return None
    frame = frame_at(data, at, length)
    return frame, "bad checksum" if frame.message_id in dialect.mavlink_map else "unknown id"


def split_frames(datagram: bytes) -> list[bytes]:
    """Split a datagram into its MAVLink frames.

    If frames fill the datagram from end to end, it is split by their lengths. Otherwise only frames with a
    valid checksum are returned.
    """
    frames = []
    at = 0
    end = len(datagram)
    while at < end:
        length = _length(datagram, at, end)
        if not length:
            return [frame.data for frame in scan(datagram).frames]
        frames.append(datagram[at : at + length])
        at += length
    return frames


def _length(data: bytes, at: int, end: int) -> int:
    """Return the length of the complete frame at `at`, or 0."""
    if data[at] == 0xFD and at + 12 <= end:
        length = 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
    elif data[at] == 0xFE and at + 8 <= end:
        length = 8 + data[at + 1]
    else:
        return 0
    return length if at + length <= end else 0
