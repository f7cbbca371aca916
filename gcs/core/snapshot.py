"""Snapshots: the state of the decision core as bytes and back, how often they are taken, and their format.

One MessagePack object (https://msgpack.org) with a format version. Arrays are their dtype, shape and bytes;
MAVLink messages are their number and fields.
The types of all records are checked when a snapshot is read; the values are checked by their stages.
"""

from __future__ import annotations

from typing import Any, Final

import msgspec
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.state import State
from gcs.errors import WireError
from gcs.model import NS_PER_S, Event, Snapshot, Tick, array_of_parts, array_parts

VERSION: Final = 5
PERIOD_NS: Final = 10 * NS_PER_S
"""A replay from any time processes at most the events of this period first: some 0.1 s."""
MAX_BYTES: Final = 64 * 1024 * 1024


class _Snapshot(msgspec.Struct, frozen=True):
    version: int
    state: msgspec.Raw


def _to_plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return array_parts(value)
    if isinstance(value, dialect.MAVLink_message):
        return (value.get_msgId(), [getattr(value, name) for name in value.fieldnames])
    raise NotImplementedError(type(value).__name__)


def _from_plain(expected: Any, value: Any) -> Any:
    if expected is dialect.MAVLink_message:
        number, fields = msgspec.convert(value, tuple[int, list[Any]])
        if number not in dialect.mavlink_map:
            raise ValueError(f"no message has number {number}")
        return dialect.mavlink_map[number](*fields)
    return array_of_parts(expected, value).copy()


_encoder = msgspec.msgpack.Encoder(enc_hook=_to_plain)
_decoder = msgspec.msgpack.Decoder(State, dec_hook=_from_plain)
_head_decoder = msgspec.msgpack.Decoder(_Snapshot)


def encode_state(state: State) -> bytes:
    """Return a snapshot of the state."""
    return _encoder.encode(_Snapshot(VERSION, msgspec.Raw(_encoder.encode(state))))


def decode_state(source: str, data: bytes) -> State:
    """Return the state of a snapshot.

    Raises
    ------
    WireError
        If it is no snapshot of this version; `source` is its origin.
    """
    if len(data) > MAX_BYTES:
        raise WireError(source, f"{len(data)} bytes are more than the {MAX_BYTES} allowed")
    try:
        head = _head_decoder.decode(data)
        if head.version != VERSION:
            raise WireError(source, f"has version {head.version}, this program reads {VERSION}")
        return _decoder.decode(head.state)
    except (msgspec.DecodeError, ValueError, TypeError, RecursionError) as error:
        raise WireError(source, f"no valid snapshot: {error}") from None


class PeriodicSnapshots:
    """Snapshots for a recording, one a period."""

    def __init__(self) -> None:
        self._due_t_ns = 0

    def before(self, event: Event, state: State) -> Snapshot | None:
        """Return the state before an event, if a snapshot is due."""
        if not isinstance(event, Tick) or event.t_ns < self._due_t_ns:
            return None
        self._due_t_ns = event.t_ns + PERIOD_NS
        return Snapshot(event.t_ns, encode_state(state))
