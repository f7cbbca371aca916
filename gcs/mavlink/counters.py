"""What is counted of the links: totals, by link, and who else is there."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.mavlink.vehicle import Address


@dataclass(slots=True)
class Counters:
    """Totals over all links."""

    datagrams: int = 0
    frames: int = 0
    bad_bytes: int = 0
    crc_errors: int = 0
    unknown_ids: int = 0
    strangers: int = 0
    """Frames of system ids that are not expected."""
    conflicts: int = 0
    """Frames that claimed a vehicle's id from another address."""
    ignored: int = 0
    """Frames of a vehicle before its contact, or of its other components."""
    notices_dropped: int = 0


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


@dataclass(slots=True)
class Stranger:
    """Somebody on the link who is not a vehicle of ours."""

    system_id: int
    component_id: int
    address: Address
    frames: int
    heard_t_ns: int
