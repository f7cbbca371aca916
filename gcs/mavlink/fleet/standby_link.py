"""Stand-by links: a vehicle that is heard on two links, such as radio and LTE, is heard on one at a time.

Frames of the stand-by link are counted and dropped. So a frame that comes on both counts once, and an upload
or a read-back never mixes two streams. The other link takes over when the first is silent, and only then: an
unsigned sender on the second link cannot take over a vehicle that is heard. Which links may be second paths
is said in the mission file (`redundant`).
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Final

from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.services.retry import ns

SWITCH_AFTER_NS: Final = ns(1.5)
"""Silence of the link in use after which a heartbeat on the other one takes over."""


def is_second_path(one: Address, other: Address, redundant: Container[str]) -> bool:
    """Return True if one vehicle may be heard at both addresses; `redundant` are the names of such links."""
    return one[0] != other[0] and (one[0] in redundant or other[0] in redundant)


@dataclass(slots=True)
class StandbyLink:
    """Stand-by link of one vehicle."""

    address: Address
    heard_t_ns: int
