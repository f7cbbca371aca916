"""What is counted of the links, and who else is there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, dataclass

from gcs.mavlink.fleet.vehicle import Address


@dataclass(slots=True)
class LinkCounters:
    """What was heard on one link of vehicles."""

    datagrams: int = 0
    bytes: int = 0
    frames: int = 0
    """Frames whose checksum holds."""
    bad_bytes: int = 0
    """Bytes that belong to no frame."""
    crc_errors: int = 0
    unknown_ids: int = 0
    lost: int = 0
    """Frames of our vehicles that are missing in their sequences."""
    strangers: int = 0
    """Frames of system ids that are not expected there."""
    conflicts: int = 0
    """Frames that claimed a vehicle's id from another address."""
    ignored: int = 0
    """Frames of a vehicle before its contact, or of its other components."""


def total(counters: Iterable[LinkCounters]) -> LinkCounters:
    """Sum over links."""
    return LinkCounters(*map(sum, zip(*map(astuple, counters), strict=True)))


@dataclass(slots=True)
class UnknownSystem:
    """Somebody on the link who is not a vehicle of ours."""

    system_id: int
    component_id: int
    address: Address
    frames: int
    heard_t_ns: int


class UnknownSystems:
    """Those who are told apart, `most` at the most."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._known: dict[tuple[int, int, Address], UnknownSystem] = {}

    def count(self, system_id: int, component_id: int, address: Address, t_ns: int) -> bool:
        """Count a frame; whether it is the first of somebody who is told apart from now on."""
        key = (system_id, component_id, address)
        known = self._known.get(key)
        if known is not None:
            known.frames += 1
            known.heard_t_ns = t_ns
        elif len(self._known) < self._most:
            self._known[key] = UnknownSystem(*key, 1, t_ns)
            return True
        return False

    def known(self) -> tuple[UnknownSystem, ...]:
        """Return them in the order of appearance."""
        return tuple(self._known.values())
