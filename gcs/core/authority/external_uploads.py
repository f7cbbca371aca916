"""Uploads and commands of other ground stations to our vehicles.

Their frames arrive here after they were forwarded (`gcs.mavlink.router.router`). A station with full access
may upload a mission. From its first frame on the vehicle is overridden: it loses its route and is not tasked
until an operator orders `resume`. During an upload of ours no frames of theirs are forwarded; if both
overlap, our read-back decides. An upload that breaks off raises an alarm: ArduPilot stores items in place, so
its mission may be inconsistent.

From a command to another mode on, nothing that steers is sent until a heartbeat shows the mode
(`gcs.core.authority.mode_commands`). Other commands are reported at intervals. Commands that may end a
flight, and manual control, raise an alarm.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.authority.authority_state import AuthorityState, ExternalUpload
from gcs.core.authority.mode_commands import chooses_mode
from gcs.core.state import Agent
from gcs.endpoints import Link
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import Frame, FrameTable, Message, target_of
from gcs.mavlink.router.access_policy import (
    MISSION_PROTOCOL,
    MISSION_WRITES,
    READ_ONLY_COMMANDS,
    READ_ONLY_MESSAGES,
    command_of,
)
from gcs.mavlink.services.retry import ns
from gcs.model import ControlEvent, Datagram, Effect, Notice, NoticeCode, Parameter, network_of, vehicle_id

_TIMEOUT_NS: Final = ns(10.0)
_REPEAT_NS: Final = ns(10.0)
_MAX_REPORTED: Final = 1000
_FIRST_MESSAGES: Final = ("MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_WRITE_PARTIAL_LIST")
_MISSION_TYPES: Final = (dialect.MAV_MISSION_TYPE_MISSION, dialect.MAV_MISSION_TYPE_ALL)
_ARM_DISARM: Final[int] = dialect.MAV_CMD_COMPONENT_ARM_DISARM
_DANGEROUS_COMMANDS: Final[dict[int, str]] = {
    dialect.MAV_CMD_DO_FLIGHTTERMINATION: "it may end the flight at once",
    dialect.MAV_CMD_DO_PARACHUTE: "it may end the flight at once",
    dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: "the autopilot may restart",
}
_FORCE: Final = 21196.0
"""Second parameter of MAV_CMD_COMPONENT_ARM_DISARM that disarms in flight, too."""
_MANUAL: Final[frozenset[int]] = frozenset(
    {dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE, dialect.MAVLINK_MSG_ID_MANUAL_CONTROL}
)
_PARAM_SET: Final[int] = dialect.MAVLINK_MSG_ID_PARAM_SET
_REPORTS: Final[dict[tuple[str, bool], NoticeCode]] = {
    ("commands", False): NoticeCode.STATION_COMMANDS,
    ("arms", False): NoticeCode.STATION_ARMS,
    ("danger", False): NoticeCode.STATION_DANGER,
    ("commands", True): NoticeCode.STATION_COMMANDS_ALL,
    ("arms", True): NoticeCode.STATION_ARMS_ALL,
    ("danger", True): NoticeCode.STATION_DANGER_ALL,
}
"""Codes by what a frame does, and whether it is for all vehicles."""
_ORDERS_TO_ALL: Final = _MANUAL | {dialect.MAVLINK_MSG_ID_SET_MODE, _PARAM_SET}
"""Messages to system 0 that act on all vehicles, besides commands."""


class ExternalUploads:
    """Monitor of other ground stations; `links` are all MAVLink endpoints."""

    def __init__(self, links: Iterable[Link], agents: Mapping[int, Agent], state: AuthorityState) -> None:
        self._networks = {link.name: link.network for link in links if link.role != "vehicles"}
        self._agents = agents
        self._state = state

    def hosts(self, link: str) -> bool:
        """Return True if other ground stations use this link."""
        return link in self._networks

    def release(self, vehicle: int, event: ControlEvent, t_ns: int) -> None:
        """Release a vehicle: by an operator's order, or because it stores a verified mission of ours."""
        agent = self._agents[vehicle]
        if agent.authority.external_upload is not None:
            agent.authority.external_upload = None
            agent.claims.apply(event, t_ns)

    def receive(self, datagram: Datagram, frames: FrameTable) -> tuple[list[Effect], list[int]]:
        """Process a forwarded datagram; return notices, and the vehicles that are newly overridden."""
        effects: list[Effect] = []
        overridden: list[int] = []
        network = self._networks[datagram.link]
        for frame in frames.frames:
            system, _ = target_of(frame) or (0, 0)
            self._note_mode_command(datagram, frame, network, system)
            if system == 0:
                self._report(effects, datagram, frame, None)
                continue
            vehicle = vehicle_id(network, system)
            if vehicle not in self._agents:
                continue
            if frame.message_id in MISSION_WRITES:
                self._write(effects, overridden, datagram, frame, vehicle)
            else:
                self._report(effects, datagram, frame, vehicle)
        return effects, overridden

    def _note_mode_command(self, datagram: Datagram, frame: Frame, network: int, system: int) -> None:
        """Leave the vehicles alone that a frame may put into another mode; `system` 0 is all of them."""
        for vehicle in [vehicle_id(network, system)] if system else list(self._agents):
            agent = self._agents.get(vehicle)
            if agent is None or network_of(vehicle) != network:
                continue
            if chooses_mode(frame, agent.link.profile):
                station = f"system {frame.system_id}/{frame.component_id} at {datagram.peer}"
                ModeAuthority(agent.authority.mode, agent.claims).note_foreign_command(station, datagram.t_ns)

    def receive_reply(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle: its MISSION_ACK ends an external upload."""
        upload = self._agents[vehicle].authority.external_upload
        if upload is None or upload.has_ended or message.get_type() != "MISSION_ACK":
            return []
        if (message.target_system, message.target_component) != upload.sender:
            return []
        if message.mission_type not in _MISSION_TYPES or message.type == dialect.MAV_MISSION_INVALID_SEQUENCE:
            return []
        upload.has_ended = True
        if message.type == dialect.MAV_MISSION_ACCEPTED:
            return [Notice(t_ns, NoticeCode.STATION_WROTE, vehicle, {"station": upload.station})]
        return [self._broken_off(vehicle, upload, t_ns, f"refused with MAV_MISSION_RESULT {message.type}")]

    def poll(self, t_ns: int) -> list[Effect]:
        """Return alarms of uploads that have timed out."""
        effects: list[Effect] = []
        for vehicle, agent in self._agents.items():
            upload = agent.authority.external_upload
            if upload is not None and not upload.has_ended and t_ns - upload.heard_t_ns > _TIMEOUT_NS:
                upload.has_ended = True
                effects.append(self._broken_off(vehicle, upload, t_ns, "broke off"))
        return effects

    def _broken_off(self, vehicle: int, upload: ExternalUpload, t_ns: int, how: str) -> Notice:
        is_atomic = self._agents[vehicle].link.is_atomic
        code = NoticeCode.STATION_UPLOAD_BROKEN if is_atomic else NoticeCode.STATION_UPLOAD_MIXED
        return Notice(t_ns, code, vehicle, {"station": upload.station, "how": how})

    def _write(
        self, effects: list[Effect], overridden: list[int], datagram: Datagram, frame: Frame, vehicle: int
    ) -> None:
        message = frame.message()
        if message is None or message.mission_type not in _MISSION_TYPES:
            return
        agent = self._agents[vehicle]
        sender = (frame.system_id, frame.component_id)
        upload = agent.authority.external_upload
        if upload is not None and upload.sender == sender:
            upload.heard_t_ns = datagram.t_ns
        if message.get_type() not in _FIRST_MESSAGES:
            return
        station = f"system {sender[0]}/{sender[1]} at {datagram.peer}"
        if upload is None:
            parameters: dict[str, Parameter] = {"station": station, "message": message.get_type()}
            effects.append(Notice(datagram.t_ns, NoticeCode.STATION_WRITES, vehicle, parameters))
            overridden.append(vehicle)
        agent.authority.external_upload = ExternalUpload(sender, station, datagram.t_ns)
        agent.claims.apply(ControlEvent.STATION_WRITES, datagram.t_ns, station)

    def _report(self, effects: list[Effect], datagram: Datagram, frame: Frame, vehicle: int | None) -> None:
        """Report a frame to a vehicle, or to all (None), unless it only reads."""
        number = command_of(frame)
        if frame.message_id in READ_ONLY_MESSAGES or number in READ_ONLY_COMMANDS:
            return
        if vehicle is not None and frame.message_id == _PARAM_SET:
            return  # gcs.core.authority.parameter_changes reports it
        orders = MISSION_PROTOCOL | _ORDERS_TO_ALL
        if vehicle is None and frame.message_id not in orders and number is None:
            return  # broadcasts such as time, corrections and terrain
        name = dialect.mavlink_map[frame.message_id].msgname
        if number is not None:
            known = dialect.enums["MAV_CMD"].get(number)
            name = known.name if known is not None else f"command {number}"
        key = (vehicle or 0, (frame.system_id, frame.component_id), name)
        t_ns = datagram.t_ns
        reports_t_ns = self._state.reports_t_ns
        if t_ns - reports_t_ns.get(key, t_ns - _REPEAT_NS) < _REPEAT_NS:
            return
        if len(reports_t_ns) >= _MAX_REPORTED:
            reports_t_ns.clear()
        reports_t_ns[key] = t_ns
        station = f"system {frame.system_id}/{frame.component_id} at {datagram.peer}"
        danger = _danger(frame, number)
        kind = "arms" if number == _ARM_DISARM else "commands"
        if danger:
            kind = "danger"
        code = _REPORTS[kind, vehicle is None]
        effects.append(Notice(t_ns, code, vehicle, {"message": name, "station": station, "danger": danger}))


def _danger(frame: Frame, command: int | None) -> str:
    """Return the danger of a frame to a flying vehicle; empty if there is none."""
    if frame.message_id in _MANUAL:
        return "it steers by hand"
    if command == _ARM_DISARM:
        message = frame.message()
        forced = message is not None and message.param1 == 0.0 and message.param2 == _FORCE
        return "it stops the motor, in flight too" if forced else ""
    return _DANGEROUS_COMMANDS.get(command or 0, "")
