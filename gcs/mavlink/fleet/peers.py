"""Where vehicles are heard: the numbers that the ledger calls these places by, and our heartbeats to them.

An address is a link and a peer on it; several vehicles may share one. Senders come and go, so what is kept of
an address where no vehicle is heard any more is forgotten when there is much of it.
"""

from __future__ import annotations

from collections.abc import Callable, Set

from gcs.mavlink.fleet.heartbeat import HEARTBEAT_PERIOD_NS
from gcs.mavlink.fleet.telemetry_table import NOBODY
from gcs.mavlink.fleet.vehicle import Address


class Peers:
    """Of all vehicles.

    Parameters
    ----------
    used : callable
        Those where somebody is heard or called now.
    most : int
        Numbers that are kept at the least.
    """

    def __init__(self, used: Callable[[], Set[Address]], most: int) -> None:
        self._used, self._most = used, most
        self._numbers: dict[Address, int] = {}
        self._next_number = 0
        self._beats_t_ns: dict[Address, int] = {}

    def known(self, address: Address) -> int:
        """Return the number of an address; `NOBODY` for one where no vehicle was met."""
        return self._numbers.get(address, NOBODY)

    def meet(self, address: Address) -> int:
        """Return the number of an address where a vehicle is heard from now on."""
        if address not in self._numbers:
            if len(self._numbers) > self._most:
                used = self._used()
                self._numbers = {a: number for a, number in self._numbers.items() if a in used}
            self._numbers[address] = self._next_number
            self._next_number += 1
        return self._numbers[address]

    def beat_due(self, address: Address, t_ns: int) -> bool:
        """Return True, once a period, if an address is due its heartbeat; vehicles may share it."""
        beat_t_ns = self._beats_t_ns.get(address)
        if beat_t_ns is not None and t_ns - beat_t_ns < HEARTBEAT_PERIOD_NS:
            return False
        if beat_t_ns is None:
            used = self._used()
            self._beats_t_ns = {a: t for a, t in self._beats_t_ns.items() if a in used}
        self._beats_t_ns[address] = t_ns
        return True

    def next_beat_ns(self, address: Address) -> int:
        """Return when the next one is due at an address that had one."""
        return self._beats_t_ns[address] + HEARTBEAT_PERIOD_NS
