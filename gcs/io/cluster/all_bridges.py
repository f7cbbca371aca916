"""Links of all bridges of a mission, as command sees them (`gcs.io.links.vehicle_links.VehicleLinks`)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from operator import or_
from typing import Final

from gcs.core.lease.node_lease import Duty
from gcs.endpoints import Link
from gcs.io.cluster.bridge_links import BridgeLinks
from gcs.io.cluster.command_lease import CommandLease
from gcs.io.links.vehicle_links import LinkHandler
from gcs.mavlink.frames.signing import SigningCounters
from gcs.mavlink.router.router import PortCounters
from gcs.model import NoticeCode, NoticeContent, Picture

_TOLD_AFTER: Final = 40
"""Ticks, two seconds, without most of the bridges before an alarm."""


class AllBridges:
    """All bridges, and the lease over them.

    Parameters
    ----------
    bridges : sequence of BridgeLinks
        In the order of the mission file.
    lease : CommandLease
    """

    def __init__(self, bridges: Sequence[BridgeLinks], lease: CommandLease) -> None:
        self.name = "command"
        """Name in notices."""
        self.bridges = tuple(bridges)
        self.links: tuple[Link, ...] = tuple(link for bridge in bridges for link in bridge.links)
        self._lease = lease
        self._bridge_of = {link.name: bridge for bridge in bridges for link in bridge.links}
        self._by_name = {bridge.bridge: bridge for bridge in bridges}
        self.go_on = False
        """True if the bridges are to go on without this command: it has begun, and not ended in order."""
        self._ticks_without = 0
        self._is_told = False

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        handler: LinkHandler,
        busy: Callable[[int], bool] = lambda _: False,
    ) -> None:
        """Start receiving; `busy` returns True during a mission transfer to a vehicle."""
        self.go_on = True
        for bridge in self.bridges:
            bridge.start(loop, handler, busy)

    def send(self, link: str, peer: str, data: bytes) -> None:
        """Send to a peer of a link. Without the lease nothing is sent."""
        if link in self._bridge_of:
            self._bridge_of[link].send(link, peer, data)

    def picture(self, picture: Picture) -> None:
        """Set the newest picture of the targets."""
        for bridge in self.bridges:
            bridge.picture(picture)

    def tick(self, t_ns: int) -> None:  # noqa: ARG002  bridges have their own time
        """Ask for leases that are due; tell the bridges that command is alive."""
        self.ask_for_lease()
        for bridge in self.bridges:
            bridge.tick()
        self._ticks_without = 0 if self.may_command() else self._ticks_without + 1

    def ask_for_lease(self) -> None:
        """Ask the bridges for their leases, or renew them, where that is due."""
        for name, ask in self._lease.due_asks().items():
            self._by_name[name].ask(ask)

    def commander(self) -> str:
        """Return the name of another node that commands; empty if there is none."""
        return self._lease.commander()

    def may_command(self) -> bool:
        """Return True if this node has the leases that it needs."""
        return self._lease.duty is Duty.COMMANDS

    def is_steady(self) -> bool:
        """Return True if the bridges are heard, and were for a lease without a silence."""
        return all(bridge.is_steady() for bridge in self.bridges)

    def supervise(self) -> NoticeContent | None:
        """Start a bridge on this machine again that has ended; return an alarm of its end."""
        return next((news for bridge in self.bridges if (news := bridge.supervise()) is not None), None)

    def close(self, *, in_order: bool) -> None:
        """Tell the bridges that command ends; after an error they go on, as after a kill."""
        self.go_on = not in_order
        for bridge in self.bridges:
            bridge.close(in_order=in_order)

    # ------------------------------------------------------------ state

    @property
    def port(self) -> int:
        """Port of the first endpoint."""
        return self.bridges[0].ports()[self.links[0].name]

    def notice(self) -> NoticeContent | None:
        """Return, once, the alarm that this node sends nothing, and the news that it sends again."""
        is_without = self._ticks_without >= _TOLD_AFTER
        if is_without is self._is_told:
            return None
        self._is_told = is_without
        if is_without:
            return NoticeCode.LEASE_MISSING, {"bridges": ", ".join(self._lease.missing())}
        return NoticeCode.LEASE_AGAIN, {}

    def ground_stations(self, t_ns: int) -> dict[str, list[str]]:
        """Return the clients of each endpoint as "HOST:PORT (system/component, ...)"."""
        return reduce(or_, (bridge.ground_stations(t_ns) for bridge in self.bridges))

    def counters(self) -> dict[str, PortCounters]:
        """Return the counters of the clients' endpoints, by name."""
        return reduce(or_, (bridge.counters() for bridge in self.bridges))

    def unsent(self) -> dict[str, int]:
        """Return the number of sends that the system refused, by endpoint."""
        return reduce(or_, (bridge.unsent() for bridge in self.bridges))

    def is_keyed(self, link: str, vehicle: int | None = None) -> bool | None:
        """Return True if frames of a vehicle on a link must be signed; without a vehicle: of any system.

        None until its bridge has told it.
        """
        return self._bridge_of[link].is_keyed(link, vehicle) if link in self._bridge_of else False

    def signing_counters(self) -> Mapping[str, SigningCounters]:
        """Return the counters of signatures, by link."""
        found: dict[str, SigningCounters] = {}
        for bridge in self.bridges:
            found |= bridge.signing_counters()
        return found
