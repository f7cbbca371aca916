"""Routes between the vehicles of one MAVLink network and other ground stations, here called *clients*.

As mavlink-router (https://mavlink.io/en/guide/routing.html): by a frame's target system and component,
learned from where these were heard. Additional rules for swarms on hostile networks:

* Vehicles' frames without a target go to all clients, not to other vehicles: that would grow with the square
  of the swarm. Clients do not see each other. A frame for a target goes to where that target is known, or
  nowhere.
* A vehicle's component has one address (`gcs.mavlink.fleet.address_learning`). Frames of it from another
  address are refused.
* A client that uses a vehicle's system id or our ids is a loop or an impostor: refused.
* A client's HEARTBEAT is not forwarded: a vehicle's GCS failsafe watches central command alone.
* A frame never returns to its sender. A client's frame that comes again from another address within two
  seconds is a duplicate: a command must not be done twice.
* A UDP client gets telemetry after two heartbeats at least half a second apart: a datagram with a forged
  sender has no effect. Before, it gets the answers to its own requests. It expires after ten seconds
  without a frame.
* Clients, and the ids of each, are bounded. On a full endpoint a new client replaces one not heard for
  five seconds, or one of the host with the most clients. Else it waits.
* `gcs.mavlink.router.access_policy` decides what clients may send.

Pure: frames in, addresses out. The caller receives and checks frames. Nothing raises on any frame.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link
from gcs.mavlink.fleet.address_learning import Contact, move_of, signed_lead_ns
from gcs.mavlink.fleet.high_latency import is_high_latency
from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.fleet.standby_link import is_second_path
from gcs.mavlink.frames.codec import OWN_IDS, Frame, target_of
from gcs.mavlink.router import access_policy
from gcs.mavlink.services.retry import ns

Id: TypeAlias = tuple[int, int]
"""(system, component)."""

_HEARTBEAT: Final[int] = dialect.MAVLINK_MSG_ID_HEARTBEAT
_MAX_RECENT_FRAMES: Final = 4096
_EXPIRE_EVERY_NS: Final = ns(0.5)
_MAX_CANDIDATES: Final = 4096
_MIN_HEARTBEATS: Final = 2
"""Heartbeats before a UDP client gets telemetry."""
_MIN_HEARTBEAT_INTERVAL_NS: Final = ns(0.5)
_DUPLICATE_WINDOW_NS: Final = ns(2.0)
_CLIENT_TIMEOUT_NS: Final = ns(10.0)
"""Time without a frame after which a UDP client expires."""
_CLIENT_IDLE_NS: Final = ns(5.0)
"""Time without a frame after which a client may be replaced."""
_MAX_CLIENTS: Final = 32
"""On one endpoint."""
_MAX_IDS: Final = 16
"""System and component ids of one client."""


class Routed(NamedTuple):
    """Destinations of a frame, and why it goes no further."""

    to: tuple[Address, ...]
    refusal: str = ""


@dataclass(slots=True)
class PortCounters:
    """Counters of one endpoint for other ground stations."""

    frames: int = 0
    """Complete frames received from clients."""
    passed: int = 0
    """Of these, sent on to vehicles."""
    sent: int = 0
    """Vehicles' frames sent to clients there, each client counted."""
    refused: dict[str, int] = field(default_factory=Counter)
    """Frames refused, by reason."""


@dataclass(slots=True)
class _Client:
    heard_t_ns: int
    is_permanent: bool
    """True if it never expires: it is connected, or the endpoint's one peer."""
    ids: dict[Id, int] = field(default_factory=dict)
    """Time of the last frame with each of its ids."""
    heartbeats: int = 0
    """Heartbeats so far, without those too soon after another."""
    heartbeat_t_ns: int = 0


class Router:
    """Routes of one network.

    Parameters
    ----------
    links : sequence of Link
        Of this network.
    vehicles : iterable of int
        System ids of our vehicles there.
    is_busy : callable
        Returns True during our mission transfer to the vehicle of a system id.
    is_keyed : callable
        Returns True for a link's name and a system id if their signatures are checked.
    """

    def __init__(
        self,
        links: Sequence[Link],
        vehicles: Iterable[int],
        is_busy: Callable[[int], bool] = lambda _: False,
        *,
        is_keyed: Callable[[str, int], bool] = lambda _, __: False,
    ) -> None:
        self._is_keyed = is_keyed
        self._links = {link.name: link for link in links}
        self._redundant = frozenset(link.name for link in links if link.redundant)
        self._vehicles = frozenset(vehicles)
        self._is_busy = is_busy
        self._contacts: dict[Id, Contact] = {}
        self._clients: dict[Address, _Client] = {}
        self._candidates: dict[Address, _Client] = {}
        """Senders that are not clients yet, those heard the longest ago first."""
        self._recent_frames: dict[bytes, tuple[Address, int]] = {}
        self._expired_t_ns = 0
        self.counters = {link.name: PortCounters() for link in links if link.role != "vehicles"}
        for link in links:
            if link.role != "vehicles" and link.endpoint.remote:
                self._clients[link.name, link.endpoint.remote] = _Client(0, is_permanent=True)

    # ------------------------------------------------------------ frames

    def route_frame(self, t_ns: int, address: Address, frame: Frame) -> Routed:
        """Return where a frame from `address` goes."""
        link = self._links.get(address[0])
        if link is None:
            return Routed((), "unknown link")
        if link.role == "vehicles":
            return self._from_vehicle(t_ns, address, frame)
        counters = self.counters[link.name]
        counters.frames += 1
        routed = self._from_client(t_ns, address, frame, link)
        counters.passed += bool(routed.to)
        if routed.refusal:
            counters.refused[routed.refusal] += 1
        return routed

    def _from_vehicle(self, t_ns: int, address: Address, frame: Frame) -> Routed:
        if frame.system_id not in self._vehicles:
            return Routed((), "unknown system")
        id_ = (frame.system_id, frame.component_id)
        contact = self._contacts.get(id_)
        if contact is not None and contact.address == address:
            contact.heard_t_ns = t_ns
            contact.is_slow &= frame.message_id != _HEARTBEAT
        else:
            is_keyed = self._is_keyed(address[0], frame.system_id)
            may_move = contact is not None and is_second_path(contact.address, address, self._redundant)
            move = move_of(frame, t_ns, contact, is_keyed=is_keyed, is_second_path=may_move)
            if move in ("heard elsewhere", "no heartbeat"):
                return Routed((), move)
            self._contacts[id_] = Contact(address, t_ns, signed_lead_ns(frame, t_ns), is_high_latency(frame))
        system, component = target_of(frame) or (0, 0)
        if system in self._vehicles:
            return self._to_vehicle(t_ns, address, system, component)
        to = self._recipients(t_ns, system, component)
        for link_name, _ in to:
            self.counters[link_name].sent += 1
        return Routed(to)

    def _from_client(self, t_ns: int, address: Address, frame: Frame, link: Link) -> Routed:
        if frame.system_id in self._vehicles:
            return Routed((), "uses a vehicle's system id")
        if (frame.system_id, frame.component_id) == OWN_IDS:
            return Routed((), "uses central command's ids")
        refusal = self._update_client(t_ns, address, frame)
        if refusal:
            return Routed((), refusal)
        if frame.message_id == _HEARTBEAT:
            return Routed(())
        system, component = target_of(frame) or (0, 0)
        if system and system not in self._vehicles:
            return Routed((), "" if system == OWN_IDS[0] else "for an unknown target")
        refusal = access_policy.refusal(
            link.role, frame, system, is_busy=bool(system) and self._is_busy(system)
        )
        if refusal:
            return Routed((), refusal)
        if self._note_duplicate(t_ns, address, frame):
            return Routed((), "duplicate")
        if system:
            return self._to_vehicle(t_ns, address, system, component)
        return Routed(self._addresses(t_ns, lambda _: True, exclude=address))

    def _to_vehicle(self, t_ns: int, source: Address, system: int, component: int) -> Routed:
        """Route to one component, or to all of a vehicle's if it is unknown."""
        contact = self._contacts.get((system, component))
        if contact is not None and not contact.has_timed_out(t_ns):
            to: tuple[Address, ...] = (contact.address,) if contact.address != source else ()
        else:
            to = self._addresses(t_ns, lambda id_: id_[0] == system, exclude=source)
        return Routed(to, "" if to else "for a vehicle that is not heard")

    def _addresses(
        self, t_ns: int, is_wanted: Callable[[Id], bool], *, exclude: Address
    ) -> tuple[Address, ...]:
        """Return the addresses of vehicles' components, each once."""
        found = {
            contact.address: None
            for id_, contact in self._contacts.items()
            if is_wanted(id_) and contact.address != exclude and not contact.has_timed_out(t_ns)
        }
        return tuple(found)

    # ------------------------------------------------------------ clients

    def add_connection(self, t_ns: int, address: Address) -> None:
        """Add a connected client: it stays until it disconnects, even if it sends nothing."""
        link = self._links.get(address[0])
        if link is not None and link.role != "vehicles" and self._ensure_capacity(t_ns, address):
            self._clients.setdefault(address, _Client(t_ns, is_permanent=True))

    def remove_connection(self, address: Address) -> None:
        """Remove a client that disconnected, unless it is an endpoint's one peer."""
        link = self._links.get(address[0])
        if link is not None and address[1] == link.endpoint.remote:
            return
        self._clients.pop(address, None)
        self._candidates.pop(address, None)

    def clients(self, t_ns: int) -> dict[Address, tuple[Id, ...]]:
        """Return the clients that get telemetry, with their ids."""
        self._expire(t_ns)
        return {address: tuple(sorted(client.ids)) for address, client in self._clients.items()}

    def vehicles_heard(self, t_ns: int) -> tuple[int, ...]:
        """Return the system ids of the vehicles that are heard now, in order."""
        heard = {id_[0] for id_, contact in self._contacts.items() if not contact.has_timed_out(t_ns)}
        return tuple(sorted(heard))

    def _ensure_capacity(self, t_ns: int, new_address: Address) -> bool:
        """Return True if a client fits on its endpoint, if need be by removing another."""
        here = {address: client for address, client in self._clients.items() if address[0] == new_address[0]}
        if new_address in here or len(here) < _MAX_CLIENTS:
            return True
        hosts = Counter(_host(address) for address in here)
        may_go = {address: client for address, client in here.items() if not client.is_permanent}
        if not may_go:
            return False
        longest_idle = min(may_go, key=lambda address: may_go[address].heard_t_ns)
        crowded = max(reversed(may_go), key=lambda address: hosts[_host(address)])
        if t_ns - may_go[longest_idle].heard_t_ns > _CLIENT_IDLE_NS:
            del self._clients[longest_idle]
        elif hosts[_host(crowded)] > hosts[_host(new_address)] + 1:
            del self._clients[crowded]
        else:
            return False
        return True

    def _update_client(self, t_ns: int, address: Address, frame: Frame) -> str:
        """Add or refresh a client; return why it is refused."""
        id_ = (frame.system_id, frame.component_id)
        client = self._clients.get(address)
        if client is None:
            client = self._candidates.pop(address, None) or _Client(t_ns, is_permanent=False)
            if frame.message_id == _HEARTBEAT and (
                not client.heartbeats or t_ns - client.heartbeat_t_ns >= _MIN_HEARTBEAT_INTERVAL_NS
            ):
                client.heartbeats = client.heartbeats + 1
                client.heartbeat_t_ns = t_ns
            if client.heartbeats >= _MIN_HEARTBEATS and self._ensure_capacity(t_ns, address):
                self._clients[address] = client
            else:
                self._candidates[address] = client
                if len(self._candidates) > _MAX_CANDIDATES:
                    del self._candidates[next(iter(self._candidates))]
            if client.heartbeats >= _MIN_HEARTBEATS and address not in self._clients:
                return "too many ground stations"
        client.heard_t_ns = t_ns
        if id_ not in client.ids and len(client.ids) >= _MAX_IDS:
            self._forget_ids(client, t_ns)
            if len(client.ids) >= _MAX_IDS:
                return "too many ids"
        client.ids[id_] = t_ns
        return ""

    def _expire(self, t_ns: int) -> None:
        self._expired_t_ns = t_ns
        for known in (self._clients, self._candidates):
            for address, client in list(known.items()):
                if not client.is_permanent and t_ns - client.heard_t_ns > _CLIENT_TIMEOUT_NS:
                    del known[address]
                else:
                    self._forget_ids(client, t_ns)

    def _forget_ids(self, client: _Client, t_ns: int) -> None:
        client.ids = {id_: heard for id_, heard in client.ids.items() if t_ns - heard <= _CLIENT_TIMEOUT_NS}

    def _recipients(self, t_ns: int, system: int, component: int) -> tuple[Address, ...]:
        """Return the clients that a vehicle's frame is for: all, or those with the target id."""
        if abs(t_ns - self._expired_t_ns) >= _EXPIRE_EVERY_NS:
            self._expire(t_ns)
        if system == 0:
            return tuple(self._clients)
        if (system, component) == OWN_IDS:
            return ()
        known = [*self._clients.items(), *self._candidates.items()]
        exact = tuple(a for a, client in known if (system, component) in client.ids)
        if exact or component:
            return exact
        return tuple(a for a, client in known if any(id_[0] == system for id_ in client.ids))

    def _note_duplicate(self, t_ns: int, address: Address, frame: Frame) -> bool:
        """Note a frame; return True if it came from another address just before."""
        first, first_t_ns = self._recent_frames.get(frame.data, (address, t_ns))
        young = t_ns - first_t_ns <= _DUPLICATE_WINDOW_NS
        if first != address and young:
            return True
        self._recent_frames.pop(frame.data, None)
        self._recent_frames[frame.data] = (address, t_ns)
        while len(self._recent_frames) > _MAX_RECENT_FRAMES:
            del self._recent_frames[next(iter(self._recent_frames))]
        return False


def _host(address: Address) -> str:
    return address[1].rpartition(":")[0]
