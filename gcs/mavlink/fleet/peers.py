"""Addresses of vehicles: their numbers in the telemetry table, and when our heartbeat to each is due.

An address is a link and a peer; vehicles may share one. Entries of unused addresses are dropped at a bound.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import dataclass, field
from typing import TypeAlias

from gcs.mavlink.fleet.heartbeat import HEARTBEAT_PERIOD_NS
from gcs.mavlink.fleet.telemetry_table import NO_ADDRESS

Address: TypeAlias = tuple[str, str]
"""(link, peer)."""
UsedAddresses: TypeAlias = Callable[[], Set[Address]]
"""Returns the addresses in use."""


@dataclass(slots=True)
class Peers:
    """Addresses of all vehicles."""

    numbers: dict[Address, int] = field(default_factory=dict)
    next_number: int = 0
    heartbeat_t_ns: dict[Address, int] = field(default_factory=dict)
    """Time of our last heartbeat to each address."""

    def number_of(self, address: Address) -> int:
        """Return the number of an address; `NO_ADDRESS` if no vehicle was heard there."""
        return self.numbers.get(address, NO_ADDRESS)

    def add(self, address: Address, used_addresses: UsedAddresses, min_kept: int) -> int:
        """Return the number of an address at which a vehicle is heard from now on.

        `min_kept` numbers are kept at least.
        """
        if address not in self.numbers:
            if len(self.numbers) > min_kept:
                used = used_addresses()
                self.numbers = {a: number for a, number in self.numbers.items() if a in used}
            self.numbers[address] = self.next_number
            self.next_number += 1
        return self.numbers[address]

    def start_heartbeat(self, address: Address, t_ns: int, used_addresses: UsedAddresses) -> bool:
        """Return True, once a period, if a heartbeat to an address is due."""
        last_t_ns = self.heartbeat_t_ns.get(address)
        if last_t_ns is not None and t_ns - last_t_ns < HEARTBEAT_PERIOD_NS:
            return False
        if last_t_ns is None:
            used = used_addresses()
            self.heartbeat_t_ns = {a: t for a, t in self.heartbeat_t_ns.items() if a in used}
        self.heartbeat_t_ns[address] = t_ns
        return True

    def next_heartbeat_ns(self, address: Address) -> int:
        """Return when the next heartbeat to an address is due."""
        return self.heartbeat_t_ns[address] + HEARTBEAT_PERIOD_NS
