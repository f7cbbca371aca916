"""Links of a run: all its MAVLink endpoints, and the routes between vehicles and other ground stations.

Vehicles' frames go to central command unchanged, except those that a signed link rejects, and to clients by
`gcs.mavlink.router.router`. Clients' frames go to vehicles, as far as their access allows, and then to
central command as well. Routing is done before the event queue, so that commands do not wait behind scans.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from gcs.endpoints import Endpoint, Link
from gcs.errors import LinkError
from gcs.geo import LocalFrame
from gcs.io.links.serial import SerialPort
from gcs.io.links.tcp import TcpIn, TcpOut
from gcs.io.links.transport import Transport
from gcs.io.links.udp import UdpIn, UdpOut
from gcs.io.links.vehicle_links import LinkHandler
from gcs.io.signing.link_signing import LinkSigning
from gcs.mavlink.fleet.heartbeat import heartbeat
from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.frames.codec import Encoder, Frame, FrameTable, scan
from gcs.mavlink.frames.signing import SigningCounters, SigningGate
from gcs.mavlink.router.router import PortCounters, Router
from gcs.mavlink.services.adsb_out import COMPONENT_ID, adsb_messages
from gcs.model import NS_PER_S, NoticeCode, Parameter, Picture, network_of, system_of, vehicle_id

TRANSPORTS: Final[Mapping[str, Callable[[Endpoint], Transport]]] = {
    "udpin": UdpIn,
    "udpout": UdpOut,
    "tcp": TcpOut,
    "tcpin": TcpIn,
    "serial": SerialPort,
}
_REFUSALS_EVERY_NS: Final = 10 * NS_PER_S


class Links:
    """Endpoints; listening ones are open from the start.

    Parameters
    ----------
    links : sequence of Link
        Endpoints to open, with distinct names.
    vehicles : iterable of int
        Our vehicles.
    frame : LocalFrame
        Frame of the target tracks.
    signing : LinkSigning, optional
        Checks incoming and signs outgoing frames; without it no link has a key.
    scan : callable
        Returns the frames of a datagram; a long run takes `gcs.mavlink.frames.fast_scan.Scanner`.
    ports : mapping, optional
        Port of a listening endpoint by name, where its own is 0.

    Raises
    ------
    LinkError
        A port cannot be opened.
    """

    def __init__(
        self,
        links: Sequence[Link],
        vehicles: Iterable[int],
        frame: LocalFrame,
        signing: LinkSigning | None = None,
        scan: Callable[[bytes], FrameTable] = scan,
        ports: Mapping[str, int] | None = None,
    ) -> None:
        self.links = tuple(links)
        ports = ports or {}
        self._scan = scan
        self.signing = signing or LinkSigning(self.links)
        self._now_ns: Callable[[], int] = lambda: 0
        self._transports: dict[str, Transport] = {}
        self._frame = frame
        self._ports: dict[str, _Port] = {}
        self._busy: Callable[[int], bool] = lambda _: False
        self._routers = self._make_routers(tuple(vehicles))
        self._targets: Picture | None = None
        self._adsb_t_ns = self._news_t_ns = 0
        self._reported: dict[tuple[str, str], int] = {}
        self._encoders: dict[tuple[int, int], Encoder] = {}
        self._heartbeat_encoder = Encoder()
        try:
            for link in links:
                endpoint = replace(link.endpoint, port=ports.get(link.name) or link.endpoint.port)
                self._transports[link.name] = TRANSPORTS[link.endpoint.kind](endpoint)
        except LinkError:
            self.close()
            raise

    def _make_routers(self, vehicles: Sequence[int]) -> dict[int, Router]:
        """Return a router for each network with more than one link."""
        routers = {}
        for network in {link.network for link in self.links}:
            here = [link for link in self.links if link.network == network]
            if len(here) > 1:
                ids = [system_of(vehicle) for vehicle in vehicles if network_of(vehicle) == network]
                routers[network] = Router(
                    here, ids, self._busy_on(network), is_keyed=self.signing.gate.is_keyed
                )
        return routers

    def _busy_on(self, network: int) -> Callable[[int], bool]:
        return lambda system_id: self._busy(vehicle_id(network, system_id))

    @property
    def port(self) -> int:
        """Port of the first endpoint."""
        return next(iter(self._transports.values())).port

    def ports(self) -> dict[str, int]:
        """Return the port of each endpoint by name; 0 for those that do not listen."""
        return {name: transport.port for name, transport in self._transports.items()}

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        handler: LinkHandler,
        busy: Callable[[int], bool] = lambda _: False,
    ) -> None:
        """Start all endpoints; `busy` returns True during a mission transfer to a vehicle."""
        self._busy = busy
        self._now_ns = handler.now_ns
        for link in self.links:
            router = self._routers.get(link.network)
            self._ports[link.name] = _Port(
                link, handler, router, self._forward, self.signing.gate, self._scan
            )
            self._transports[link.name].start(loop, self._ports[link.name])

    def send(self, link: str, peer: str, data: bytes) -> None:
        """Send to a peer of a link."""
        if self.signing.gate.is_keyed(link):
            self._forward({(link, peer): self._scan(data)})
        elif link in self._transports:
            self._transports[link].send(peer, data)

    def _forward(self, outgoing: Mapping[Address, Iterable[Frame]]) -> None:
        """Send frames to addresses, signed where there is a key."""
        for (link, peer), frames in outgoing.items():
            data = self.signing.gate.sign_frames(self._now_ns(), (link, peer), frames)
            if data and link in self._transports:
                self._transports[link].send(peer, data)

    def close(self, *, in_order: bool = True) -> None:  # noqa: ARG002  they end in any case
        """Close all endpoints."""
        for transport in self._transports.values():
            with contextlib.suppress(OSError):
                transport.close()
        self.signing.close()

    # ------------------------------------------------------------ timers

    def picture(self, picture: Picture) -> None:
        """Set the newest picture of the targets."""
        if picture.kind == "targets":
            self._targets = picture

    def tick(self, t_ns: int) -> None:
        """Send targets as ADS-B once a second; report refused frames every ten."""
        if self._targets is not None and not 0 <= t_ns - self._adsb_t_ns < NS_PER_S:
            self._adsb_t_ns = t_ns
            self._send_adsb(self._targets, t_ns)
        if not 0 <= t_ns - self._news_t_ns < _REFUSALS_EVERY_NS:
            self._news_t_ns = t_ns
            self._report_refusals()
        for link_name, (code, parameters) in self.signing.tick(t_ns):
            if link_name in self._ports:
                self._ports[link_name].notify(code, **parameters)
        for address in self.signing.gate.take_stale_senders(t_ns):
            self.send(*address, self._heartbeat_encoder(heartbeat()))

    def _send_adsb(self, targets: Picture, t_ns: int) -> None:
        """Send targets under a vehicle's system id, as its ADS-B receiver would.

        Ground stations ignore other senders.
        """
        for network, router in self._routers.items():
            wanted = {link.name for link in self.links if link.network == network and link.adsb}
            clients = [address for address in router.clients(t_ns) if address[0] in wanted]
            carriers = router.vehicles_heard(t_ns)
            if not clients or not carriers:
                continue
            encode = self._encoders.setdefault((network, carriers[0]), Encoder(carriers[0], COMPONENT_ID))
            frames = [encode(message) for message in adsb_messages(targets, self._frame, t_ns)]
            for address in clients:
                for frame in frames:
                    self.send(*address, frame)

    def _report_refusals(self) -> None:
        for router in self._routers.values():
            for name, counters in router.counters.items():
                for reason, count in counters.refused.items():
                    new = count - self._reported.get((name, reason), 0)
                    if new and name in self._ports:
                        self._reported[name, reason] = count
                        self._ports[name].notify(NoticeCode.STATION_REFUSED, count=new, reason=reason)

    # ------------------------------------------------------------ state

    def commander(self) -> str:
        """Return an empty name: no other node uses these endpoints."""
        return ""

    def may_command(self) -> bool:
        """Return True: no other node uses these endpoints."""
        return True

    def ask_for_lease(self) -> None:
        """Do nothing: there is no lease."""

    def ground_stations(self, t_ns: int) -> dict[str, list[str]]:
        """Return the clients of each endpoint as "HOST:PORT (system/component, ...)"."""
        found: dict[str, list[str]] = {link.name: [] for link in self.links if link.role != "vehicles"}
        for router in self._routers.values():
            for (link, peer), ids in router.clients(t_ns).items():
                named = ", ".join(f"{system}/{component}" for system, component in ids)
                found[link].append(f"{peer} ({named})" if named else peer)
        return found

    def counters(self) -> dict[str, PortCounters]:
        """Return the counters of the clients' endpoints, by name."""
        return {name: c for router in self._routers.values() for name, c in router.counters.items()}

    def unsent(self) -> dict[str, int]:
        """Return the number of sends that the system refused, by endpoint."""
        return {name: transport.refused for name, transport in self._transports.items()}

    def is_keyed(self, link: str, vehicle: int | None = None) -> bool:
        """Return True if frames of a vehicle on a link must be signed; without a vehicle: of any system."""
        return self.signing.gate.is_keyed(link, None if vehicle is None else system_of(vehicle))

    def signing_counters(self) -> Mapping[str, SigningCounters]:
        """Return the counters of signatures, by link."""
        return self.signing.gate.counters


class _Port:
    """Listener of one endpoint."""

    def __init__(
        self,
        link: Link,
        handler: LinkHandler,
        router: Router | None,
        forward: Callable[[Mapping[Address, Iterable[Frame]]], None],
        gate: SigningGate,
        scan: Callable[[bytes], FrameTable],
    ) -> None:
        self._handler = handler
        self._router = router
        self._forward = forward
        self._name = link.name
        self._is_for_clients = link.role != "vehicles"
        self._gate = gate
        self._scan = scan

    def heard(self, peer: str, data: bytes) -> None:
        frames = self._scan(data)
        frames = self._part(
            frames, self._gate.accept_frames(self._handler.now_ns(), (self._name, peer), frames)
        )
        if not frames.data:
            return
        if not self._is_for_clients:
            self._handler.on_datagram(self._name, peer, frames)
        passed = self._route(peer, frames)
        if self._is_for_clients and passed:
            self._handler.on_datagram(self._name, peer, self._part(frames, passed))

    def _part(self, frames: FrameTable, data: bytes) -> FrameTable:
        """Return the frames of a part of a datagram, mostly the whole."""
        return frames if data == frames.data else self._scan(data)

    def _route(self, peer: str, frames: FrameTable) -> bytes:
        """Send frames to their targets; return those that were sent on."""
        router = self._router
        if router is None:
            return b""
        t_ns = self._handler.now_ns()
        address = (self._name, peer)
        outgoing: dict[Address, list[Frame]] = {}
        passed = bytearray()
        for frame in frames:
            to = router.route_frame(t_ns, address, frame).to
            for destination in to:
                outgoing.setdefault(destination, []).append(frame)
            if to:
                passed += frame.data
        self._forward(outgoing)
        return bytes(passed)

    def connected(self, peer: str) -> None:
        if self._router is not None:
            self._router.add_connection(self._handler.now_ns(), (self._name, peer))

    def disconnected(self, peer: str) -> None:
        if self._router is not None:
            self._router.remove_connection((self._name, peer))

    def notify(self, code: NoticeCode, /, **parameters: Parameter) -> None:
        self._handler.on_notice(self._name, code, **parameters)
