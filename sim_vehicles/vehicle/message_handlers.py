"""Handlers of the MAVLink messages that a vehicle receives: bytes in, bytes out, time an argument.

They process frames for its system id and component 1, or for all, from any ground station. Parameters are
listed a few at a time, so that a slow link is not flooded. FTP requests are refused, so that clients continue
at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.services.parameter_protocol import decode_value, encode_value
from sim_vehicles.autopilots.arduplane import Autopilot
from sim_vehicles.autopilots.autopilot_states import ItemReached, StatusText
from sim_vehicles.autopilots.autopilot_traits import PX4, Mode
from sim_vehicles.autopilots.command_protocol import Commands
from sim_vehicles.autopilots.mission_protocol import MISSION, NEVER_NS, MissionServer
from sim_vehicles.autopilots.px4_mission_protocol import Px4MissionServer
from sim_vehicles.vehicle.frames import FrameReader, Outbox, Signing
from sim_vehicles.vehicle.telemetry import Streams, Telemetry

_LISTING_NS = 40_000_000
_CHUNK = 50
"""Of a STATUSTEXT, in bytes."""
_LISTED_AT_ONCE = 4

_FTP_TERMINATE = 1
_FTP_RESET = 2
_FTP_OPEN_TO_READ = 4
_FTP_ACK = 128
_FTP_NAK = 129
_FTP_FILE_NOT_FOUND = 10
_FTP_UNKNOWN_COMMAND = 7

_IGNORE_PLACE = mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
_RELATIVE_FRAMES = frozenset({3, 6, 10, 11})

_MISSION_MESSAGES = (
    "MISSION_COUNT", "MISSION_WRITE_PARTIAL_LIST", "MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_REQUEST_LIST",
    "MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_CLEAR_ALL", "MISSION_ACK",
)  # fmt: skip


class VehicleLink:
    """One vehicle's link.

    Parameters
    ----------
    system_id : int
        MAVLink system id; the component is always 1.
    start_t_ns : int
        Start of telemetry.
    rng : numpy.random.Generator
        Generator of the position noise.
    key : bytes, optional
        Signing key at the start.
    """

    def __init__(
        self,
        system_id: int,
        autopilot: Autopilot,
        start_t_ns: int,
        gps_noise_std_m: float,
        rng: np.random.Generator,
        key: bytes | None = None,
    ) -> None:
        self.system_id = system_id
        self.signing = Signing(key)
        self.outbox = Outbox(system_id, self.signing.state)
        self._reader = FrameReader(self.signing.state)
        self._autopilot = autopilot
        self._telemetry = Telemetry(autopilot, gps_noise_std_m, rng)
        self._streams = Streams(start_t_ns, px4=autopilot.traits is PX4)
        self._commands = Commands(autopilot, self._telemetry, self._streams, self.outbox.send)
        self._missions = _mission_server(autopilot, self.outbox.send)
        self._text_id = 0
        self._list_at: int | None = None
        self._list_due_ns = NEVER_NS
        self._handlers: dict[str, Callable[[Any, int], None]] = {
            **dict.fromkeys(_MISSION_MESSAGES, self._mission),
            "COMMAND_LONG": self._commands.handle,
            "COMMAND_INT": self._commands.handle,
            "SET_MODE": lambda m, _t: self._commands.handle_set_mode(m),
            "HEARTBEAT": self._heartbeat,
            "MISSION_SET_CURRENT": self._set_current,
            "PARAM_REQUEST_LIST": self._list_parameters,
            "PARAM_REQUEST_READ": self._read_parameter,
            "PARAM_SET": self._set_parameter,
            "REQUEST_DATA_STREAM": self._data_stream,
            "SET_POSITION_TARGET_GLOBAL_INT": self._position_target,
            "PING": self._ping,
            "TIMESYNC": self._time_sync,
            "FILE_TRANSFER_PROTOCOL": self._file_transfer,
            "SETUP_SIGNING": self._setup_signing,
        }

    @property
    def due_ns(self) -> int:
        """Time of the next action of `handle_timer`."""
        return min(self._streams.due_ns, self._missions.due_ns, self._list_due_ns)

    def handle_timer(self, t_ns: int) -> None:
        """Send the messages that are due."""
        self.signing.advance_time(t_ns)
        for message_id in self._streams.pop_due(t_ns):
            message = self._telemetry.build(message_id, t_ns)
            if message is not None:
                self.outbox.send(message)
        self._missions.handle_timer(t_ns)
        if t_ns >= self._list_due_ns:
            self._list_more(t_ns)

    def receive_datagram(self, data: bytes, t_ns: int) -> None:
        """Process one datagram; skip invalid bytes without an error."""
        self.signing.advance_time(t_ns)
        for message in self._reader.messages(data):
            if message.get_srcSystem() == self.system_id:
                continue
            if getattr(message, "target_system", 0) not in (0, self.system_id):
                continue
            if getattr(message, "target_component", 0) not in (0, mavlink.MAV_COMP_ID_AUTOPILOT1):
                continue
            handler = self._handlers.get(message.get_type())
            if handler is not None:
                handler(message, t_ns)

    def send_notices(self, t_ns: int) -> None:
        """Send the notices of the autopilot."""
        self.signing.advance_time(t_ns)
        notices = self._autopilot.notices
        while notices:
            notice = notices.popleft()
            if isinstance(notice, ItemReached):
                self.outbox.send(mavlink.MAVLink_mission_item_reached_message(notice.seq))
                self.outbox.send(self._telemetry.mission_current(t_ns))
            else:
                self._send_text(notice)

    def _send_text(self, notice: StatusText) -> None:
        """Send a STATUSTEXT: ArduPlane truncates it, PX4 sends chunks with one id."""
        if self._autopilot.traits is not PX4:
            text = notice.text[:_CHUNK].encode("ascii")
            self.outbox.send(mavlink.MAVLink_statustext_message(notice.severity, text))
            return
        self._text_id = self._text_id % 65535 + 1
        text = f"{notice.text}\t".encode("ascii")
        for number, begin in enumerate(range(0, len(text), _CHUNK)):
            chunk = text[begin : begin + _CHUNK]
            self.outbox.send(
                mavlink.MAVLink_statustext_message(notice.severity, chunk, self._text_id, number)
            )

    # ------------------------------------------------------------ handlers

    def _heartbeat(self, message: Any, t_ns: int) -> None:
        if message.type == mavlink.MAV_TYPE_GCS:
            self._autopilot.note_gcs_heartbeat(message.get_srcSystem(), t_ns)

    def _mission(self, message: Any, t_ns: int) -> None:
        is_item = message.get_type() in ("MISSION_ITEM_INT", "MISSION_ITEM")
        if is_item and message.current == 2:  # ArduPilot's guided item, not part of a mission.
            self._guided_item(message)
        else:
            self._missions.handle(message, t_ns)

    def _guided_item(self, message: Any) -> None:
        scale = 1e-7 if message.get_type() == "MISSION_ITEM_INT" else 1.0
        is_accepted = self._guide(message.x * scale, message.y * scale, message.z, message.frame)
        result = mavlink.MAV_MISSION_ACCEPTED if is_accepted else mavlink.MAV_MISSION_ERROR
        self.outbox.send(
            mavlink.MAVLink_mission_ack_message(
                message.get_srcSystem(), message.get_srcComponent(), result, MISSION
            )
        )

    def _position_target(self, message: Any, _t_ns: int) -> None:
        if message.type_mask & _IGNORE_PLACE:
            return
        self._guide(message.lat_int * 1e-7, message.lon_int * 1e-7, message.alt, message.coordinate_frame)

    def _guide(self, lat_deg: float, lon_deg: float, alt_m: float, frame: int) -> bool:
        autopilot = self._autopilot
        if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and abs(alt_m) < 1e5):  # False for NaN too.
            return False
        if frame in _RELATIVE_FRAMES:
            alt_m += autopilot.home.alt_m
        else:
            alt_m -= autopilot.geodesy.frame.alt_msl_m
        return autopilot.guide_to(*autopilot.geodesy.to_local(lat_deg, lon_deg), alt_m)

    def _setup_signing(self, message: Any, _t_ns: int) -> None:
        if self._autopilot.armed:  # As ArduPlane.
            text = b"ERROR: Won't setup signing when armed"
            self.outbox.send(mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_CRITICAL, text))
        else:
            self.signing.set_up(bytes(message.secret_key), message.initial_timestamp)

    def _set_current(self, message: Any, t_ns: int) -> None:
        # As ArduPlane: no ACK, no failure, and the number as it was sent.
        if not self._missions.is_busy and self._autopilot.set_current(message.seq, by_message=True):
            answer = self._telemetry.mission_current(t_ns)
            answer.seq = message.seq
            self.outbox.send(answer)

    def _list_parameters(self, _message: Any, t_ns: int) -> None:
        self._list_at = 0
        self._list_due_ns = t_ns

    def _list_more(self, t_ns: int) -> None:
        assert self._list_at is not None
        parameters = self._autopilot.parameters
        end = min(self._list_at + _LISTED_AT_ONCE, len(parameters))
        for index in range(self._list_at, end):
            self._send_parameter(parameters.name(index), index)
        if end == len(parameters):
            self._list_at = None
            self._list_due_ns = NEVER_NS
        else:
            self._list_at = end
            self._list_due_ns = t_ns + _LISTING_NS

    def _read_parameter(self, message: Any, _t_ns: int) -> None:
        parameters = self._autopilot.parameters
        name = message.param_id
        if message.param_index >= 0:
            if message.param_index >= len(parameters):
                return
            name = parameters.name(message.param_index)
        if name in parameters:
            self._send_parameter(name, parameters.index(name))

    def _set_parameter(self, message: Any, _t_ns: int) -> None:
        parameters = self._autopilot.parameters
        name = message.param_id
        if name in parameters:
            value = message.param_value
            if self._autopilot.traits is PX4:
                value = decode_value(message, bytewise=True)
            parameters.request(name, value)
            self._send_parameter(name, parameters.index(name))

    def _send_parameter(self, name: str, index: int) -> None:
        parameters = self._autopilot.parameters
        kind = int(parameters.kind(name))
        value = encode_value(parameters[name], kind, bytewise=self._autopilot.traits is PX4)
        self.outbox.send(
            mavlink.MAVLink_param_value_message(name.encode("ascii"), value, kind, len(parameters), index)
        )

    def _data_stream(self, message: Any, t_ns: int) -> None:
        self._streams.set_group(
            message.req_stream_id, message.req_message_rate, message.start_stop == 1, t_ns
        )

    def _ping(self, message: Any, _t_ns: int) -> None:
        if message.target_system == 0:  # A message with a target is an answer.
            peer = message.get_srcSystem(), message.get_srcComponent()
            self.outbox.send(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *peer))

    def _time_sync(self, message: Any, t_ns: int) -> None:
        if message.tc1 == 0:
            self.outbox.send(mavlink.MAVLink_timesync_message(t_ns - self._autopilot.boot_t_ns, message.ts1))

    def _file_transfer(self, message: Any, _t_ns: int) -> None:
        request = bytes(message.payload)
        seq = int.from_bytes(request[:2], "little")
        session = request[2]
        opcode = request[3]
        if opcode in (_FTP_ACK, _FTP_NAK):
            return
        answer = bytearray(251)
        answer[:2] = ((seq + 1) & 0xFFFF).to_bytes(2, "little")
        answer[2] = session
        answer[5] = opcode
        if opcode in (_FTP_TERMINATE, _FTP_RESET):
            answer[3] = _FTP_ACK
        else:
            error = _FTP_FILE_NOT_FOUND if opcode == _FTP_OPEN_TO_READ else _FTP_UNKNOWN_COMMAND
            answer[3] = _FTP_NAK
            answer[4] = 1
            answer[12] = error
        self.outbox.send(
            mavlink.MAVLink_file_transfer_protocol_message(
                0, message.get_srcSystem(), message.get_srcComponent(), list(answer)
            )
        )


def _mission_server(autopilot: Autopilot, send: Callable[[Any], None]) -> MissionServer:
    stores = {MISSION: autopilot.mission, **autopilot.fence.stores}
    cleared = autopilot.mission_cleared
    if autopilot.traits is PX4:
        return Px4MissionServer(stores, send, cleared, lambda: autopilot.seq, autopilot.mission_replaced)
    return MissionServer(
        stores,
        send=send,
        may_clear=lambda: not (autopilot.armed and autopilot.mode is Mode.AUTO),
        cleared=cleared,
        current=lambda: autopilot.seq,
    )
