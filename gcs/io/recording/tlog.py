"""Telemetry logs (``.tlog``) as QGroundControl, Mission Planner and MAVProxy write and read them.

A tlog is a plain sequence of (8-byte big-endian microseconds since the Unix epoch, one MAVLink frame),
without a header: https://ardupilot.org/planner/docs/mission-planner-telemetry-logs.html. Readers parse one
frame after each time stamp, so a datagram of several frames becomes several entries, and bytes that belong
to no frame must stay out.

Logs of others are read in bounded memory and believed frame by frame. A frame counts when its checksum holds;
one of an id that we do not know, or that another dialect defines otherwise, has a place when it lies between
frames. All else is damage; the first good frame behind it is found again whatever the damage was. A raw
stream (frames alone, as they came from a serial port) is the same without stamps.
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
from gcs.mavlink.frames.codec import Frame, checked_frame, scan

_STAMP = struct.Struct(">Q")
_LATEST_US = 4_102_444_800_000_000
"""The year 2100: a later stamp is none."""
_BLOCK_BYTES = 1024 * 1024
_MAX_ENTRY_BYTES = 2 * (8 + 280)
"""An entry and the beginning of the next."""
_MARKER = re.compile(b"[\xfd\xfe]")
_SNIFFED = 200
_SNIFFED_BYTES = 16 * 1024 * 1024


class LogClock:
    """Makes one time line of a log's stamps, whose clock may have been set while it was written.

    A step back by more than `_BACK_NS`, or ahead by more than `_AHEAD_NS`, is none of time: the line goes on
    from where it was. Smaller steps back are datagrams that overtook each other, and stay.
    """

    _BACK_NS = 60 * 1_000_000_000
    _AHEAD_NS = 24 * 3600 * 1_000_000_000

    def __init__(self) -> None:
        self.jumps = 0
        self._last_ns: int | None = None
        self._shift_ns = 0

    def __call__(self, stamp_ns: int) -> int:
        """Return the time of a stamp on the line."""
        t_ns = stamp_ns + self._shift_ns
        if self._last_ns is not None and not -self._BACK_NS <= t_ns - self._last_ns <= self._AHEAD_NS:
            self.jumps += 1
            self._shift_ns += self._last_ns - t_ns
            t_ns = self._last_ns
        self._last_ns = t_ns if self._last_ns is None else max(t_ns, self._last_ns)
        return t_ns


Standing: TypeAlias = Literal["good", "unknown id", "bad checksum"]


class Logged(NamedTuple):
    """One frame of a log."""

    offset: int
    """Byte of the file where its entry begins."""
    t_ns: int
    """Its stamp, or the last good one; 0 in a raw stream."""
    frame: Frame
    standing: Standing
    """Only of a good frame can the content be believed. A bad checksum is damage or another dialect."""


class Unreadable(NamedTuple):
    """A stretch of a log that holds no frames."""

    offset: int
    length: int


def tlog_entries(t_ns: int, datagram: bytes) -> bytes:
    """Return the entries of one datagram, ready to be appended to a tlog."""
    stamp = _STAMP.pack(t_ns // 1000)
    return b"".join(stamp + frame for frame in split_frames(datagram))


def read_log(file: BinaryIO, *, stamped: bool = True) -> Iterator[Logged | Unreadable]:
    """Read a tlog, or a raw MAVLink stream when it is not `stamped`, to its end, whatever it holds."""
    lead = _STAMP.size if stamped else 0
    data, base, at, t_ns, ended = b"", 0, 0, 0, False
    bad_from: int | None = None
    while True:
        if len(data) - at < _MAX_ENTRY_BYTES and not ended:
            block = file.read(_BLOCK_BYTES)
            data, base, at, ended = data[at:] + block, base + at, 0, not block
            continue
        if at >= len(data):
            break
        found = _entry(data, at + lead, lead, in_step=bad_from is None)
        if found is None:
            bad_from = base + at if bad_from is None else bad_from
            marker = _MARKER.search(data, at + lead + 1)
            at = marker.start() - lead if marker else len(data) if ended else len(data) - lead
            continue
        if bad_from is not None:
            yield Unreadable(bad_from, base + at - bad_from)
            bad_from = None
        frame, standing = found
        if stamped and (stamp_us := _STAMP.unpack_from(data, at)[0]) <= _LATEST_US:
            t_ns = stamp_us * 1000
        yield Logged(base + at, t_ns, frame, standing)
        at += lead + len(frame.data)
    if bad_from is not None:
        yield Unreadable(bad_from, base + at - bad_from)


def is_stamped(file: BinaryIO, name: str) -> bool:
    """Tell a tlog from a raw stream by what lies between the first frames; goes back to the beginning.

    The beginning of the file decides, so that gigabytes of something else are refused at once.

    Raises
    ------
    RecordingError
        When no frame is there; it calls the file `name`.
    """
    between, frames = 0, 0
    head = io.BytesIO(file.read(_SNIFFED_BYTES))
    for part in islice(read_log(head, stamped=False), _SNIFFED):
        if isinstance(part, Unreadable):
            between += part.length == _STAMP.size
        else:
            frames += 1
    if frames == 0:
        empty = file.seek(0, io.SEEK_END) == 0
        raise RecordingError(
            name, "is empty" if empty else "is no recording, and no MAVLink frame is in its first 16 MB"
        )
    file.seek(0)
    return 2 * between >= frames


def _entry(data: bytes, at: int, lead: int, *, in_step: bool) -> tuple[Frame, Standing] | None:
    """Return the frame at `at` and what is known of it; None when there is none to be believed."""
    end = len(data)
    length = _length(data, at, end) if at < end else 0
    if not length:
        return None
    frame = checked_frame(data, at, length)
    if frame is not None:
        return frame, "good"
    next_at = at + length + lead
    if not in_step or not (at + length == end or (next_at < end and data[next_at] in b"\xfd\xfe")):
        return None
    frame = _unchecked(data[at : at + length])
    return frame, "bad checksum" if frame.message_id in dialect.mavlink_map else "unknown id"


def _unchecked(data: bytes) -> Frame:
    """Read the header of a frame of an unknown id."""
    if data[0] == 0xFD:
        message_id = int.from_bytes(data[7:10], "little")
        return Frame(data[5], data[6], data[4], message_id, bool(data[2] & 1), data)
    return Frame(data[3], data[4], data[2], data[5], False, data)


def split_frames(datagram: bytes) -> list[bytes]:
    """Split a datagram into its MAVLink frames.

    A datagram that frames fill from end to end is split by their lengths alone. In any other, only frames
    whose checksum holds are taken.
    """
    frames = []
    at, end = 0, len(datagram)
    while at < end:
        length = _length(datagram, at, end)
        if not length:
            return [frame.data for frame in scan(datagram).frames]
        frames.append(datagram[at : at + length])
        at += length
    return frames


def _length(data: bytes, at: int, end: int) -> int:
    """Length of the whole frame at `at`, 0 when there is none."""
    if data[at] == 0xFD and at + 12 <= end:
        length = 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
    elif data[at] == 0xFE and at + 8 <= end:
        length = 8 + data[at + 1]
    else:
        return 0
    return length if at + length <= end else 0
