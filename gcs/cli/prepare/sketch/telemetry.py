"""Reader of vehicles from a telemetry log, or from a link."""

from __future__ import annotations

import asyncio
import math
import statistics
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.cli.prepare.sketch.sketch import Place, Sketch, Start, is_place
from gcs.endpoints import parse_endpoint
from gcs.errors import LinkError, RecordingError
from gcs.io.links.manager import TRANSPORTS
from gcs.io.onboard_logs import open_telemetry
from gcs.io.recording.tlog import LogFrame, read_log
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Encoder, Frame, Message, scan
from gcs.model import Notice, NoticeCode, Parameter

_MAX_LOG_BYTES: Final = 256_000_000
"""Bytes of a log that are read: every vehicle appears long before."""
_REQUEST_PERIOD_S: Final = 1.0
_POSITIONS: Final = (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_HOME_POSITION)
_FIRMWARES: Final = {3: "ArduPilot", 12: "PX4"}
_UNKNOWN_HEADING: Final = 65535
_NO_AUTOPILOT: Final = 8
_MIN_SPEED_M_S: Final = 5.0
"""Ground speed above which a fixed wing flies."""
_MAX_SPEEDS: Final = 100_000


@dataclass(slots=True)
class _Vehicle:
    """Reported positions and home of a vehicle."""

    kind: str = ""
    place: Place | None = None
    """First position."""
    south_west: Place = (math.inf, math.inf)
    north_east: Place = (-math.inf, -math.inf)
    speeds_m_s: list[float] = field(default_factory=list)
    """Ground speeds while it moved."""
    course_deg: float | None = None
    ground_msl_m: float | None = None
    has_home: bool = False

    def add_position(self, message: Message) -> None:
        """Process a GLOBAL_POSITION_INT or HOME_POSITION message."""
        if message.get_type() == "HOME_POSITION":
            self.ground_msl_m = message.altitude * 1e-3
            self.has_home = True
            return
        place = message.lat * 1e-7, message.lon * 1e-7
        if not is_place(*place):
            return
        self.south_west = (min(self.south_west[0], place[0]), min(self.south_west[1], place[1]))
        self.north_east = (max(self.north_east[0], place[0]), max(self.north_east[1], place[1]))
        speed_m_s = math.hypot(message.vx, message.vy) * 0.01
        if speed_m_s >= _MIN_SPEED_M_S and len(self.speeds_m_s) < _MAX_SPEEDS:
            self.speeds_m_s.append(speed_m_s)
        if not self.has_home:  # The last one counts: heights are unreliable before.
            self.ground_msl_m = (message.alt - message.relative_alt) * 1e-3
        if self.place is None:
            self.place = place
            self.course_deg = message.hdg * 0.01 if message.hdg != _UNKNOWN_HEADING else None


class HeardVehicles:
    """Vehicles by system id, with the first position that each reports."""

    def __init__(self) -> None:
        self.vehicles: dict[int, _Vehicle] = {}

    def add_frame(self, frame: Frame) -> None:
        """Process a frame with a good checksum."""
        if frame.component_id != AUTOPILOT_COMPONENT_ID or not 1 <= frame.system_id <= 250:
            return
        if frame.message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            message = frame.message()
            if message is not None and message.autopilot != _NO_AUTOPILOT and message.type != 6:
                vehicle = self.vehicles.setdefault(frame.system_id, _Vehicle())
                wing = "fixed wing" if message.type == 1 else f"MAV_TYPE {message.type}, not a fixed wing"
                vehicle.kind = f"{_FIRMWARES.get(message.autopilot, 'unknown firmware')}, {wing}"
        elif frame.message_id in _POSITIONS and frame.system_id in self.vehicles:
            message = frame.message()
            if message is not None:
                self.vehicles[frame.system_id].add_position(message)

    @property
    def unplaced(self) -> list[int]:
        """System ids of vehicles that have not reported a position."""
        return [system_id for system_id, vehicle in self.vehicles.items() if vehicle.place is None]

    def sketch(self) -> Sketch:
        """Return the vehicles as a sketch."""
        sketch = Sketch()
        speeds_m_s = [speed for vehicle in self.vehicles.values() for speed in vehicle.speeds_m_s]
        if speeds_m_s:
            sketch.speed_m_s = round(statistics.median(speeds_m_s), 1)
        for system_id, vehicle in sorted(self.vehicles.items()):
            if vehicle.place is None:
                sketch.notes.append(f"system {system_id} ({vehicle.kind}) gave no position: left out")
                continue
            course = None if vehicle.course_deg is None else vehicle.course_deg % 360.0
            sketch.starts.append(Start(vehicle.place, system_id, course, vehicle.kind))
            sketch.extent += [vehicle.south_west, vehicle.north_east]
            if sketch.ground_msl_m is None:
                sketch.ground_msl_m = vehicle.ground_msl_m
        return sketch


def read_vehicles(path: Path) -> Sketch:
    """Read the vehicles of a telemetry log.

    Raises
    ------
    RecordingError
        When the log cannot be read, or has no position of a vehicle.
    """
    heard = HeardVehicles()
    try:
        with open_telemetry(path) as file:
            _read_into(heard, file)
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror}") from None
    sketch = heard.sketch()
    if not sketch.starts:
        raise RecordingError(str(path), "has no position of a vehicle (GLOBAL_POSITION_INT)")
    return sketch


def _read_into(heard: HeardVehicles, file: BinaryIO) -> None:
    for part in read_log(file):
        if isinstance(part, LogFrame) and part.validity == "good":
            heard.add_frame(part.frame)
        if part.offset > _MAX_LOG_BYTES:
            return


def listen_for_vehicles(endpoint: str, seconds: float) -> Sketch:
    """Listen on a link for some seconds, and request positions.

    No heartbeat is sent: a vehicle's ground-station failsafe would act when the heartbeats end.

    Raises
    ------
    LinkError
        When the endpoint cannot be opened, or no vehicle is heard.
    """
    listener = _LinkListener(endpoint)
    asyncio.run(listener.run(seconds))
    sketch = listener.found.sketch()
    if not sketch.starts:
        silent = listener.found.unplaced
        reason = f"systems {silent} gave no position: wait for a fix" if silent else "no vehicle was heard"
        raise LinkError(endpoint, f"{reason} within {seconds:g} s{listener.problem}")
    return sketch


class _LinkListener:
    """Listens on one endpoint (`gcs.io.links.transport.Listener`) and requests positions."""

    def __init__(self, endpoint: str) -> None:
        parsed = parse_endpoint(endpoint)
        self.found = HeardVehicles()
        self.problem = ""
        self._transport = TRANSPORTS[parsed.kind](parsed)
        self._peers: dict[int, str] = {}
        self._encode = Encoder()

    async def run(self, seconds: float) -> None:
        """Listen; once a second request the positions that are missing."""
        loop = asyncio.get_running_loop()
        self._transport.start(loop, self)
        try:
            end_s = loop.time() + seconds
            while (left_s := end_s - loop.time()) > 0.0:
                await asyncio.sleep(min(_REQUEST_PERIOD_S, left_s))
                for system_id in self.found.unplaced:
                    self._transport.send(self._peers[system_id], self._encode(_position_request(system_id)))
        finally:
            self._transport.close()

    def heard(self, peer: str, data: bytes) -> None:
        """Process received bytes."""
        for frame in scan(data).frames:
            self.found.add_frame(frame)
            self._peers[frame.system_id] = peer

    def connected(self, peer: str) -> None:
        """Ignore connections."""

    def disconnected(self, peer: str) -> None:
        """Ignore connections."""

    def notify(self, code: NoticeCode, /, **parameters: Parameter) -> None:
        """Keep the last problem of the link, for the error message."""
        if code.level != "info":
            self.problem = f"; {Notice(0, code, None, parameters).text}"


def _position_request(system_id: int) -> dialect.MAVLink_message:
    request: Callable[..., dialect.MAVLink_message] = dialect.MAVLink_command_long_message
    position = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
    command = dialect.MAV_CMD_REQUEST_MESSAGE
    return request(system_id, AUTOPILOT_COMPONENT_ID, command, 0, position, 0, 0, 0, 0, 0, 0)
