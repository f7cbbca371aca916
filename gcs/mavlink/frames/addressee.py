"""Whom a frame is for: the system and component that its payload names, read without unpacking it.

Where the two bytes lie follows from the message's definition: fields are ordered by size, and the zeros at
the end of a MAVLink 2 payload are left out (https://mavlink.io/en/guide/serialization.html), so a byte that
is not there is 0. MANUAL_CONTROL calls its system ``target``.
"""

from __future__ import annotations

import re
import struct
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Frame

_FIELD: Final = re.compile(r"\d*[a-zA-Z]")
_V2: Final = 0xFD


def _offsets() -> dict[int, tuple[int, int | None]]:
    """Offset of target system and target component in the payload of each message that has them."""
    found: dict[int, tuple[int, int | None]] = {}
    for message_id, definition in dialect.mavlink_map.items():
        at, where = 0, {}
        fields = _FIELD.findall(definition.unpacker.format.lstrip("<"))
        for name, code in zip(definition.ordered_fieldnames, fields, strict=True):
            where[name] = at
            at += struct.calcsize("<" + code)
        system = where.get("target_system", where.get("target"))
        if system is not None:
            found[message_id] = (system, where.get("target_component"))
    return found


_OFFSETS: Final = _offsets()


def target_of(frame: Frame) -> tuple[int, int] | None:
    """Return the (system, component) that a frame is for, 0 meaning all; None for one that names nobody."""
    offsets = _OFFSETS.get(frame.message_id)
    if offsets is None:
        return None
    system, component = offsets
    return payload_byte(frame, system), 0 if component is None else payload_byte(frame, component)


def payload_byte(frame: Frame, offset: int) -> int:
    """One byte of a frame's payload, 0 where it was left out."""
    data = frame.data
    begin = 10 if data[0] == _V2 else 6
    return data[begin + offset] if offset < data[1] else 0
