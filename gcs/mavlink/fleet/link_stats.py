"""Counters of the links, and the unknown systems there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, dataclass, field

from gcs.mavlink.fleet.peers import Address


@dataclass(slots=True)
class LinkCounters:
    """Counters of one link of vehicles."""

    datagrams: int = 0
    bytes: int = 0
    frames: int = 0
    """Frames with a valid checksum."""
    bad_bytes: int = 0
    """Bytes that belong to no frame."""
    crc_errors: int = 0
    unknown_ids: int = 0
    lost: int = 0
    """Frames of our vehicles missing by their sequence numbers."""
    unknown_systems: int = 0
    """Frames of system ids that are not expected there."""
    conflicts: int = 0
    """Frames that used a vehicle's id from another address."""
    standby: int = 0
    """Frames of vehicles that are heard on another link now."""
    ignored: int = 0
    """Frames of a vehicle before its first heartbeat, or of its other components."""


def total(counters: Iterable[LinkCounters]) -> LinkCounters:
    """Return the sum over links."""
    return LinkCounters(*map(sum, zip(*map(astuple, counters), strict=True)))


@dataclass(frozen=True, slots=True)
class RadioReport:
    """Newest RADIO_STATUS of the radio on this side of a link (https://mavlink.io/en/messages/common.html).

    Signal and noise are numbers of the radio: for those with SiK firmware 1.9 a decibel, 0 to 254.
    """

    t_ns: int
    signal: int
    noise: int
    remote_signal: int
    """At the other end."""
    remote_noise: int
    free_percent: int
    """Free part of its buffer towards the vehicles."""
    errors: int
    """Frames that it received damaged."""


@dataclass(slots=True)
class UnknownSystem:
    """A system on a link that is not one of our vehicles."""

    system_id: int
    component_id: int
    address: Address
    frames: int
    heard_t_ns: int


@dataclass(slots=True)
class UnknownSystems:
    """List of unknown systems, with a bound."""

    known: dict[tuple[int, int, Address], UnknownSystem] = field(default_factory=dict)
    """By system id, component id and address, in order of appearance."""

    def add_frame(
        self, system_id: int, component_id: int, address: Address, t_ns: int, max_systems: int
    ) -> bool:
        """Count a frame; return True if its sender is new in the list of at most `max_systems`."""
        key = (system_id, component_id, address)
        known = self.known.get(key)
        if known is not None:
            known.frames += 1
            known.heard_t_ns = t_ns
        elif len(self.known) < max_systems:
            self.known[key] = UnknownSystem(*key, 1, t_ns)
            return True
        return False
