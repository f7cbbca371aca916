"""Telemetry logs (``.tlog``) as QGroundControl, Mission Planner and MAVProxy write and read them.

A tlog is a plain sequence of (8-byte big-endian microseconds since the Unix epoch, one MAVLink frame),
without a header: https://ardupilot.org/planner/docs/mission-planner-telemetry-logs.html. Readers parse one
frame after each time stamp, so a datagram of several frames becomes several entries, and bytes that belong
to no frame must stay out.
"""

from __future__ import annotations

import struct

from gcs.mavlink.codec import scan

_STAMP = struct.Struct(">Q")
_MAX_US = 2**64 - 1


def tlog_entries(t_ns: int, datagram: bytes) -> bytes:
    """Return the entries of one datagram, ready to be appended to a tlog."""
    stamp = _STAMP.pack(min(max(t_ns // 1000, 0), _MAX_US))
    return b"".join(stamp + frame for frame in split_frames(datagram))


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
