"""What other ground stations tell our vehicles, and which vehicles they have taken over by it.

Frames of guests come here after they were sent on (`gcs.mavlink.router.router`). Somebody with full access
may upload a mission to one of our vehicles. From its first frame on the vehicle is theirs: its route is given
up, its target is free for others, and it is not tasked until an operator orders it to resume. While a mission
of ours is on its way to it nothing of theirs gets there, so two uploads never meet; should they have met in
flight, ours is settled by its read-back, and the vehicle stays ours. An upload that breaks off is an alarm:
an ArduPilot stores items in place, and may hold a mix.

Every other word of a guest to a vehicle is told to the operator, now and then. What may end a flight, or
steers a vehicle by hand, is an alarm.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link
from gcs.mavlink.frames.codec import Frame, Message, scan, target_of
from gcs.mavlink.router.access_policy import (
    MISSION_PROTOCOL,
    MISSION_WRITES,
    READ_ONLY_COMMANDS,
    READ_ONLY_MESSAGES,
    command_of,
)
from gcs.mavlink.services.retry import ns
from gcs.model import Datagram, Effect, ExternalMission, Level, Notice, vehicle_id

_SILENT_NS: Final = ns(10.0)
_TELL_AGAIN_NS: Final = ns(10.0)
_MAX_TOLD: Final = 1000
_BEGINNINGS: Final = ("MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_WRITE_PARTIAL_LIST")
_FLOWN: Final = (dialect.MAV_MISSION_TYPE_MISSION, dialect.MAV_MISSION_TYPE_ALL)
_ARM_DISARM: Final[int] = dialect.MAV_CMD_COMPONENT_ARM_DISARM
_DANGEROUS_COMMANDS: Final[dict[int, str]] = {
    dialect.MAV_CMD_DO_FLIGHTTERMINATION: "it may end the flight at once",
    dialect.MAV_CMD_DO_PARACHUTE: "it may end the flight at once",
    dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: "the autopilot may restart",
}
_FORCE: Final = 21196.0
"""Second parameter of a command to disarm that is carried out in flight, too."""
_MANUAL: Final[frozenset[int]] = frozenset(
    {dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE, dialect.MAVLINK_MSG_ID_MANUAL_CONTROL}
)
_ORDERS_TO_ALL: Final = _MANUAL | {dialect.MAVLINK_MSG_ID_SET_MODE, dialect.MAVLINK_MSG_ID_PARAM_SET}
"""Messages without a command that order all vehicles when they are for system 0."""


@dataclass(slots=True)
class _Upload:
    """A guest's upload to one vehicle."""

    sender: tuple[int, int]
    station: str
    heard_t_ns: int
    ended: bool = False


class ExternalUploads:
    """Guests of all networks.

    Parameters
    ----------
    links : iterable of Link
        Every MAVLink endpoint.
    vehicles : collection of int
        Ours.
    is_atomic : callable
        True for a vehicle whose firmware replaces its mission as a whole, or not at all.
    """

    def __init__(
        self,
        links: Iterable[Link],
        vehicles: Collection[int],
        is_atomic: Callable[[int], bool] = lambda _vehicle: False,
    ) -> None:
        self._is_atomic = is_atomic
        self._networks = {link.name: link.network for link in links if link.role != "vehicles"}
        self._vehicles = frozenset(vehicles)
        self._uploads: dict[int, _Upload] = {}
        self._told: dict[tuple[int, tuple[int, int], str], int] = {}

    def hosts(self, link: str) -> bool:
        """Whether guests are on this link."""
        return link in self._networks

    def untaskable(self) -> dict[int, str]:
        """Vehicles that somebody else gave a mission, and who, in words."""
        return {
            v: f"has a mission of {upload.station} and is left alone" for v, upload in self._uploads.items()
        }

    def release(self, vehicles: Iterable[int]) -> None:
        """Take vehicles back: an operator's order, or a mission of ours that was read back from them."""
        for vehicle in vehicles:
            self._uploads.pop(vehicle, None)

    def persisted(self, vehicle: int) -> ExternalMission | None:
        """Return what is to be remembered of somebody else's mission for a vehicle."""
        upload = self._uploads.get(vehicle)
        return None if upload is None else ExternalMission(*upload.sender, upload.station, upload.ended)

    def restore(self, vehicle: int, mission: ExternalMission, t_ns: int) -> None:
        """Take up from what was remembered: the vehicle stays theirs."""
        sender = (mission.system_id, mission.component_id)
        self._uploads[vehicle] = _Upload(sender, mission.station, t_ns, mission.ended)

    def receive(self, datagram: Datagram) -> tuple[list[Effect], list[int]]:
        """Take what was sent on; returns notices, and the vehicles taken over just now."""
        effects: list[Effect] = []
        taken: list[int] = []
        network = self._networks[datagram.link]
        for frame in scan(datagram.data).frames:
            system, _ = target_of(frame) or (0, 0)
            if system == 0:
                self._tell(effects, datagram, frame, None)
                continue
            vehicle = vehicle_id(network, system)
            if vehicle not in self._vehicles:
                continue
            if frame.message_id in MISSION_WRITES:
                self._write(effects, taken, datagram, frame, vehicle)
            else:
                self._tell(effects, datagram, frame, vehicle)
        return effects, taken

    def answered(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Take a vehicle's message: its MISSION_ACK ends a guest's upload."""
        upload = self._uploads.get(vehicle)
        if upload is None or upload.ended or message.get_type() != "MISSION_ACK":
            return []
        if (message.target_system, message.target_component) != upload.sender:
            return []
        if message.mission_type not in _FLOWN or message.type == dialect.MAV_MISSION_INVALID_SEQUENCE:
            return []
        upload.ended = True
        if message.type == dialect.MAV_MISSION_ACCEPTED:
            text = f"took the mission of {upload.station}; it is not tasked until it is ordered to resume"
            return [Notice(t_ns, "warning", text, vehicle)]
        return [self._broken(vehicle, upload, t_ns, f"refused with MAV_MISSION_RESULT {message.type}")]

    def poll(self, t_ns: int) -> list[Effect]:
        """Let time pass: an upload that falls silent has broken off."""
        effects: list[Effect] = []
        for vehicle, upload in self._uploads.items():
            if not upload.ended and t_ns - upload.heard_t_ns > _SILENT_NS:
                upload.ended = True
                effects.append(self._broken(vehicle, upload, t_ns, "broke off"))
        return effects

    def _broken(self, vehicle: int, upload: _Upload, t_ns: int, how: str) -> Notice:
        is_whole = self._is_atomic(vehicle)
        left = "it keeps the mission before that" if is_whole else "it may hold a mix of two missions"
        text = f"the upload of {upload.station} {how}: {left}; order it to resume, "
        return Notice(t_ns, "alarm", text + "and it gets a new one of ours", vehicle)

    def _write(
        self, effects: list[Effect], taken: list[int], datagram: Datagram, frame: Frame, vehicle: int
    ) -> None:
        message = frame.message()
        if message is None or message.mission_type not in _FLOWN:
            return
        sender, upload = (frame.system_id, frame.component_id), self._uploads.get(vehicle)
        if upload is not None and upload.sender == sender:
            upload.heard_t_ns = datagram.t_ns
        if message.get_type() not in _BEGINNINGS:
            return
        station = f"system {sender[0]}/{sender[1]} at {datagram.peer}"
        if upload is None:
            text = f"{station} writes a mission of its own ({message.get_type()}): it is theirs from now on"
            effects.append(Notice(datagram.t_ns, "alarm", text, vehicle))
            taken.append(vehicle)
        self._uploads[vehicle] = _Upload(sender, station, datagram.t_ns)

    def _tell(self, effects: list[Effect], datagram: Datagram, frame: Frame, vehicle: int | None) -> None:
        """Say what a guest sent to a vehicle, or to all, unless it only asked."""
        number = command_of(frame)
        if frame.message_id in READ_ONLY_MESSAGES or number in READ_ONLY_COMMANDS:
            return
        orders = MISSION_PROTOCOL | _ORDERS_TO_ALL
        if vehicle is None and frame.message_id not in orders and number is None:
            return  # time, corrections, terrain: what is for nobody orders nobody
        name = dialect.mavlink_map[frame.message_id].msgname
        if number is not None:
            known = dialect.enums["MAV_CMD"].get(number)
            name = known.name if known is not None else f"command {number}"
        key, t_ns = (vehicle or 0, (frame.system_id, frame.component_id), name), datagram.t_ns
        if t_ns - self._told.get(key, t_ns - _TELL_AGAIN_NS) < _TELL_AGAIN_NS:
            return
        if len(self._told) >= _MAX_TOLD:
            self._told.clear()
        self._told[key] = t_ns
        level: Level = "warning" if number == _ARM_DISARM else "info"
        text = f"{name} from system {frame.system_id}/{frame.component_id} at {datagram.peer}"
        text += "" if vehicle else ", to all vehicles"
        danger = _danger(frame, number)
        if danger:
            level, text = "alarm", f"{text}: {danger}; if nobody meant that, stop that ground station"
        effects.append(Notice(t_ns, level, text, vehicle))


def _danger(frame: Frame, command: int | None) -> str:
    """Say what a guest's frame may do to a vehicle that flies; empty when it is no danger by itself."""
    if frame.message_id in _MANUAL:
        return "it steers by hand"
    if command == _ARM_DISARM:
        message = frame.message()
        forced = message is not None and message.param1 == 0.0 and message.param2 == _FORCE
        return "it stops the motor, in flight too" if forced else ""
    return _DANGEROUS_COMMANDS.get(command or 0, "")
