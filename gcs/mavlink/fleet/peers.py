"""Addresses of vehicles: their numbers in the telemetry table, and when our heartbeats to them are due.

An address is a link and a peer; vehicles may share one. Entries of unused addresses are dropped at a bound.
"""

from __future__ import annotations

from collections.abc import Callable, Set

from gcs.mavlink.fleet.heartbeat import HEARTBEAT_PERIOD_NS
from gcs.mavlink.fleet.telemetry_table import NO_ADDRESS
from gcs.mavlink.fleet.vehicle import Address


class Peers:
    """Addresses of all vehicles.

    Parameters
    ----------
    used_addresses : callable
        Returns the addresses in use.
    min_kept : int
        Numbers that are kept at least.
    """

    def __init__(self, used_addresses: Callable[[], Set[Address]], min_kept: int) -> None:
        self._used_addresses, self._min_kept = used_addresses, min_kept
        self._numbers: dict[Address, int] = {}
        self._next_number = 0
        self._heartbeat_t_ns: dict[Address, int] = {}

    def number_of(self, address: Address) -> int:
        """Return the number of an address; `NO_ADDRESS` if no vehicle was heard there."""
        return self._numbers.get(address, NO_ADDRESS)

    def add(self, address: Address) -> int:
        """Return the number of an address at which a vehicle is heard from now on."""
        if address not in self._numbers:
            if len(self._numbers) > self._min_kept:
                used_addresses = self._used_addresses()
                self._numbers = {a: number for a, number in self._numbers.items() if a in used_addresses}
            self._numbers[address] = self._next_number
            self._next_number += 1
        return self._numbers[address]

    def start_heartbeat(self, address: Address, t_ns: int) -> bool:
        """Return True, once a period, if a heartbeat to an address is due."""
        last_t_ns = self._heartbeat_t_ns.get(address)
        if last_t_ns is not None and t_ns - last_t_ns < HEARTBEAT_PERIOD_NS:
            return False
        if last_t_ns is None:
            used_addresses = self._used_addresses()
            self._heartbeat_t_ns = {a: t for a, t in self._heartbeat_t_ns.items() if a in used_addresses}
        self._heartbeat_t_ns[address] = t_ns
        return True

    def next_heartbeat_ns(self, address: Address) -> int:
        """Return when the next heartbeat to an address is due."""
        return self._heartbeat_t_ns[address] + HEARTBEAT_PERIOD_NS
