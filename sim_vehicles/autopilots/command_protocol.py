"""MAV_CMDs of the vehicle by COMMAND_LONG and COMMAND_INT, each answered by a MAV_RESULT.

Semantics: https://mavlink.io/en/services/command.html, and ArduPlane's answers where they differ. Other
commands are UNSUPPORTED.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicles.autopilots.arduplane import Autopilot
from sim_vehicles.autopilots.autopilot_states import Home, MissionState
from sim_vehicles.autopilots.autopilot_traits import PX4, Mode
from sim_vehicles.vehicle.telemetry import Streams, Telemetry

_ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
_DENIED: int = mavlink.MAV_RESULT_DENIED
_FAILED: int = mavlink.MAV_RESULT_FAILED
_TEMPORARILY_REJECTED: int = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
_UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED
_FORCE = 2989
_NO_MISSION = MissionState.NO_MISSION
_CHANGE_MODE = 1
_RELATIVE_FRAMES = frozenset({3, 6, 10, 11})


@dataclass(frozen=True, slots=True)
class Command:
    """One command, from either message."""

    id: int
    p1: float
    p2: float
    p3: float
    p4: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    is_alt_relative: bool
    """True if `alt_m` is above home; False if above sea level."""

    @classmethod
    def from_message(cls, m: Any) -> Command:
        """Read a COMMAND_LONG or COMMAND_INT."""
        if m.get_type() == "COMMAND_INT":
            relative = m.frame in _RELATIVE_FRAMES
            return cls(
                m.command, m.param1, m.param2, m.param3, m.param4, m.x * 1e-7, m.y * 1e-7, m.z, relative
            )
        return cls(m.command, m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7, False)


def _whole(value: float) -> int:
    """Return an integer parameter; -1 if it is not finite."""
    return round(value) if math.isfinite(value) else -1


class Commands:
    """Carries commands out.

    Parameters
    ----------
    send : callable
        Takes one MAVLink message: the ACK, then the requested messages.
    """

    def __init__(
        self, autopilot: Autopilot, telemetry: Telemetry, streams: Streams, send: Callable[[Any], None]
    ) -> None:
        self._autopilot = autopilot
        self._telemetry = telemetry
        self._streams = streams
        self._send = send
        self._answers: list[Any] = []
        self._handlers: dict[int, Callable[[Command, int], int]] = {
            mavlink.MAV_CMD_DO_SET_MODE: self._do_set_mode,
            mavlink.MAV_CMD_MISSION_START: self._mission_start,
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            mavlink.MAV_CMD_RUN_PREARM_CHECKS: self._run_prearm_checks,
            mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_current,
            mavlink.MAV_CMD_NAV_LOITER_UNLIM: lambda _c, _t: self._mode(Mode.LOITER),
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _c, _t: self._mode(Mode.RTL),
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_DO_SET_HOME: self._set_home,
            mavlink.MAV_CMD_GET_HOME_POSITION: lambda _c, t: self._answer(
                mavlink.MAVLINK_MSG_ID_HOME_POSITION, t
            ),
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda _c, t: self._answer(
                mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, t
            ),
            mavlink.MAV_CMD_REQUEST_MESSAGE: lambda c, t: self._answer(_whole(c.p1), t),
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
        }

    def handle(self, message: Any, t_ns: int) -> None:
        """Carry out a COMMAND_LONG or COMMAND_INT and acknowledge it to its sender."""
        command = Command.from_message(message)
        handler = self._handlers.get(command.id)
        result = _UNSUPPORTED if handler is None else handler(command, t_ns)
        self._ack(message, command.id, result)

    def handle_set_mode(self, message: Any) -> None:
        """Process SET_MODE, the older form; its ACK has the message id as command."""
        has_custom = bool(message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        mode = self._autopilot.traits.mode_of_custom(message.custom_mode)
        result = self._mode(mode) if has_custom else _DENIED
        self._ack(message, mavlink.MAVLINK_MSG_ID_SET_MODE, result)

    def _ack(self, message: Any, command_id: int, result: int) -> None:
        peer = message.get_srcSystem(), message.get_srcComponent()
        self._send(mavlink.MAVLink_command_ack_message(command_id, result, 0, 0, *peer))
        for answer in self._answers:
            self._send(answer)
        self._answers.clear()

    def _mode(self, mode: Mode | None) -> int:
        autopilot = self._autopilot
        if mode is None:
            return _FAILED
        if mode is Mode.AUTO and autopilot.traits.atomic and autopilot.mission_state is _NO_MISSION:
            # PX4 refuses AUTO without a valid mission; ArduPlane returns home.
            return _TEMPORARILY_REJECTED
        autopilot.set_mode(mode)
        return _ACCEPTED

    def _do_set_mode(self, command: Command, _t_ns: int) -> int:
        base = _whole(command.p1)
        if base < 0 or not base & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return _DENIED
        numbers = _whole(command.p2), _whole(command.p3)
        return self._mode(self._autopilot.traits.mode_of_numbers(*numbers))

    def _mission_start(self, command: Command, _t_ns: int) -> int:
        # ArduPlane starts the whole mission or nothing.
        if _whole(command.p1) > 0 or _whole(command.p2) > 0:
            return _DENIED
        return self._mode(Mode.AUTO)

    def _arm_disarm(self, command: Command, t_ns: int) -> int:
        if command.p1 == 1.0:
            return _ACCEPTED if self._autopilot.arm(t_ns, force=_whole(command.p2) == _FORCE) else _FAILED
        if command.p1 == 0.0:
            return _ACCEPTED if self._autopilot.disarm() else _FAILED
        return _UNSUPPORTED

    def _run_prearm_checks(self, _command: Command, t_ns: int) -> int:
        if self._autopilot.armed:
            return _DENIED
        self._autopilot.report_prearm_failure(t_ns)
        return _ACCEPTED

    def _set_current(self, command: Command, t_ns: int) -> int:
        if not self._autopilot.traits.has_set_current_command:
            return _UNSUPPORTED
        seq = _whole(command.p1)
        if seq < 0 or not self._autopilot.set_current(seq):
            return _DENIED
        self._answers.append(self._telemetry.mission_current(t_ns))
        return _ACCEPTED

    def _reposition(self, command: Command, _t_ns: int) -> int:
        autopilot = self._autopilot
        if not (math.isfinite(command.lat_deg) and math.isfinite(command.lon_deg)):
            return _DENIED
        if autopilot.mode is not Mode.GUIDED:
            if not _whole(command.p2) & _CHANGE_MODE:
                return _FAILED
            autopilot.set_mode(Mode.GUIDED)
        east_m, north_m = autopilot.geodesy.to_local(command.lat_deg, command.lon_deg)
        radius_m = command.p3 if math.isfinite(command.p3) else 0.0
        autopilot.guide_to(east_m, north_m, self._alt_m(command), radius_m)
        return _ACCEPTED

    def _alt_m(self, command: Command) -> float | None:
        """Return the altitude above the local frame's origin; None if the command has none."""
        if not math.isfinite(command.alt_m):
            return None
        if command.is_alt_relative:
            return self._autopilot.home.alt_m + command.alt_m
        return command.alt_m - self._autopilot.geodesy.frame.alt_msl_m

    def _set_home(self, command: Command, t_ns: int) -> int:
        autopilot = self._autopilot
        if not autopilot.is_position_known(t_ns):
            return _FAILED
        if command.p1 == 1.0:
            airframe = autopilot.airframe
            autopilot.home = Home(airframe.east_m, airframe.north_m, airframe.alt_rel_m)
        else:
            alt_m = self._alt_m(command)
            place = command.lat_deg, command.lon_deg
            if alt_m is None or not all(map(math.isfinite, place)) or place == (0.0, 0.0):
                return _DENIED
            autopilot.home = Home(*autopilot.geodesy.to_local(*place), alt_m)
        self._answers.append(self._telemetry.home_position(t_ns))
        return _ACCEPTED

    def _answer(self, message_id: int, t_ns: int) -> int:
        if message_id not in self._telemetry:
            return _FAILED
        answer = self._telemetry.build(message_id, t_ns)
        if answer is None:
            return _FAILED
        self._answers.append(answer)
        return _ACCEPTED

    def _set_interval(self, command: Command, t_ns: int) -> int:
        message_id = _whole(command.p1)
        if message_id not in self._telemetry or not math.isfinite(command.p2):
            return _FAILED
        if self._autopilot.traits is PX4 and message_id == mavlink.MAVLINK_MSG_ID_MISSION_CURRENT:
            return _FAILED  # Its interval is fixed.
        self._streams.set_interval(message_id, round(command.p2), t_ns)
        return _ACCEPTED

    def _get_interval(self, command: Command, _t_ns: int) -> int:
        message_id = _whole(command.p1)
        if message_id not in self._telemetry:
            return _FAILED
        interval_us = self._streams.interval_us(message_id)
        self._answers.append(mavlink.MAVLink_message_interval_message(message_id, interval_us))
        return _ACCEPTED
