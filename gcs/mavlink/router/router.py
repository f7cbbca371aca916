"""Who gets a frame: the routes between the vehicles of one MAVLink network and other ground stations.

As mavlink-router does it (https://mavlink.io/en/guide/routing.html): by the system and component that a
frame is for, learned from where these were heard. On top of it a swarm on hostile networks needs rules of
its own:

* There are two sides. Vehicles' frames for nobody in particular go to all guests (other ground stations),
  not to other vehicles: on one radio that grows with the square of the swarm. Guests see vehicles, not each
  other. Frames for somebody go to where that somebody is known, and nowhere else; to nobody when unknown.
* A vehicle's component has one place, learned from its HEARTBEAT and kept while it is heard there. What
  claims to come from it at another address is kept out: a duplicate by another way, or an impostor. Where
  signatures are checked, it moves at once to where its heartbeats are signed later.
* A guest that speaks with a vehicle's system id, or with our own ids, is a loop or an impostor: kept out.
* A guest's HEARTBEAT stays here: a vehicle's ground-station failsafe watches central command alone.
* A frame goes never back to where it came from, and a guest's frame that comes again from another address
  within two seconds is a duplicate: a command must not be done twice.
* A guest on UDP gets telemetry after two heartbeats, half a second apart or more: one datagram with an
  invented sender buys nothing. Before, it gets answers to its own questions, frame for frame. It is
  forgotten after ten seconds of silence.
* Guests, and the ids that each may speak with, are bounded. When an endpoint is full, a guest that was
  silent for five seconds goes, or one of the host with the most guests. Else newcomers wait.
* What guests may send is decided in `gcs.mavlink.router.access_policy`.

Pure: frames in, addresses out, time an argument. What it works on is (sender, target, raw bytes): where
frames come from, and who checks them, is the caller's. Nothing here raises on any frame.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link
from gcs.mavlink.fleet.vehicle import Address
from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Frame, target_of
from gcs.mavlink.frames.signing import MIN_SIGNED_LATER_NS, signed_t_ns
from gcs.mavlink.router import access_policy
from gcs.mavlink.services.retry import ns

Id: TypeAlias = tuple[int, int]
"""(system, component)."""

_HEARTBEAT: Final[int] = dialect.MAVLINK_MSG_ID_HEARTBEAT
_MAX_REMEMBERED: Final = 4096
_EXPIRE_EVERY_NS: Final = ns(0.5)
_MAX_NEWCOMERS: Final = 4096
_BEATS: Final = 2
"""Heartbeats after which a guest on UDP gets telemetry."""
_BEATS_APART_NS: Final = ns(0.5)
_IDLE_NS: Final = ns(5.0)
"""Silence after which a guest gives its place to another one."""


@dataclass(frozen=True, slots=True)
class RoutingSettings:
    """Times and bounds."""

    vehicle_silent_s: float = 5.0
    """Silence after which a vehicle's component may be heard elsewhere."""
    guest_silent_s: float = 10.0
    """Silence after which a guest on UDP is forgotten."""
    duplicate_s: float = 2.0
    max_guests: int = 32
    """On one endpoint."""
    max_ids: int = 16
    """That one guest may speak with."""


class Routed(NamedTuple):
    """Where a frame goes, and why it does not go further."""

    to: tuple[Address, ...]
    refusal: str = ""


@dataclass(slots=True)
class PortCounters:
    """What came through one guests' endpoint."""

    frames: int = 0
    """Whole frames heard from guests."""
    passed: int = 0
    """Of these, sent on to vehicles."""
    sent: int = 0
    """Frames of vehicles sent to guests there, each guest counted."""
    refused: Counter[str] = field(default_factory=Counter)
    """Frames kept back, by reason."""


@dataclass(slots=True)
class _Place:
    address: Address
    heard_t_ns: int
    signed_ns: int | None
    """Time in the signature of its last frame; None when that was not signed."""


@dataclass(slots=True)
class _Guest:
    heard_t_ns: int
    stays: bool
    """Whether silence does not end it: it is connected, or it is the endpoint's one peer."""
    ids: dict[Id, int] = field(default_factory=dict)
    """When it last spoke with each of its ids."""
    beats: int = 0
    """Heartbeats so far, those too soon after another not counted."""
    beat_t_ns: int = 0


class Router:
    """The routes of one network.

    Parameters
    ----------
    links : sequence of Link
        Of this network.
    vehicles : iterable of int
        System ids of our vehicles there.
    is_busy : callable
        Whether a mission of ours is on its way to the vehicle of a system id.
    own : (int, int)
        Our system and component id.
    is_keyed : callable
        True for a link's name and a system id if their frames come here with checked signatures.
    """

    def __init__(
        self,
        links: Sequence[Link],
        vehicles: Iterable[int],
        is_busy: Callable[[int], bool] = lambda _: False,
        settings: RoutingSettings | None = None,
        *,
        own: Id = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
        is_keyed: Callable[[str, int], bool] = lambda _, __: False,
    ) -> None:
        self._is_keyed = is_keyed
        self._links = {link.name: link for link in links}
        self._vehicles = frozenset(vehicles)
        self._is_busy = is_busy
        self._own = own
        self._settings = settings or RoutingSettings()
        self._places: dict[Id, _Place] = {}
        self._guests: dict[Address, _Guest] = {}
        self._newcomers: dict[Address, _Guest] = {}
        """Senders that have not shown yet that they stay, in the order in which they were last heard."""
        self._seen: dict[bytes, tuple[Address, int]] = {}
        self._expired_t_ns = 0
        self.counters = {link.name: PortCounters() for link in links if link.role != "vehicles"}
        for link in links:
            if link.role != "vehicles" and link.endpoint.remote:
                self._guests[link.name, link.endpoint.remote] = _Guest(0, stays=True)

    # ------------------------------------------------------------ frames

    def take(self, t_ns: int, address: Address, frame: Frame) -> Routed:
        """Return where a frame that came from `address` goes."""
        link = self._links.get(address[0])
        if link is None:
            return Routed((), "unknown link")
        if link.role == "vehicles":
            return self._from_vehicle(t_ns, address, frame)
        counters = self.counters[link.name]
        counters.frames += 1
        routed = self._from_guest(t_ns, address, frame, link)
        counters.passed += bool(routed.to)
        if routed.refusal:
            counters.refused[routed.refusal] += 1
        return routed

    def _from_vehicle(self, t_ns: int, address: Address, frame: Frame) -> Routed:
        if frame.system_id not in self._vehicles:
            return Routed((), "unknown system")
        id_ = (frame.system_id, frame.component_id)
        place = self._places.get(id_)
        signed_ns = signed_t_ns(frame)
        moves = place is not None and place.address != address and self._may_move(place, t_ns, frame, address)
        if place is None or moves:
            if frame.message_id != _HEARTBEAT:
                return Routed((), "no heartbeat yet")
            self._places[id_] = _Place(address, t_ns, signed_ns)
        elif place.address != address:
            return Routed((), "is heard elsewhere")
        else:
            place.heard_t_ns, place.signed_ns = t_ns, signed_ns
        system, component = target_of(frame) or (0, 0)
        if system in self._vehicles:
            return self._to_vehicle(t_ns, address, system, component)
        to = self._guests_to_hear(t_ns, system, component)
        for link_name, _ in to:
            self.counters[link_name].sent += 1
        return Routed(to)

    def _from_guest(self, t_ns: int, address: Address, frame: Frame, link: Link) -> Routed:
        if frame.system_id in self._vehicles:
            return Routed((), "speaks with a vehicle's system id")
        if (frame.system_id, frame.component_id) == self._own:
            return Routed((), "speaks with central command's ids")
        refusal = self._meet(t_ns, address, frame)
        if refusal:
            return Routed((), refusal)
        if frame.message_id == _HEARTBEAT:
            return Routed(())
        system, component = target_of(frame) or (0, 0)
        if system and system not in self._vehicles:
            return Routed((), "" if system == self._own[0] else "for somebody unknown")
        refusal = access_policy.refusal(
            link.role, frame, system, is_busy=bool(system) and self._is_busy(system)
        )
        if refusal:
            return Routed((), refusal)
        if self._is_again(t_ns, address, frame):
            return Routed((), "duplicate")
        if system:
            return self._to_vehicle(t_ns, address, system, component)
        return Routed(self._addresses(t_ns, lambda _: True, but=address))

    def _to_vehicle(self, t_ns: int, source: Address, system: int, component: int) -> Routed:
        """Route to one component, or to all of a vehicle's when that one is not known."""
        place = self._places.get((system, component))
        if place is not None and not self._is_silent(place, t_ns):
            to: tuple[Address, ...] = (place.address,) if place.address != source else ()
        else:
            to = self._addresses(t_ns, lambda id_: id_[0] == system, but=source)
        return Routed(to, "" if to else "for a vehicle that is not heard")

    def _addresses(self, t_ns: int, wanted: Callable[[Id], bool], *, but: Address) -> tuple[Address, ...]:
        """Addresses of vehicles' components, each once."""
        found = {
            place.address: None
            for id_, place in self._places.items()
            if wanted(id_) and place.address != but and not self._is_silent(place, t_ns)
        }
        return tuple(found)

    def _may_move(self, place: _Place, t_ns: int, frame: Frame, address: Address) -> bool:
        """Return True if a component may be heard elsewhere: silent so far, or signed later there."""
        if self._is_silent(place, t_ns):
            return True
        signed_ns = signed_t_ns(frame)
        if signed_ns is None or place.signed_ns is None or frame.message_id != _HEARTBEAT:
            return False
        later = signed_ns - place.signed_ns > MIN_SIGNED_LATER_NS
        return later and self._is_keyed(address[0], frame.system_id)

    def _is_silent(self, place: _Place, t_ns: int) -> bool:
        return t_ns - place.heard_t_ns > ns(self._settings.vehicle_silent_s)

    # ------------------------------------------------------------ guests

    def joined(self, t_ns: int, address: Address) -> None:
        """Note that somebody connected: it is a guest until it is gone, even when it says nothing."""
        link = self._links.get(address[0])
        if link is not None and link.role != "vehicles" and self._make_room(t_ns, address):
            self._guests.setdefault(address, _Guest(t_ns, stays=True))

    def gone(self, address: Address) -> None:
        """Forget somebody whose connection ended, unless it is an endpoint's one peer."""
        link = self._links.get(address[0])
        if link is not None and address[1] == link.endpoint.remote:
            return
        self._guests.pop(address, None)
        self._newcomers.pop(address, None)

    def guests(self, t_ns: int) -> dict[Address, tuple[Id, ...]]:
        """Return the guests that get telemetry, and with which ids each speaks."""
        self._expire(t_ns)
        return {address: tuple(sorted(guest.ids)) for address, guest in self._guests.items()}

    def vehicles_heard(self, t_ns: int) -> tuple[int, ...]:
        """System ids of the vehicles that have a place now, in order."""
        heard = {id_[0] for id_, place in self._places.items() if not self._is_silent(place, t_ns)}
        return tuple(sorted(heard))

    def _make_room(self, t_ns: int, newcomer: Address) -> bool:
        """Return True if there is room for a guest on its endpoint, if need be by forgetting another."""
        here = {address: guest for address, guest in self._guests.items() if address[0] == newcomer[0]}
        if newcomer in here or len(here) < self._settings.max_guests:
            return True
        hosts = Counter(_host(address) for address in here)
        may_go = {address: guest for address, guest in here.items() if not guest.stays}
        if not may_go:
            return False
        idlest = min(may_go, key=lambda address: may_go[address].heard_t_ns)
        crowded = max(reversed(may_go), key=lambda address: hosts[_host(address)])
        if t_ns - may_go[idlest].heard_t_ns > _IDLE_NS:
            del self._guests[idlest]
        elif hosts[_host(crowded)] > hosts[_host(newcomer)] + 1:
            del self._guests[crowded]
        else:
            return False
        return True

    def _meet(self, t_ns: int, address: Address, frame: Frame) -> str:
        """Learn or refresh a guest; say why it is kept out."""
        id_, guest = (frame.system_id, frame.component_id), self._guests.get(address)
        if guest is None:
            guest = self._newcomers.pop(address, None) or _Guest(t_ns, stays=False)
            if frame.message_id == _HEARTBEAT and (
                not guest.beats or t_ns - guest.beat_t_ns >= _BEATS_APART_NS
            ):
                guest.beats, guest.beat_t_ns = guest.beats + 1, t_ns
            if guest.beats >= _BEATS and self._make_room(t_ns, address):
                self._guests[address] = guest
            else:
                self._newcomers[address] = guest
                if len(self._newcomers) > _MAX_NEWCOMERS:
                    del self._newcomers[next(iter(self._newcomers))]
            if guest.beats >= _BEATS and address not in self._guests:
                return "too many guests"
        guest.heard_t_ns = t_ns
        if id_ not in guest.ids and len(guest.ids) >= self._settings.max_ids:
            self._forget_ids(guest, t_ns)
            if len(guest.ids) >= self._settings.max_ids:
                return "too many ids"
        guest.ids[id_] = t_ns
        return ""

    def _expire(self, t_ns: int) -> None:
        self._expired_t_ns = t_ns
        silent_ns = ns(self._settings.guest_silent_s)
        for known in (self._guests, self._newcomers):
            for address, guest in list(known.items()):
                if not guest.stays and t_ns - guest.heard_t_ns > silent_ns:
                    del known[address]
                else:
                    self._forget_ids(guest, t_ns)

    def _forget_ids(self, guest: _Guest, t_ns: int) -> None:
        silent_ns = ns(self._settings.guest_silent_s)
        guest.ids = {id_: heard for id_, heard in guest.ids.items() if t_ns - heard <= silent_ns}

    def _guests_to_hear(self, t_ns: int, system: int, component: int) -> tuple[Address, ...]:
        """Return the guests that a vehicle's frame is for: all, or those that speak with that id."""
        if abs(t_ns - self._expired_t_ns) >= _EXPIRE_EVERY_NS:
            self._expire(t_ns)
        if system == 0:
            return tuple(self._guests)
        if (system, component) == self._own:
            return ()
        known = [*self._guests.items(), *self._newcomers.items()]
        exact = tuple(a for a, guest in known if (system, component) in guest.ids)
        if exact or component:
            return exact
        return tuple(a for a, guest in known if any(id_[0] == system for id_ in guest.ids))

    def _is_again(self, t_ns: int, address: Address, frame: Frame) -> bool:
        """Whether the same frame came from another address just before."""
        first, first_t_ns = self._seen.get(frame.data, (address, t_ns))
        young = t_ns - first_t_ns <= ns(self._settings.duplicate_s)
        if first != address and young:
            return True
        self._seen.pop(frame.data, None)
        self._seen[frame.data] = (address, t_ns)
        while len(self._seen) > _MAX_REMEMBERED:
            del self._seen[next(iter(self._seen))]
        return False


def _host(address: Address) -> str:
    return address[1].rpartition(":")[0]
