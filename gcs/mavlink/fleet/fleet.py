"""The vehicles on our links, by network and system id: whose frames to believe, who is alive, what to ask.

Sans-I/O: datagrams in, `Send` and `Notice` out, time an argument. Where a vehicle is an argument it is called
by its number (`gcs.model.vehicle_id`), which on network 0 is its system id.

* A vehicle is one of the expected system ids on the network of its link. Frames of all others (other ground
  stations too) are strangers: counted up to a bound on memory, shown, and never acted on.
* Where nobody calls us (an endpoint that does not listen) we call: heartbeats, four a second.
* Its address is learned from a HEARTBEAT of its own autopilot (component 1, a real autopilot type) and kept:
  while the vehicle is heard there, another address that claims its id is a conflict, counted and ignored.
  After a silence it may move, and at once to where it signs later than at its address. Nothing is ever
  sent to an address that has not been learned so.
* Liveness is the age of the last frame of its autopilot, per system id: never that of a link. A single lost
  heartbeat says little on a bad radio, a silence of seconds on all its messages does.
* Only ids that somebody here needs are unpacked; the others count for loss and liveness.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link
from gcs.geo import LocalFrame
from gcs.mavlink.autopilots import AutopilotProfile
from gcs.mavlink.fleet.heartbeat import heartbeat, is_heartbeat, is_vehicles
from gcs.mavlink.fleet.link_stats import LinkCounters, UnknownSystem, UnknownSystems, total
from gcs.mavlink.fleet.notice_queue import NoticeQueue
from gcs.mavlink.fleet.peers import Peers
from gcs.mavlink.fleet.stream_requests import StreamRequests
from gcs.mavlink.fleet.telemetry_table import (
    ADDRESS,
    BOOT_OFFSET_NS,
    DUE_NS,
    HEARD_NS,
    LEG,
    NOBODY,
    PLACES,
    SIGNS,
    new_row,
)
from gcs.mavlink.fleet.vehicle import Address, Health, Tell, Vehicle
from gcs.mavlink.frames.codec import (
    AUTOPILOT_COMPONENT_ID,
    GCS_COMPONENT_ID,
    GCS_SYSTEM_ID,
    Encoder,
    Frame,
    Message,
    SimpleFrames,
)
from gcs.mavlink.frames.signing import MIN_SIGNED_LATER_NS, signed_t_ns
from gcs.mavlink.mission.items import Home
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Datagram, Level, Notice, Send, VehicleState, vehicle_id

if TYPE_CHECKING:
    from gcs.mavlink.fleet.fast_telemetry import VehicleTable
    from gcs.mavlink.frames.fast_scan import Frames

_NEEDED: Final = frozenset(
    {
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_SYS_STATUS,
        dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        dialect.MAVLINK_MSG_ID_HOME_POSITION,
        dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
        dialect.MAVLINK_MSG_ID_STATUSTEXT,
        dialect.MAVLINK_MSG_ID_COMMAND_ACK,
        dialect.MAVLINK_MSG_ID_MISSION_CURRENT,
        dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
        dialect.MAVLINK_MSG_ID_MISSION_ITEM_REACHED,
        dialect.MAVLINK_MSG_ID_MISSION_COUNT,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST,
        dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
        dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT,
        dialect.MAVLINK_MSG_ID_MISSION_ACK,
    }
)
_REPEAT_NOTICE_NS: Final = ns(10.0)


@dataclass(frozen=True, slots=True)
class FleetSettings:
    """How to watch and what to ask."""

    position_rate_hz: float = 4.0
    stale_after_s: float = 2.5
    """Silence after which a vehicle is stale: a first word to the operator."""
    lost_after_s: float = 5.0
    """Silence after which a vehicle is lost, and may be heard from another address."""
    max_speed_m_s: float = 150.0
    """Over ground; reports of more are refused, and so are places further away than that."""
    max_distance_m: float = 100_000.0
    """Positions further from the frame's origin are refused."""
    checks_signatures: bool = False
    """True if signatures are checked before frames come here."""
    max_strangers: int = 64
    """Strangers that are told apart; more are counted together."""


class Fleet:
    """All expected vehicles.

    Parameters
    ----------
    expected : iterable of int
        Our vehicles.
    frame : LocalFrame
        Where positions are put.
    links : iterable of Link
        Where vehicles are heard: what network each is, and whom to call where nobody calls us. A link that
        is not among them is of network 0.
    own : (int, int)
        Our system and component id.
    also : iterable of int
        Message ids that `receive` gives beside those that the service itself needs.
    kernel : bool
        Whether quiet frames are folded in by a compiled kernel, to be warmed up before
        (`gcs.mavlink.fleet.fast_telemetry.warm_up`); without it the same comes out, slowly.
    """

    def __init__(
        self,
        expected: Iterable[int],
        frame: LocalFrame,
        settings: FleetSettings | None = None,
        *,
        links: Iterable[Link] = (),
        own: tuple[int, int] = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
        also: Iterable[int] = (),
        kernel: bool = True,
    ) -> None:
        loud = frozenset(also)
        self._needed = _NEEDED | loud
        self.links: dict[str, LinkCounters] = {}
        """By link, in the order in which they were first heard."""
        self._networks = {link.name: link.network for link in links}
        self._callers = {
            (link.name, link.endpoint.remote): Encoder(*own) for link in links if link.endpoint.remote
        }
        self._settings = settings or FleetSettings()
        self._stale_after_ns = ns(self._settings.stale_after_s)
        self._lost_after_ns = ns(self._settings.lost_after_s)
        called = sorted(set(expected))
        self._table = np.tile(new_row(), (len(called), 1))
        self._frames: Frames | SimpleFrames = SimpleFrames()
        self._ledger: VehicleTable | None = None
        if kernel:
            from gcs.mavlink.fleet.fast_telemetry import VehicleTable
            from gcs.mavlink.frames.fast_scan import Frames

            self._frames = Frames()
            self._ledger = VehicleTable(
                self._table,
                called,
                self._frames,
                _NEEDED,
                loud,
                frame,
                (self._settings.max_distance_m, self._settings.max_speed_m_s),
            )
        self._vehicles = {
            vehicle: Vehicle(
                vehicle,
                frame,
                Encoder(*own),
                StreamRequests(vehicle, own, self._settings.position_rate_hz, row),
                self._settings.max_distance_m,
                self._settings.max_speed_m_s,
                row,
            )
            for vehicle, row in zip(called, self._table, strict=True)
        }
        self._in_order = tuple(self._vehicles.values())
        self._strangers = UnknownSystems(self._settings.max_strangers)
        self._addresses = Peers(self._used, most=2 * len(self._vehicles))
        self._telling = NoticeQueue()
        self._claimed_t_ns: dict[int, int] = {}
        """When somebody at another address last claimed a vehicle's id."""

    # ------------------------------------------------------------ in

    def receive(self, datagram: Datagram) -> list[tuple[int, Message]]:
        """Take one datagram; returns what vehicles of ours said in it, for their mission tasks.

        Positions and other quiet frames (`gcs.mavlink.fleet.fast_telemetry`) are not among it: they are in
        the states. Who waits for a heartbeat that says nothing new must `attend`.
        """
        frames = self._frames
        frames.take(datagram.data)
        link = self.links.get(datagram.link)
        if link is None:
            link = self.links[datagram.link] = LinkCounters()
        link.datagrams += 1
        link.frames += frames.checked
        link.unknown_ids += frames.unknown
        link.bytes += len(datagram.data)
        if frames.bad_bytes or frames.crc_errors:
            link.bad_bytes += frames.bad_bytes
            link.crc_errors += frames.crc_errors
            text = f"unreadable bytes from {datagram.peer} on {datagram.link}, {link.bad_bytes} there in all"
            self._telling.now_and_then("bad bytes", 0, datagram.t_ns, "warning", text)
        return self._take(datagram, link)

    def _take(self, datagram: Datagram, link: LinkCounters) -> list[tuple[int, Message]]:
        """Fold the frames in, one after the other: quiet ones by the kernel, others here."""
        frames, t_ns = self._frames, datagram.t_ns
        address = (datagram.link, datagram.peer)
        network = self._networks.get(datagram.link, 0)
        accepted = []
        at = 1
        while at <= frames.found:
            if self._ledger is not None:
                number = self._addresses.known(address)
                at, lost = self._ledger.fold(datagram.data, at, number, t_ns, network)
                link.lost += lost
                if at > frames.found:
                    break
            if frames.is_checked(at):
                frame = frames.frame(at)
                vehicle = self._vehicles.get(vehicle_id(network, frame.system_id))
                if vehicle is None:
                    link.strangers += 1
                    self._count_stranger(frame, address, t_ns)
                elif (message := self._accept(vehicle, frame, address, t_ns)) is not None:
                    accepted.append((vehicle.system_id, message))
            at += 1
        return accepted

    def _accept(self, vehicle: Vehicle, frame: Frame, address: Address, t_ns: int) -> Message | None:
        """Check whose frame it is, and fold it in; None when it is of no use."""
        if frame.component_id != AUTOPILOT_COMPONENT_ID:
            self.links[address[0]].ignored += 1
            return None
        message = frame.message() if is_heartbeat(frame) else None
        if not self._is_its_own(vehicle, frame, message, address, t_ns):
            return None
        if message is None and frame.message_id in self._needed:
            message = frame.message()
        silent_ns = t_ns - vehicle.heard_t_ns
        if vehicle.liveness in ("stale", "down"):
            if vehicle.liveness == "down":
                vehicle.returns += 1
                vehicle.attend()
                self._contact(vehicle, address)
            vehicle.row[ADDRESS] = self._addresses.known(address)
            self._telling.tell(
                "info", f"heard again after {silent_ns / NS_PER_S:.1f} s", t_ns, vehicle.system_id
            )
        vehicle.liveness = "alive"
        lost = vehicle.lost
        vehicle.count(frame.sequence, t_ns)
        if frame.signed is not vehicle.signed:
            self._note_signing(vehicle, t_ns, signed=frame.signed)
        self.links[address[0]].lost += vehicle.lost - lost
        if message is None:
            return None
        if frame.message_id == dialect.MAVLINK_MSG_ID_STATUSTEXT:
            texts = vehicle.texts.joined(message)
            for text in texts:
                self._telling.text(text, message.severity, vehicle.system_id, t_ns)
            if not texts:
                return None
            message.text, message.id = texts[-1], 0
        vehicle.take(message, t_ns, self._teller(t_ns, vehicle.system_id))
        return message

    def _note_signing(self, vehicle: Vehicle, t_ns: int, *, signed: bool) -> None:
        vehicle.row[SIGNS] = signed
        level: Level = "info" if signed else "warning"
        text = "signs its frames" if signed else "no longer signs its frames"
        self._telling.now_and_then(text, vehicle.system_id, t_ns, level, text)

    def _is_its_own(
        self, vehicle: Vehicle, frame: Frame, message: Message | None, address: Address, t_ns: int
    ) -> bool:
        """Whether the frame comes from the vehicle; an autopilot's heartbeat may show where it now is."""
        if vehicle.address == address:
            return not is_heartbeat(frame) or is_vehicles(message)
        is_heard = vehicle.address is not None and t_ns - vehicle.heard_t_ns <= self._lost_after_ns
        later = is_heard and is_vehicles(message) and self._signs_later(vehicle, frame, t_ns)
        if vehicle.address is not None and is_heard and not later:
            vehicle.conflicts += 1
            self._claimed_t_ns[vehicle.system_id] = t_ns
            self.links[address[0]].conflicts += 1
            text = f"{address[1]} on {address[0]} claims its id, which is heard from {vehicle.address[1]}"
            self._telling.now_and_then("conflict", vehicle.system_id, t_ns, "alarm", text)
            return False
        if not is_heartbeat(frame) or not is_vehicles(message):
            self.links[address[0]].ignored += 1
            return False
        moved = "in contact" if vehicle.address is None else "moved"
        if later and vehicle.address is not None:
            text = f"{vehicle.address[1]} on {vehicle.address[0]} sent recorded frames with its id"
            self._telling.tell("alarm", text, t_ns, vehicle.system_id)
        self._contact(vehicle, address)
        signed_ns = signed_t_ns(frame)
        vehicle.signed_lead_ns = None if signed_ns is None else signed_ns - t_ns
        self._telling.tell("info", f"{moved}: {address[1]} on {address[0]}", t_ns, vehicle.system_id)
        return True

    def _signs_later(self, vehicle: Vehicle, frame: Frame, t_ns: int) -> bool:
        """Return True if a checked frame is signed later than frames from the vehicle's address are."""
        signed_ns, lead_ns = signed_t_ns(frame), vehicle.signed_lead_ns
        if not self._settings.checks_signatures or signed_ns is None or lead_ns is None:
            return False
        return signed_ns - t_ns - lead_ns > MIN_SIGNED_LATER_NS

    def _contact(self, vehicle: Vehicle, address: Address) -> None:
        """Hear a vehicle at an address from now on."""
        vehicle.contact(address, self._addresses.meet(address))

    def _used(self) -> set[Address]:
        """Addresses where somebody is heard or called."""
        heard = {vehicle.address for vehicle in self._in_order if vehicle.address is not None}
        return heard | self._callers.keys()

    def _count_stranger(self, frame: Frame, address: Address, t_ns: int) -> None:
        if self._strangers.count(frame.system_id, frame.component_id, address, t_ns):
            text = f"stranger: system {frame.system_id}, component {frame.component_id}, from {address[1]}"
            self._telling.tell("info", text, t_ns)

    # ------------------------------------------------------------ out

    def poll(self, t_ns: int) -> list[Send]:
        """Let time pass: who has fallen silent, and what to send."""
        out = [
            Send(*address, encode(heartbeat()))
            for address, encode in self._callers.items()
            if self._addresses.beat_due(address, t_ns)
        ]
        for index in np.flatnonzero(self._is_due(t_ns)).tolist():
            vehicle = self._in_order[index]
            if vehicle.address is not None:
                messages = self._poll_vehicle(vehicle, vehicle.address, t_ns)
                out += [Send(*vehicle.address, vehicle.encoder(message)) for message in messages]
        return out

    def _is_due(self, t_ns: int) -> npt.NDArray[np.bool_]:
        """Which vehicles to look at: something may be due to be sent, or it has fallen silent."""
        table = self._table
        is_silent = (table[:, ADDRESS] != NOBODY) & (t_ns - table[:, HEARD_NS] > self._stale_after_ns)
        return np.asarray(is_silent | (table[:, DUE_NS] <= t_ns))

    def _poll_vehicle(self, vehicle: Vehicle, address: Address, t_ns: int) -> list[Message]:
        self._watch(vehicle, t_ns)
        messages = vehicle.poll(t_ns) if vehicle.liveness == "alive" else []
        if self._addresses.beat_due(address, t_ns):
            messages.append(heartbeat())
        next_beat_ns = self._addresses.next_beat_ns(address)
        lost_t_ns = vehicle.heard_t_ns + self._lost_after_ns + 1
        due = {"alive": vehicle.wants.idle_until_ns, "stale": lost_t_ns}.get(vehicle.liveness, next_beat_ns)
        vehicle.row[DUE_NS] = min(next_beat_ns, due)
        return messages

    def _watch(self, vehicle: Vehicle, t_ns: int) -> None:
        """Say who falls silent, who is lost, and whose id nobody else claims any more."""
        tell, silent_ns = self._teller(t_ns, vehicle.system_id), t_ns - vehicle.heard_t_ns
        if vehicle.liveness in ("alive", "stale") and silent_ns > self._lost_after_ns:
            vehicle.liveness, vehicle.row[ADDRESS] = "down", NOBODY
            tell("alarm", f"link down: not heard for {silent_ns / NS_PER_S:.1f} s")
        elif vehicle.liveness == "alive" and silent_ns > self._stale_after_ns:
            vehicle.liveness, vehicle.row[ADDRESS] = "stale", NOBODY
            tell("warning", f"not heard for {silent_ns / NS_PER_S:.1f} s")
        elif vehicle.liveness == "alive":
            vehicle.watch(t_ns, tell)
        claimed_t_ns = self._claimed_t_ns.get(vehicle.system_id)
        if claimed_t_ns is not None and t_ns - claimed_t_ns > _REPEAT_NOTICE_NS:
            del self._claimed_t_ns[vehicle.system_id]
            tell("info", "nobody else claims its id any more")

    def _teller(self, t_ns: int, system_id: int) -> Tell:
        return lambda level, text: self._telling.tell(level, text, t_ns, system_id)

    def notices(self) -> list[Notice]:
        """Return what the operator should know since the last call."""
        return self._telling.taken()

    def attend(self, system_id: int) -> None:
        """Have `receive` give the vehicle's next heartbeat, even if it says what the last one said."""
        self._vehicles[system_id].attend()

    def watch_leg(self, system_id: int, *, watched: bool) -> None:
        """Have `receive` give the vehicle's NAV_CONTROLLER_OUTPUT, or no longer."""
        self._vehicles[system_id].row[LEG] = watched

    def encoder(self, system_id: int) -> Callable[[Message], bytes]:
        """Message to frame for one vehicle, in its own sequence; for its mission task."""
        return self._vehicles[system_id].encoder

    def sends(self, system_id: int, frames: Iterable[bytes]) -> list[Send]:
        """Address frames to a vehicle; none when it has never been heard."""
        address = self._vehicles[system_id].address
        return [] if address is None else [Send(*address, frame) for frame in frames]

    # ------------------------------------------------------------ what is known

    @property
    def counters(self) -> LinkCounters:
        """Totals over all links."""
        return total(self.links.values())

    def state(self, system_id: int) -> VehicleState | None:
        """Return what a vehicle last said of itself; None before its first position that can be believed."""
        return self._vehicles[system_id].state()

    def states(self) -> tuple[VehicleState, ...]:
        """Return the states of all vehicles that have reported a position, by system id."""
        return tuple(s for v in self._vehicles.values() if (s := v.state()) is not None)

    def profile(self, system_id: int) -> AutopilotProfile | None:
        """Profile of the vehicle's firmware; None when it has not been heard or is not known here."""
        return self._vehicles[system_id].profile

    def is_atomic(self, system_id: int) -> bool:
        """Return True if the vehicle's firmware is known to replace a mission as a whole, or not at all."""
        profile = self._vehicles[system_id].profile
        return profile is not None and profile.atomic

    def booted_t_ns(self, system_id: int) -> int | None:
        """Return when the vehicle booted, by its newest position; None before the first."""
        row = self._vehicles[system_id].row
        return row.item(BOOT_OFFSET_NS) if row[PLACES] else None

    def returns(self, system_id: int) -> int:
        """Times that the vehicle was heard again after it had been lost."""
        return self._vehicles[system_id].returns

    def round_trip_s(self, system_id: int) -> float:
        """Return how long the vehicle takes to answer a command; 0 before that was measured."""
        return self._vehicles[system_id].wants.round_trip_s

    def boots(self, system_id: int) -> int:
        """Reboots of the vehicle seen so far."""
        return self._vehicles[system_id].boots

    def link(self, system_id: int) -> str:
        """Link on which the vehicle is heard; empty before it is."""
        address = self._vehicles[system_id].address
        return "" if address is None else address[0]

    def is_signed(self, system_id: int) -> bool:
        """Whether the vehicle's last frame carried a signature."""
        return self._vehicles[system_id].signed

    def home(self, system_id: int) -> Home | None:
        """Where the vehicle says that its home is."""
        return self._vehicles[system_id].home

    def health(self) -> tuple[Health, ...]:
        """Link and equipment of every expected vehicle, by system id."""
        return tuple(vehicle.health() for vehicle in self._vehicles.values())

    def strangers(self) -> tuple[UnknownSystem, ...]:
        """Return who else is on the links, in the order of appearance."""
        return self._strangers.known()
