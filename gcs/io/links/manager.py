"""All MAVLink endpoints of a run: vehicles' and other ground stations', and the routes between them.

What vehicles send goes to central command as it came, but for frames that a signed link keeps out, and to the
guests whom it is for. What guests send goes to the vehicles that it is for, as far as the guests may
(`gcs.mavlink.router.router`), and what went there goes to central command as well: it must know what others
tell its vehicles. Routing happens here and not behind the queue, so that a ground station's command does not
stand in line behind scans.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final, Protocol

from gcs.endpoints import Endpoint, Link
from gcs.errors import LinkError
from gcs.geo import LocalFrame
from gcs.io.links.serial import SerialPort
from gcs.io.links.tcp import TcpIn, TcpOut
from gcs.io.links.transport import Transport
from gcs.io.links.udp import UdpIn, UdpOut
from gcs.io.signing.gate import Signing
from gcs.mavlink.fleet.heartbeat import heartbeat
from gcs.mavlink.fleet.vehicle import Address
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.router.router import PortCounters, Router
from gcs.mavlink.services.adsb import COMPONENT_ID, adsb_messages
from gcs.model import NS_PER_S, Level, Picture, network_of, system_of, vehicle_id

TRANSPORTS: Final[Mapping[str, Callable[[Endpoint], Transport]]] = {
    "udpin": UdpIn,
    "udpout": UdpOut,
    "tcp": TcpOut,
    "tcpin": TcpIn,
    "serial": SerialPort,
}
_REFUSALS_EVERY_NS: Final = 10 * NS_PER_S


class Taker(Protocol):
    """Central command's side."""

    def now_ns(self) -> int:
        """Run time."""

    def on_datagram(self, link: str, peer: str, data: bytes) -> None:
        """Take what a vehicle sent, or what was sent on to one."""

    def on_link_news(self, link: str, level: Level, text: str) -> None:
        """Take what the operator should know of a link."""


class Links:
    """Endpoints, open from the start where one listens.

    Parameters
    ----------
    links : sequence of Link
        What to open; names are distinct.
    vehicles : iterable of int
        Our vehicles.
    frame : LocalFrame
        Where the targets' tracks lie.
    signing : Signing, optional
        Checks what comes in and signs what goes out; without it no link has a key.

    Raises
    ------
    LinkError
        When a port cannot be had.
    """

    def __init__(
        self,
        links: Sequence[Link],
        vehicles: Iterable[int],
        frame: LocalFrame,
        signing: Signing | None = None,
    ) -> None:
        self.links = tuple(links)
        self.signing = signing or Signing(self.links)
        self._now_ns: Callable[[], int] = lambda: 0
        self._transports: dict[str, Transport] = {}
        self._frame = frame
        self._ports: dict[str, _Port] = {}
        self._busy: Callable[[int], bool] = lambda _: False
        self._routers = self._make_routers(tuple(vehicles))
        self._targets: Picture | None = None
        self._adsb_t_ns = self._news_t_ns = 0
        self._told: dict[tuple[str, str], int] = {}
        self._encoders: dict[tuple[int, int], Encoder] = {}
        self._time_giver = Encoder()
        try:
            for link in links:
                self._transports[link.name] = TRANSPORTS[link.endpoint.kind](link.endpoint)
        except LinkError:
            self.close()
            raise

    def _make_routers(self, vehicles: Sequence[int]) -> dict[int, Router]:
        """Make a router for each network where there is somebody to route to."""
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
        """Where the first endpoint listens."""
        return next(iter(self._transports.values())).port

    def ports(self) -> dict[str, int]:
        """Where each endpoint listens, by its name; 0 for those that do not."""
        return {name: transport.port for name, transport in self._transports.items()}

    def start(
        self, loop: asyncio.AbstractEventLoop, taker: Taker, busy: Callable[[int], bool] = lambda _: False
    ) -> None:
        """Begin to hear; `busy` tells whether a mission is on its way to a vehicle."""
        self._busy, self._now_ns = busy, taker.now_ns
        for link in self.links:
            router = self._routers.get(link.network)
            self._ports[link.name] = _Port(link, taker, router, self._send_on, self.signing)
            self._transports[link.name].start(loop, self._ports[link.name])

    def send(self, link: str, peer: str, data: bytes) -> None:
        """Send to a peer of a link."""
        transport = self._transports.get(link)
        if transport is not None and (
            sealed := self.signing.gate.sign_frames(self._now_ns(), (link, peer), data)
        ):
            transport.send(peer, sealed)

    def _send_on(self, outgoing: Mapping[Address, bytearray]) -> None:
        for (link, peer), data in outgoing.items():
            self.send(link, peer, bytes(data))

    def close(self) -> None:
        """Let go of everything."""
        for transport in self._transports.values():
            with contextlib.suppress(OSError):
                transport.close()
        self.signing.close()

    # ------------------------------------------------------------ what goes out by the clock

    def picture(self, picture: Picture) -> None:
        """Take the newest picture of the targets."""
        if picture.kind == "targets":
            self._targets = picture

    def tick(self, t_ns: int) -> None:
        """Offer the targets once a second, and say every ten what was kept back."""
        if self._targets is not None and not 0 <= t_ns - self._adsb_t_ns < NS_PER_S:
            self._adsb_t_ns = t_ns
            self._offer_targets(self._targets, t_ns)
        if not 0 <= t_ns - self._news_t_ns < _REFUSALS_EVERY_NS:
            self._news_t_ns = t_ns
            self._tell_refusals()
        for link_name, level, text in self.signing.tick(t_ns):
            if link_name in self._ports:
                self._ports[link_name].news(level, text)
        for address in self.signing.gate.take_stale_senders():
            self.send(*address, self._time_giver(heartbeat()))

    def _offer_targets(self, targets: Picture, t_ns: int) -> None:
        """As an ADS-B receiver on a vehicle does: ground stations pass over what comes from no vehicle."""
        for network, router in self._routers.items():
            wanted = {link.name for link in self.links if link.network == network and link.adsb}
            guests = [address for address in router.guests(t_ns) if address[0] in wanted]
            carriers = router.vehicles_heard(t_ns)
            if not guests or not carriers:
                continue
            encode = self._encoders.setdefault((network, carriers[0]), Encoder(carriers[0], COMPONENT_ID))
            frames = [encode(message) for message in adsb_messages(targets, self._frame, t_ns)]
            for address in guests:
                for frame in frames:
                    self.send(*address, frame)

    def _tell_refusals(self) -> None:
        for router in self._routers.values():
            for name, counters in router.counters.items():
                for reason, count in counters.refused.items():
                    new = count - self._told.get((name, reason), 0)
                    if new and name in self._ports:
                        self._told[name, reason] = count
                        self._ports[name].news("warning", f"{new} frames of guests kept back: {reason}")

    # ------------------------------------------------------------ what is known

    def guests(self, t_ns: int) -> dict[str, list[str]]:
        """Return who is connected at each guests' endpoint: "HOST:PORT (system/component, ...)"."""
        found: dict[str, list[str]] = {link.name: [] for link in self.links if link.role != "vehicles"}
        for router in self._routers.values():
            for (link, peer), ids in router.guests(t_ns).items():
                named = ", ".join(f"{system}/{component}" for system, component in ids)
                found[link].append(f"{peer} ({named})" if named else peer)
        return found

    def counters(self) -> dict[str, PortCounters]:
        """Return the counters of the guests' endpoints, by name."""
        return {name: c for router in self._routers.values() for name, c in router.counters.items()}

    def unsent(self) -> dict[str, int]:
        """Return the sends that the system would not take, by endpoint."""
        return {name: transport.refused for name, transport in self._transports.items()}


class _Port:
    """One endpoint's listener."""

    def __init__(
        self,
        link: Link,
        taker: Taker,
        router: Router | None,
        send_on: Callable[[Mapping[Address, bytearray]], None],
        signing: Signing,
    ) -> None:
        self._taker, self._router, self._send_on = taker, router, send_on
        self._name, self._is_guests = link.name, link.role != "vehicles"
        self._admit = signing.gate.admit

    def heard(self, peer: str, data: bytes) -> None:
        data = self._admit(self._taker.now_ns(), (self._name, peer), data)
        if not data:
            return
        if not self._is_guests:
            self._taker.on_datagram(self._name, peer, data)
        passed = self._route(peer, data)
        if self._is_guests and passed:
            self._taker.on_datagram(self._name, peer, passed)

    def _route(self, peer: str, data: bytes) -> bytes:
        """Send frames on to whom they are for; return those that went on."""
        router = self._router
        if router is None:
            return b""
        t_ns, address = self._taker.now_ns(), (self._name, peer)
        outgoing: dict[Address, bytearray] = {}
        passed = bytearray()
        found = scan(data)
        for frame in (*found.frames, *found.unchecked):
            to = router.take(t_ns, address, frame).to
            for destination in to:
                outgoing.setdefault(destination, bytearray()).extend(frame.data)
            if to:
                passed += frame.data
        self._send_on(outgoing)
        return bytes(passed)

    def joined(self, peer: str) -> None:
        if self._router is not None:
            self._router.joined(self._taker.now_ns(), (self._name, peer))

    def gone(self, peer: str) -> None:
        if self._router is not None:
            self._router.gone((self._name, peer))

    def news(self, level: Level, text: str) -> None:
        self._taker.on_link_news(self._name, level, text)
