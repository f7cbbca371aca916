"""Messages between a bridge and command, as MessagePack (https://msgpack.org).

=========================================  ================================================================
key                                        message
=========================================  ================================================================
``swarm/<mission>/bridge/<name>/up``       `Up`, from the bridge: what its links received
``swarm/<mission>/bridge/<name>/status``   `BridgeStatus`, from the bridge, once a second
``swarm/<mission>/bridge/<name>/down``     `Down`, from command: what its links are to send
``swarm/<mission>/bridge/<name>/lease``    query, an `Ask` for the lease; its `Answer` (``docs/failover.md``)
=========================================  ================================================================

Datagrams keep their order. A bridge and command of different versions refuse each other's messages.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, Self, TypeVar

import msgspec
from msgspec import Meta

from gcs.core.lease.lease_messages import Answer, Ask, Permit
from gcs.io import message_pack
from gcs.io.clock import RunClock, unix_ns
from gcs.io.message_pack import decoder, encoder
from gcs.mavlink.frames.signing import SigningCounters
from gcs.mavlink.router.router import PortCounters
from gcs.model import NS_PER_S, Notice, Picture

VERSION: Final = 1
MAX_BYTES: Final = 8 * 1024 * 1024
MAX_BATCH: Final = 2048
"""Datagrams in one message."""

MessageT = TypeVar("MessageT")


class Message(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Any of them."""

    version: Literal[1] = VERSION


class Packet(msgspec.Struct, frozen=True, array_like=True):
    """A datagram, and its address."""

    link: str
    peer: str
    data: bytes


Packets = Annotated[tuple[Packet, ...], Meta(max_length=MAX_BATCH)]


class Up(Message, frozen=True, kw_only=True, omit_defaults=True):
    """What a bridge has received."""

    number: int
    """Of this message, from 0 at the start of the bridge: a gap shows loss."""
    boot: int
    """Start of the bridge."""
    sent_ns: int
    """The bridge's monotonic time (`gcs.io.cluster.lateness`)."""
    packets: Packets = ()
    notices: tuple[Notice, ...] = ()
    """About its links; command sets the time."""


class ClockTime(msgspec.Struct, frozen=True, array_like=True):
    """Run time when a message was made, and how fast it passes."""

    t_ns: int
    speed: float

    @classmethod
    def of(cls, clock: RunClock) -> Self:
        """Return the time of a clock now."""
        return cls(clock.now_ns(), clock.speed)

    def clock(self, age_s: float = 0.0) -> RunClock:
        """Return a clock that shows this time now, or with the age of the message a later one."""
        return RunClock(unix_ns(), self.t_ns + int(age_s * self.speed * NS_PER_S), self.speed)


class Down(Message, frozen=True, kw_only=True, omit_defaults=True):
    """What a bridge is to do; each one is a sign of life of command."""

    permit: Permit
    """Of the lease under which it is sent."""
    packets: Packets = ()
    busy: tuple[int, ...] | None = None
    """Vehicles with a mission transfer in progress; None: as before."""
    targets: Picture | None = None
    """Newest picture of the targets, for ADS-B."""
    clock: ClockTime | None = None
    ends: bool = False
    """True if command ends: the bridge ends its heartbeats."""


class BridgeStatus(Message, frozen=True, kw_only=True, omit_defaults=True):
    """State of a bridge."""

    ports: dict[str, int]
    """Of each endpoint by name; 0 for those that do not listen."""
    unsent: dict[str, int]
    stations: dict[str, list[str]]
    """Other ground stations of each endpoint."""
    counters: dict[str, PortCounters]
    keyed_links: tuple[str, ...] = ()
    """Links with a key for any system."""
    keyed_vehicles: frozenset[tuple[str, int]] = frozenset()
    """(link, vehicle) whose frames must be signed."""
    signing: dict[str, SigningCounters] = {}


_encode = encoder().encode
_decoders: Final[dict[type, msgspec.msgpack.Decoder[Any]]] = {
    kind: decoder(kind) for kind in (Up, Down, BridgeStatus, Ask, Answer)
}


def encode(message: Message | Ask | Answer) -> bytes:
    """Return a message as MessagePack."""
    return _encode(message)


def decode(source: str, payload: bytes, kind: type[MessageT]) -> MessageT:
    """Return the message in a payload; `source` says in the error where it came from.

    Raises
    ------
    WireError
        If it is too long, or no such message of this version.
    """
    message = message_pack.decode(source, payload, _decoders[kind], MAX_BYTES)
    assert isinstance(message, kind)
    return message
