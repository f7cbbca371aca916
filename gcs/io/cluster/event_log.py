"""Event log for a standby: all events that the engine of command consumes, in order and numbered.

============================  =================================================================
key                           message
============================  =================================================================
``swarm/<mission>/events``    `EventBatch`, while a standby subscribes
``swarm/<mission>/snapshot``  query for the state; the answer is a `StateReply`
============================  =================================================================

A state and the events after it are the engine. A standby that misses a batch asks for the state again.
"""

from __future__ import annotations

import hashlib
from typing import Annotated, Final, Literal

import msgspec
from msgspec import Meta

from gcs.core.snapshot import MAX_BYTES, encode_state
from gcs.core.state import State
from gcs.errors import WireError
from gcs.io import message_pack
from gcs.io.cluster.bridge_messages import ClockTime
from gcs.io.message_pack import decoder, encoder
from gcs.io.record_json import decode as decode_record
from gcs.io.record_json import encode as encode_record
from gcs.model import (
    BadInput,
    ClockStep,
    Datagram,
    Event,
    LinkNews,
    Order,
    Resumed,
    Scan,
    Tick,
)

VERSION: Final = 1
MAX_EVENTS: Final = 5_000
"""In one batch."""
_KINDS: Final[tuple[type[Event], ...]] = (
    Datagram, Scan, Tick, BadInput, LinkNews, ClockStep, Order, Resumed,
)  # fmt: skip
_NUMBERS: Final = {kind: number for number, kind in enumerate(_KINDS)}


class StateCheck(msgspec.Struct, frozen=True, array_like=True):
    """Hash of the state before an event."""

    number: int
    digest: bytes


class EventBatch(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Events in order."""

    version: Literal[1] = VERSION
    first: int
    """Number of the first one; 0 is the first event of the run."""
    events: Annotated[tuple[tuple[int, bytes], ...], Meta(max_length=MAX_EVENTS)] = ()
    """Kind and JSON of each."""
    check: StateCheck | None = None
    ends: bool = False
    """True if command has ended in order."""


class StateReply(msgspec.Struct, frozen=True, kw_only=True):
    """State of a command before an event."""

    version: Literal[1] = VERSION
    fingerprint: str
    """Of the mission file and the seed."""
    number: int
    """Of the next event."""
    t_ns: int
    clock: ClockTime
    state: bytes


_encode = encoder().encode
_batches: Final[msgspec.msgpack.Decoder[EventBatch]] = decoder(EventBatch)
_replies: Final[msgspec.msgpack.Decoder[StateReply]] = decoder(StateReply)


def packed(event: Event) -> tuple[int, bytes]:
    """Return an event for a batch."""
    return _NUMBERS[type(event)], encode_record(event)


def unpacked(kind: int, data: bytes) -> Event:
    """Return the event of a batch.

    Raises
    ------
    WireError
        If it is none.
    """
    if not 0 <= kind < len(_KINDS):
        raise WireError("events", f"no kind of event has the number {kind}")
    return decode_record("events", data, _KINDS[kind])


def encode(message: EventBatch | StateReply) -> bytes:
    """Return a message as MessagePack."""
    return _encode(message)


def decode_batch(key: str, payload: bytes) -> EventBatch:
    """Return the batch in a payload.

    Raises
    ------
    WireError
        If it is none of this version.
    """
    return message_pack.decode(key, payload, _batches, MAX_BYTES)


def decode_reply(key: str, payload: bytes) -> StateReply:
    """Return the state in a payload.

    Raises
    ------
    WireError
        If it is none of this version.
    """
    return message_pack.decode(key, payload, _replies, MAX_BYTES)


def digest(state: State) -> bytes:
    """Return a hash that is equal for equal states: a state has no sets, and its tables keep their order."""
    return hashlib.blake2b(encode_state(state), digest_size=8).digest()
