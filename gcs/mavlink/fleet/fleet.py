"""The fleet: all vehicles on our links; which frames are accepted, addresses, heartbeats. Sans-I/O.

Vehicles are numbered by `gcs.model.vehicle_id`; on network 0 that is the system id.

* A vehicle has an expected system id on the network of its link. Frames of unknown systems are counted up to
  a bound, shown, and never acted on.
* An outgoing endpoint gets heartbeats from the start, four a second.
* A vehicle's address is that of its autopilot (`gcs.mavlink.fleet.address_learning`). Another address that
  uses its id is a conflict: counted and ignored. Frames go to learned addresses only.
* On a link that the mission file calls redundant, another address is a stand-by and no conflict
  (`gcs.mavlink.fleet.standby_link`).
* Liveness is the age of the last frame of the vehicle's autopilot, whatever its message id.
* Only message ids that are needed are unpacked. The others count for loss and liveness.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link
from gcs.geo import LocalFrame
from gcs.mavlink.autopilots import AutopilotProfile
from gcs.mavlink.fleet.address_learning import (
    Contact,
    has_equal_proof,
    move_of,
    names_autopilot,
    signed_lead_ns,
)
from gcs.mavlink.fleet.checks.link_timeouts import (
    LOST_AFTER_NS,
    STALE_AFTER_NS,
    check_liveness,
    lost_after_ns,
)
from gcs.mavlink.fleet.fleet_state import FleetState, VehicleLink
from gcs.mavlink.fleet.heartbeat import heartbeat, is_from_autopilot, is_heartbeat
from gcs.mavlink.fleet.high_latency import heartbeat_of, is_high_latency
from gcs.mavlink.fleet.link_stats import LinkCounters, RadioReport, UnknownSystem, total
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.fleet.standby_link import StandbyLink, is_second_path
from gcs.mavlink.fleet.stream_requests import StreamRequests, message_requests
from gcs.mavlink.fleet.telemetry_table import (
    ADDRESS,
    BOOT_OFFSET_NS,
    DUE_NS,
    HEARD_NS,
    IN_LATE_RUN,
    IS_SIGNED,
    LEG_WATCHED,
    NO_ADDRESS,
    POSITION_NS,
    POSITIONS,
    WIDTH,
    new_table,
)
from gcs.mavlink.fleet.vehicle import Health, Readings, Vehicle
from gcs.mavlink.frames.codec import (
    AUTOPILOT_COMPONENT_ID,
    OWN_IDS,
    Encoder,
    Frame,
    FrameTable,
    Message,
    next_sequence,
    scan,
)
from gcs.mavlink.mission.items import Home
from gcs.model import (
    NS_PER_S,
    Datagram,
    Notice,
    NoticeCode,
    Notify,
    Parameter,
    Send,
    VehicleState,
    vehicle_id,
)

if TYPE_CHECKING:
    from gcs.mavlink.fleet.fast_telemetry import VehicleTable

_NEEDED: Final = frozenset(
    {
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_HIGH_LATENCY2,
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
        dialect.MAVLINK_MSG_ID_VFR_HUD,
        dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        dialect.MAVLINK_MSG_ID_WIND,
        dialect.MAVLINK_MSG_ID_WIND_COV,
    }
)
_REMOTE_ID: Final = frozenset(
    {dialect.MAVLINK_MSG_ID_OPEN_DRONE_ID_BASIC_ID, dialect.MAVLINK_MSG_ID_OPEN_DRONE_ID_LOCATION}
)
"""Messages about drones, from receivers: an autopilot describes its own vehicle by them."""
_RADIO: Final = frozenset({dialect.MAVLINK_MSG_ID_RADIO_STATUS, dialect.MAVLINK_MSG_ID_RADIO})
TRAFFIC: Final = frozenset({dialect.MAVLINK_MSG_ID_ADSB_VEHICLE}) | _REMOTE_ID
"""Messages about aircraft. Any component on a vehicle may send them: a receiver is one."""


@dataclass(frozen=True, slots=True)
class FleetSettings:
    """Telemetry rate, messages and bounds."""

    position_rate_hz: float = 4.0
    max_speed_m_s: float = 150.0
    """Ground speed above which a position report is refused."""
    checks_signatures: bool = False
    """True if signatures are checked before frames come here."""
    max_unknown_systems: int = 64
    """Unknown systems that are listed; more are only counted."""
    extra_ids: Collection[int] = ()
    """Message ids that `Fleet.receive` returns besides those that the service needs."""


class Fleet:
    """All expected vehicles.

    Parameters
    ----------
    expected : iterable of int
        Our vehicles.
    frame : LocalFrame
        Frame of the positions.
    links : iterable of Link
        Networks of the links, and addresses of outgoing endpoints. A link that is not listed is of network 0.
    own : (int, int)
        Our system and component id.
    kernel : bool
        True to apply routine telemetry by a compiled kernel (`gcs.mavlink.fleet.fast_telemetry`, warmed up
        before). The result is the same without it.
    state : FleetState, optional
        State to continue from, with `vehicle_links`; that before the first datagram by default.
    vehicle_links : mapping, optional
        Link of each vehicle.

    Raises
    ------
    ValueError
        The telemetry table of the state is not that of our vehicles.
    """

    def __init__(
        self,
        expected: Iterable[int],
        frame: LocalFrame,
        settings: FleetSettings | None = None,
        *,
        links: Iterable[Link] = (),
        own: tuple[int, int] = OWN_IDS,
        kernel: bool = True,
        state: FleetState | None = None,
        vehicle_links: Mapping[int, VehicleLink] | None = None,
    ) -> None:
        called = sorted(set(expected))
        self._state = FleetState(new_table(len(called))) if state is None else state
        if self._state.table.shape != (len(called), WIDTH):
            raise ValueError(f"telemetry table of shape {self._state.table.shape}, {len(called)} vehicles")
        if vehicle_links is None:
            vehicle_links = {vehicle: VehicleLink() for vehicle in called}
        self.links = self._state.links
        """Counters by link, in order of the first datagram."""
        self._peers = self._state.peers
        self._notices = self._state.notices
        self._settings = settings or FleetSettings()
        extra = frozenset(self._settings.extra_ids)
        self._of_receivers = extra & TRAFFIC
        extra -= _REMOTE_ID
        self._needed = _NEEDED | extra
        links = tuple(links)
        self._networks = {link.name: link.network for link in links}
        self._redundant = frozenset(link.name for link in links if link.redundant)
        self._receivers = frozenset(link.name for link in links if link.traffic)
        """Links on which receivers with system ids of their own report aircraft."""
        self._own = own
        self._encoder = Encoder(*own)
        self._outgoing = [(link.name, link.endpoint.remote) for link in links if link.endpoint.remote]
        self._frame = frame
        self._scan: Callable[[bytes], FrameTable] = scan
        self._fast_path: VehicleTable | None = None
        if kernel:
            from gcs.mavlink.fleet.fast_telemetry import VehicleTable
            from gcs.mavlink.frames.fast_scan import Scanner

            self._scan = Scanner()
            self._fast_path = VehicleTable(
                self._state.table,
                called,
                _NEEDED,
                extra,
                frame,
                self._settings.max_speed_m_s,
            )
        requests = message_requests(self._settings.position_rate_hz)
        self._vehicles = {
            vehicle: Vehicle(
                vehicle,
                link := vehicle_links[vehicle],
                record,
                frame,
                self._encoder,
                StreamRequests(vehicle, own, requests, link.requests, record),
                self._settings.max_speed_m_s,
            )
            for vehicle, record in zip(called, self._state.table, strict=True)
        }
        self._in_order = tuple(self._vehicles.values())

    # ------------------------------------------------------------ in

    def receive(self, datagram: Datagram, frames: FrameTable | None = None) -> list[tuple[int, Message]]:
        """Process a datagram, and its frames if they are known; return (vehicle, message) of our vehicles.

        Messages about aircraft (`TRAFFIC`) may be of a receiver on a link with `Link.traffic` as well.

        Routine telemetry (`gcs.mavlink.fleet.fast_telemetry`) is not returned: it is in the states. To
        receive an unchanged heartbeat, call `forward_next_heartbeat`. A HIGH_LATENCY2 is returned as the
        heartbeat that it stands for, if it was applied. After a change of link no heartbeat is returned that
        may be older than the mode known (`Vehicle.is_behind`).
        """
        if frames is None:
            frames = self._scan(datagram.data)
        link = self.links.get(datagram.link)
        if link is None:
            link = self.links[datagram.link] = LinkCounters()
        link.datagrams += 1
        link.frames += frames.count - frames.unknown
        link.unknown_ids += frames.unknown
        link.bytes += len(datagram.data)
        if frames.bad_bytes or frames.crc_errors:
            link.bad_bytes += frames.bad_bytes
            link.crc_errors += frames.crc_errors
            about: dict[str, Parameter] = {"peer": datagram.peer, "count": link.bad_bytes}
            notice = Notice(datagram.t_ns, NoticeCode.UNREADABLE_BYTES, datagram.link, about)
            self._notices.add_rate_limited(notice)
        return self._apply_frames(datagram, frames, link)

    def _apply_frames(
        self, datagram: Datagram, frames: FrameTable, link: LinkCounters
    ) -> list[tuple[int, Message]]:
        """Apply the frames in order: routine telemetry by the kernel, others here."""
        t_ns = datagram.t_ns
        address = (datagram.link, datagram.peer)
        network = self._networks.get(datagram.link, 0)
        accepted = []
        at = 0
        while at < frames.count:
            if self._fast_path is not None:
                number = self._peers.number_of(address)
                at, lost = self._fast_path.apply_frames(frames, at, number, t_ns, network)
                link.lost += lost
                if at == frames.count:
                    break
            if frames.is_checked(at):
                frame = frames.frame(at)
                number = vehicle_id(network, frame.system_id)
                vehicle = self._vehicles.get(number)
                if frame.message_id in _RADIO and frame.component_id != AUTOPILOT_COMPONENT_ID:
                    self._note_radio(frame, datagram.link, t_ns)
                elif vehicle is None and datagram.link in self._receivers and self._is_about_aircraft(frame):
                    if (message := frame.message()) is not None:
                        accepted.append((number, message))
                elif vehicle is None:
                    link.unknown_systems += 1
                    self._count_unknown(frame, address, t_ns)
                elif (message := self._accept_frame(vehicle, frame, address, t_ns)) is not None:
                    accepted.append((vehicle.system_id, message))
            at += 1
        return accepted

    def _is_about_aircraft(self, frame: Frame) -> bool:
        is_own = frame.message_id in _REMOTE_ID and frame.component_id == AUTOPILOT_COMPONENT_ID
        return frame.message_id in self._of_receivers and not is_own

    def _accept_frame(self, vehicle: Vehicle, frame: Frame, address: Address, t_ns: int) -> Message | None:
        """Check a frame's sender and apply it; return its message if it is needed."""
        if vehicle.link.address == address and self._is_about_aircraft(frame):
            return frame.message()
        if frame.component_id != AUTOPILOT_COMPONENT_ID:
            self.links[address[0]].ignored += 1
            return None
        message = frame.message() if names_autopilot(frame) else None
        if not self._is_from_vehicle(vehicle, frame, message, address, t_ns):
            return None
        if message is None and frame.message_id in self._needed:
            message = frame.message()
        silent_ns = t_ns - vehicle.heard_t_ns
        if vehicle.link.liveness in ("stale", "down"):
            if vehicle.link.liveness == "down":
                vehicle.link.returns += 1
                vehicle.link.returned_t_ns = t_ns
                vehicle.forward_next_heartbeat()
                self._set_address(vehicle, address)
            vehicle.record[ADDRESS] = self._peers.number_of(address)
            self._notifier(t_ns, vehicle.system_id)(NoticeCode.HEARD_AGAIN, silence_s=silent_ns / NS_PER_S)
        vehicle.link.liveness = "alive"
        lost = vehicle.lost
        vehicle.count(frame.sequence, t_ns)
        if frame.signed is not vehicle.signed:
            self._note_signing(vehicle, t_ns, signed=frame.signed)
        self.links[address[0]].lost += vehicle.lost - lost
        if message is None:
            return None
        if frame.message_id == dialect.MAVLINK_MSG_ID_STATUSTEXT:
            texts = vehicle.link.texts.add_chunk(message)
            for text in texts:
                self._show_text(vehicle, text, message.severity, t_ns)
            if not texts:
                return None
            message.text = texts[-1]
            message.id = 0
        vehicle.apply_message(message, t_ns, self._notifier(t_ns, vehicle.system_id))
        return _shown_mode(vehicle, message, t_ns) if names_autopilot(frame) else message

    def _show_text(self, vehicle: Vehicle, text: str, severity: int, t_ns: int) -> None:
        """Show a STATUSTEXT to the operator, unless too many come, or a vehicle on the ground repeats it."""
        texts = vehicle.link.texts
        is_repeated = severity <= dialect.MAV_SEVERITY_WARNING and texts.is_repeated(text, t_ns)
        if is_repeated and is_on_ground(vehicle.state(), vehicle.link.home):
            return
        if texts.count_text(t_ns):
            self._notices.add_statustext(text, severity, vehicle.system_id, t_ns)

    def _note_signing(self, vehicle: Vehicle, t_ns: int, *, signed: bool) -> None:
        vehicle.record[IS_SIGNED] = signed
        code = NoticeCode.SIGNS if signed else NoticeCode.SIGNS_NO_LONGER
        self._notices.add_rate_limited(Notice(t_ns, code, vehicle.system_id))

    def _is_from_vehicle(
        self, vehicle: Vehicle, frame: Frame, message: Message | None, address: Address, t_ns: int
    ) -> bool:
        """Return True if the frame is the vehicle's; an autopilot's heartbeat may set its address."""
        link = vehicle.link
        before = vehicle.link.address
        if before == address:
            return not names_autopilot(frame) or is_from_autopilot(message)
        is_slow = link.high_latency is not None
        known = None if before is None else Contact(before, vehicle.heard_t_ns, link.signed_lead_ns, is_slow)
        is_second = before is not None and is_second_path(before, address, self._redundant)
        is_keyed = self._settings.checks_signatures
        move = move_of(frame, t_ns, known, is_keyed=is_keyed, is_second_path=is_second)
        if (
            known is not None
            and move == "heard elsewhere"
            and _takes_over(link.standby, frame, known, address)
        ):
            move = "appeared" if known.is_silent(t_ns) else move
        if known is not None and move == "heard elsewhere":
            may_stand_by = is_second and has_equal_proof(frame, known)
            if may_stand_by and self._is_standby(vehicle, frame, message, address, t_ns):
                return False
            link.conflicts += 1
            link.claimed_t_ns = t_ns
            self.links[address[0]].conflicts += 1
            parameters = {"peer": address[1], "link": address[0], "own_peer": known.address[1]}
            self._notices.add_rate_limited(
                Notice(t_ns, NoticeCode.ID_CONFLICT, vehicle.system_id, parameters)
            )
            return False
        if move == "no heartbeat":
            self.links[address[0]].ignored += 1
            return False
        notify = self._notifier(t_ns, vehicle.system_id)
        if known is not None and move == "signed later":
            notify(NoticeCode.RECORDED_FRAMES, peer=known.address[1], link=known.address[0])
        self._set_address(vehicle, address)
        if is_second and before is not None and not is_slow:
            link.standby = StandbyLink(before, vehicle.heard_t_ns)
        elif link.standby is not None and link.standby.address == address:
            link.standby = None
        link.signed_lead_ns = signed_lead_ns(frame, t_ns)
        code = NoticeCode.IN_CONTACT if known is None else NoticeCode.ADDRESS_CHANGED
        notify(code, peer=address[1], link=address[0])
        return True

    def _is_standby(
        self, vehicle: Vehicle, frame: Frame, message: Message | None, address: Address, t_ns: int
    ) -> bool:
        """Return True if a frame is of the vehicle's stand-by link, and count it; a heartbeat begins one."""
        link = vehicle.link
        if link.standby is None and is_heartbeat(frame) and is_from_autopilot(message):
            link.standby = StandbyLink(address, t_ns)
            notify = self._notifier(t_ns, vehicle.system_id)
            notify(NoticeCode.STANDBY_LINK, peer=address[1], link=address[0])
        if link.standby is None:
            return True  # before its first heartbeat
        if link.standby.address != address:
            return False
        link.standby.heard_t_ns = t_ns
        self.links[address[0]].standby += 1
        return True

    def _check_standby(self, vehicle: Vehicle, t_ns: int) -> None:
        """Forget the stand-by link when it is silent."""
        standby = vehicle.link.standby
        if standby is not None and t_ns - standby.heard_t_ns > LOST_AFTER_NS:
            vehicle.link.standby = None
            notify = self._notifier(t_ns, vehicle.system_id)
            notify(NoticeCode.STANDBY_DOWN, peer=standby.address[1], link=standby.address[0])

    def _set_address(self, vehicle: Vehicle, address: Address) -> None:
        """Set a vehicle's address."""
        number = self._peers.add(address, self._used_addresses, 2 * len(self._vehicles))
        vehicle.set_address(address, number)

    def _used_addresses(self) -> set[Address]:
        """Addresses of vehicles and of outgoing endpoints."""
        heard = {v.link.address for v in self._in_order if v.link.address is not None}
        standby = {v.link.standby.address for v in self._in_order if v.link.standby is not None}
        return heard.union(standby, self._outgoing)

    def _note_radio(self, frame: Frame, link: str, t_ns: int) -> None:
        """Note the report of a radio. It has a system id of its own: 51 with SiK firmware."""
        if (one := frame.message()) is not None:
            self._state.radios[link] = RadioReport(
                t_ns, one.rssi, one.noise, one.remrssi, one.remnoise, one.txbuf, one.rxerrors
            )

    def _count_unknown(self, frame: Frame, address: Address, t_ns: int) -> None:
        if (frame.system_id, frame.component_id) == self._own and is_heartbeat(frame):
            message = frame.message()
            instance = 0 if message is None else message.custom_mode
            self._state.own_ids.add_heartbeat(instance, address, t_ns)
        unknown = self._state.unknown_systems
        limit = self._settings.max_unknown_systems
        if unknown.add_frame(frame.system_id, frame.component_id, address, t_ns, limit):
            sender: dict[str, Parameter] = {
                "system": frame.system_id,
                "component": frame.component_id,
                "peer": address[1],
            }
            self._notices.add(Notice(t_ns, NoticeCode.UNKNOWN_SYSTEM, address[0], sender))

    # ------------------------------------------------------------ out

    def poll(self, t_ns: int) -> list[Send]:
        """Advance the timers; return what to send."""
        self._state.own_ids.begin(t_ns)
        out = []
        for address in self._outgoing:
            out += self._address_heartbeat(address, t_ns)
        for index in np.flatnonzero(self._is_due(t_ns)).tolist():
            vehicle = self._in_order[index]
            self._check_standby(vehicle, t_ns)
            heard_at = vehicle.link.address
            if heard_at is not None:
                messages = self._poll_vehicle(vehicle, heard_at, t_ns)
                out += [Send(*heard_at, vehicle.encode(message)) for message in messages]
            if vehicle.link.standby is not None:
                out += self._address_heartbeat(vehicle.link.standby.address, t_ns)
        return out

    def _address_heartbeat(self, address: Address, t_ns: int) -> list[Send]:
        """Return our heartbeat to an address if it is due, with the sequence of that address."""
        if not self._peers.start_heartbeat(address, t_ns, self._used_addresses):
            return []
        sequences = self._state.sequences
        if address not in sequences:
            used = self._used_addresses()
            sequences = self._state.sequences = {a: number for a, number in sequences.items() if a in used}
        sequence = sequences.get(address, 0)
        sequences[address] = next_sequence(sequence)
        return [Send(*address, self._encoder.pack(self._heartbeat(), sequence))]

    def _is_due(self, t_ns: int) -> npt.NDArray[np.bool_]:
        """Return a mask of the vehicles with something to send, or with a timeout."""
        table = self._state.table
        is_silent = (table[:, ADDRESS] != NO_ADDRESS) & (t_ns - table[:, HEARD_NS] > STALE_AFTER_NS)
        return np.asarray(is_silent | (table[:, DUE_NS] <= t_ns))

    def _poll_vehicle(self, vehicle: Vehicle, address: Address, t_ns: int) -> list[Message]:
        check_liveness(vehicle, t_ns, self._notifier(t_ns, vehicle.system_id))
        link = vehicle.link
        if link.high_latency is not None:  # it costs money by the byte, and its answers come too late
            vehicle.record[DUE_NS] = t_ns + NS_PER_S
            return []
        messages = vehicle.poll(t_ns) if link.liveness == "alive" else []
        if self._peers.start_heartbeat(address, t_ns, self._used_addresses):
            messages.append(self._heartbeat())
        next_heartbeat_ns = self._peers.next_heartbeat_ns(address)
        lost_t_ns = vehicle.heard_t_ns + lost_after_ns(link) + 1
        due = {"alive": link.requests.idle_until_ns, "stale": lost_t_ns}.get(link.liveness, next_heartbeat_ns)
        vehicle.record[DUE_NS] = min(next_heartbeat_ns, due)
        return messages

    def _heartbeat(self) -> Message:
        return heartbeat(self._state.own_ids.instance)

    def _notifier(self, t_ns: int, system_id: int) -> Notify:
        def notify(code: NoticeCode, /, **parameters: Parameter) -> None:
            self._notices.add(Notice(t_ns, code, system_id, parameters))

        return notify

    def notices(self) -> list[Notice]:
        """Return the notices since the last call."""
        return self._notices.drain()

    def forward_next_heartbeat(self, system_id: int) -> None:
        """Have `receive` return the vehicle's next heartbeat, even if it is unchanged."""
        self._vehicles[system_id].forward_next_heartbeat()

    def watch_leg(self, system_id: int, *, watched: bool) -> None:
        """Have `receive` return the vehicle's NAV_CONTROLLER_OUTPUT, or no longer."""
        self._vehicles[system_id].record[LEG_WATCHED] = watched

    def encoder(self, system_id: int) -> Callable[[Message], bytes]:
        """Return the encoder of one vehicle, with its own sequence."""
        return self._vehicles[system_id].encode

    def address_frames(self, system_id: int, frames: Iterable[bytes]) -> list[Send]:
        """Address frames to a vehicle; return none if it was not heard since the start or a restart."""
        link = self._vehicles[system_id].link
        address = link.address
        return [] if address is None or link.is_awaited else [Send(*address, frame) for frame in frames]

    # ------------------------------------------------------------ state

    @property
    def radios(self) -> Mapping[str, RadioReport]:
        """Newest report of the radio of each link that has one."""
        return self._state.radios

    @property
    def counters(self) -> LinkCounters:
        """Totals over all links."""
        return total(self.links.values())

    def state(self, system_id: int) -> VehicleState | None:
        """Return a vehicle's state; None before its first accepted position."""
        return self._vehicles[system_id].state()

    def states(self) -> tuple[VehicleState, ...]:
        """Return the states of all vehicles that have reported a position, by system id."""
        return tuple(s for v in self._vehicles.values() if (s := v.state()) is not None)

    def readings(self, system_id: int) -> Readings:
        """Return the newest telemetry that shows a vehicle's health."""
        return self._vehicles[system_id].readings()

    def profile(self, system_id: int) -> AutopilotProfile | None:
        """Return the profile of the vehicle's firmware; None if unknown."""
        return self._vehicles[system_id].link.profile

    def booted_t_ns(self, system_id: int, since_t_ns: int) -> int | None:
        """Return the vehicle's boot time by its newest position; None without one since `since_t_ns`."""
        record = self._vehicles[system_id].record
        is_known = record[POSITIONS] and record[POSITION_NS] >= since_t_ns
        return record.item(BOOT_OFFSET_NS) if is_known else None

    def may_have_rebooted(self, system_id: int, since_t_ns: int) -> bool:
        """Return True if a vehicle booted, or was not heard for so long that it may have, after a time."""
        record = self._vehicles[system_id].record
        link = self._vehicles[system_id].link
        has_booted = link.boots > 0 and record.item(BOOT_OFFSET_NS) >= since_t_ns
        has_returned = link.returns > 0 and link.returned_t_ns >= since_t_ns
        return has_booted or has_returned or bool(record[IN_LATE_RUN])  # a reboot is confirmed 2 s later

    def link(self, system_id: int) -> str:
        """Return the vehicle's link; empty before it is heard."""
        address = self._vehicles[system_id].link.address
        return "" if address is None else address[0]

    def network(self, link: str) -> int:
        """Return the network of a link."""
        return self._networks.get(link, 0)

    def other_instance(self, t_ns: int) -> Address | None:
        """Return where another service with our ids is heard now; None if there is none."""
        return self._state.own_ids.other(t_ns)

    def is_signed(self, system_id: int) -> bool:
        """Return True if the vehicle's last frame was signed."""
        return self._vehicles[system_id].signed

    def home(self, system_id: int) -> Home | None:
        """Return the vehicle's home position, if known."""
        return self._vehicles[system_id].link.home

    def height_m(self, state: VehicleState) -> float:
        """Return the height of a vehicle above its home; above the frame's origin if home is unknown."""
        home = self.home(state.system_id)
        return state.alt_msl_m - (self._frame.alt_msl_m if home is None else home.alt_msl_m)

    def health(self) -> tuple[Health, ...]:
        """Return link and equipment of every expected vehicle, by system id."""
        return tuple(vehicle.health() for vehicle in self._vehicles.values())

    def health_of(self, system_id: int) -> Health:
        """Return link and equipment of one vehicle."""
        return self._vehicles[system_id].health()

    def unknown_systems(self) -> tuple[UnknownSystem, ...]:
        """Return the unknown systems on the links, in order of appearance."""
        return tuple(self._state.unknown_systems.known.values())


def _shown_mode(vehicle: Vehicle, message: Message, t_ns: int) -> Message | None:
    """Return the heartbeat that a HEARTBEAT or HIGH_LATENCY2 stands for; None if it was not applied."""
    if vehicle.is_behind(t_ns):
        return None
    if message.get_type() == "HEARTBEAT":
        return message
    link = vehicle.link
    return None if link.high_latency is None else heartbeat_of(message, armed=link.armed)


def _takes_over(standby: StandbyLink | None, frame: Frame, known: Contact, address: Address) -> bool:
    """Return True if a frame of a vehicle's stand-by shows that its other link is silent, when it is."""
    is_standby = standby is not None and standby.address == address
    return is_standby and not is_high_latency(frame) and has_equal_proof(frame, known)
