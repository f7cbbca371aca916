"""Real autopilot firmware in the loop: command lines, and launch into the air.

A firmware (ArduPlane's SITL, or PX4 with its SIH aeroplane) replaces one simulated vehicle. It starts on the
ground at the scenario's position. `Launch` brings it to the start of a simulated vehicle: armed, in the air,
and circling. Its true position comes from its own simulation: SIMSTATE of ArduPilot, HIL_STATE_QUATERNION of
PX4.

Sources: ArduPilot's SITL command line (https://ardupilot.org/dev/docs/sitl-parameters.html), PX4's SIH
(https://docs.px4.io/main/en/sim_sih/).
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.errors import SimulationError
from gcs.geo import LocalFrame
from gcs.mavlink.fleet.statustext import TextChunks
from gcs.model import NS_PER_S
from sim_vehicles.autopilots.autopilot_traits import TRAITS, Mode
from sim_vehicles.vehicle.faults import FaultKind
from sim_vehicles.vehicle.vehicle import VehicleSpec

if TYPE_CHECKING:
    from sim_vehicles.process_start import Firmware

LAUNCH_SPEED: Final = 10.0
"""Speed of ArduPlane's simulation while vehicles are brought into the air."""
_AGAIN_NS: Final = NS_PER_S
_NEAR_ALTITUDE_M: Final = 10.0
_NEAR_START_M: Final = 60.0
TRUE_STATE: Final = {
    "ardupilot": mavlink.MAVLINK_MSG_ID_SIMSTATE,
    "px4": mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
}
"""Message with the true position, by autopilot."""
_HEARTBEATS_IN_MANUAL: Final = 3
"""Seconds of PX4's time. After one without altitude control it begins anew at the present height."""
_HOST_IS_RECEIVER: Final = {"MAV_USEHILGPS": 1.0, "SENS_EN_GPSSIM": 2.0}
"""SIH has no receiver unless its parameter is 1; the start script's default goes before a 0."""
_STREAMS_HZ: Final = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 4.0,
}


_WITH_TERRAIN: Final = {"TERRAIN_SPACING": 30.0}
"""Default: 100 m, by which steep ground is off by tens of metres."""


_PX4_THRUST: Final = {"SIH_F_T_MAX": 6.0}
"""Thrust of SIH's aeroplane in N. Its airframe sets SIH_T_MAX, which PX4 reads for multicopters alone since
2026; the aeroplane has 2 N by default then, and does not climb."""


_PX4_LINKS: Final = (
    "mavlink start -x -u $((14580+px4_instance)) -r 4000000 -f -m onboard -o $((14540+px4_instance))\n"
)

_PX4_WITH_TERRAIN: Final = {"FW_T_HRATE_FF": 1.0, "SIH_T_MAX": 9.0, "SIH_F_T_MAX": 9.0}
"""Climbs without delay, and thrust for them: with its 6 N SIH's aeroplane climbs 3 m/s, below its cruising
speed."""


def parse_sitl(text: str) -> tuple[Firmware, Path]:
    """Read ``arduplane=PATH`` or ``px4=PATH``.

    Raises
    ------
    SimulationError
        The text has another form, or there is no program at that path.
    """
    name, separator, path = text.partition("=")
    if not separator or name not in ("arduplane", "px4") or not path:
        raise SimulationError(f"--sitl: expected arduplane=PATH or px4=PATH, got {text!r}")
    binary = Path(path).expanduser().resolve()
    if not binary.is_file() or not os.access(binary, os.X_OK):
        raise SimulationError(f"--sitl: {binary} is not a program that can be started")
    return cast("Firmware", name), binary


@dataclass(frozen=True, slots=True)
class Ports:
    """UDP ports on 127.0.0.1 between the firmware and the process that hosts it."""

    ground: int
    """Towards the ground station."""
    truth: int
    """True state, and commands of the launch."""


def arduplane_command(
    binary: Path,
    spec: VehicleSpec,
    frame: LocalFrame,
    ports: Ports,
    instance: int,
    folder: Path,
    *,
    has_terrain: bool = False,
) -> list[str]:
    """Return the command line of ArduPlane's SITL, and write its parameter file into `folder`.

    The aeroplane is SITL's ``plane`` with the parameters that ArduPilot ships for it. The scenario's speed,
    wind and parameters are set on top. With terrain it requests the ground from the ground station, finer
    than by default; its simulation flies and crashes over that ground.
    """
    wind_m_s = math.hypot(spec.wind_east_m_s, spec.wind_north_m_s)
    wind_from_deg = math.degrees(math.atan2(-spec.wind_east_m_s, -spec.wind_north_m_s)) % 360.0
    parameters = {
        "AIRSPEED_CRUISE": spec.forward_speed_m_s,
        **({} if spec.climb_m_s is None else {"TECS_CLMB_MAX": spec.climb_m_s}),
        **({} if spec.sink_m_s is None else {"TECS_SINK_MAX": spec.sink_m_s}),
        "TKOFF_ALT": spec.alt_rel_m,
        "RTL_ALTITUDE": spec.alt_rel_m,
        "WP_LOITER_RAD": 40.0,
        **(_WITH_TERRAIN if has_terrain else {}),
        "SIM_WIND_SPD": wind_m_s,
        "SIM_WIND_DIR": wind_from_deg,
        **spec.parameters,
    }
    file = folder / "scenario.parm"
    file.write_text("".join(f"{name} {value:g}\n" for name, value in parameters.items()), encoding="ascii")
    lat_deg, lon_deg = frame.to_geodetic(spec.east_m, spec.north_m)
    course_deg = math.degrees(spec.course_rad) % 360.0
    return [
        str(binary), "--model", "plane", "--wipe",
        "--speedup", f"{LAUNCH_SPEED:g}",
        "--instance", str(instance),
        "--sysid", str(spec.system_id),
        "--home", f"{lat_deg:.8f},{lon_deg:.8f},{frame.alt_msl_m + spec.home_rel_m:.2f},{course_deg:.1f}",
        "--defaults", f"@ROMFS/models/plane.parm,{file}",
        "--serial0", f"udpclient:127.0.0.1:{ports.ground}",
        "--serial1", f"udpclient:127.0.0.1:{ports.truth}",
        "--serial2", "none",
    ]  # fmt: skip


def px4_command(
    binary: Path, spec: VehicleSpec, frame: LocalFrame, instance: int, speed: float, folder: Path
) -> tuple[list[str], dict[str, str]]:
    """Return the command line of PX4 with its SIH aeroplane, and the environment that it reads.

    Instance N has the UDP ports 14580 + N (its own) and 14540 + N (ours). PX4's start script looks for the
    script of its links in PATH first: that of `folder` leaves out the link to port 14550, where a ground
    station would hear each vehicle twice.
    """
    (folder / "px4-rc.mavlink").write_text(_PX4_LINKS, encoding="ascii")
    lat_deg, lon_deg = frame.to_geodetic(spec.east_m, spec.north_m)
    kinds = {fault.kind for fault in spec.faults}
    parameters = {
        "MAV_SYS_ID": float(spec.system_id),
        "MIS_TAKEOFF_ALT": spec.alt_rel_m,
        "FW_AIRSPD_TRIM": spec.forward_speed_m_s,
        **_PX4_THRUST,
        **({} if spec.climb_m_s is None else {"FW_T_CLMB_R_SP": spec.climb_m_s} | _PX4_WITH_TERRAIN),
        **({} if spec.sink_m_s is None else {"FW_T_SINK_R_SP": spec.sink_m_s}),
        "RTL_RETURN_ALT": spec.alt_rel_m,
        "RTL_DESCEND_ALT": spec.alt_rel_m,
        "NAV_LOITER_RAD": 40.0,
        "RTL_LOITER_RAD": 40.0,
        **({"COM_RC_IN_MODE": 1.0} if FaultKind.RC in kinds else {}),
        **(_HOST_IS_RECEIVER if FaultKind.GLITCH in kinds else {}),
        **spec.parameters,
    }
    environment = {
        "PX4_SIM_MODEL": "sihsim_airplane",
        "PX4_SYS_AUTOSTART": "10041",
        "PX4_SIM_SPEED_FACTOR": f"{speed:g}",
        "PX4_HOME_LAT": f"{lat_deg:.8f}",
        "PX4_HOME_LON": f"{lon_deg:.8f}",
        "PX4_HOME_ALT": f"{frame.alt_msl_m + spec.home_rel_m:.2f}",
        "PATH": os.pathsep.join([str(folder.resolve()), os.environ.get("PATH", os.defpath)]),
        **{f"PX4_PARAM_{name}": f"{value:g}" for name, value in parameters.items()},
    }
    return [str(binary), "-i", str(instance), "-d", str(binary.parent.parent / "etc")], environment


class Stage(Enum):
    """Stage of a launch."""

    WAITING = auto()
    """Waiting for a position, and for the checks before arming."""
    TAKING_OFF = auto()
    RETURNING = auto()
    """Flying to the start, at altitude."""
    LOITERING = auto()
    DONE = auto()


class Launch:
    """Brings one vehicle from the ground into LOITER (PX4's Hold) above its start. Sans-I/O.

    Commands are repeated each second until the vehicle's heartbeat shows their effect.

    PX4 is set to MANUAL before its take-off. It controls its altitude from its start on, with a reference
    that begins at sea level and rises by FW_T_CLMB_R_SP, in a mode other than MANUAL and the like
    (`TECS::initialize`): a PX4 that started 1,500 m above sea level would descend for its first six minutes.
    """

    def __init__(self, spec: VehicleSpec, frame: LocalFrame) -> None:
        self.stage = Stage.WAITING
        self.last_status = ""
        """The vehicle's last STATUSTEXT, for the error of a failed launch."""
        self._texts = TextChunks()
        self._spec = spec
        self._frame = frame
        self._traits = TRAITS[spec.autopilot]
        self._is_ready = self._armed = False
        self._mode: Mode | None = None
        self._heartbeats_in_manual = 0
        self._again_ns = 0

    def receive(self, message: Any) -> None:
        """Process one message of the vehicle."""
        match message.get_type():
            case "HEARTBEAT" if message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1:
                self._armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                self._mode = self._traits.mode_of_custom(message.custom_mode)
                self._heartbeats_in_manual += self._mode is Mode.MANUAL
                if self.stage is Stage.LOITERING and self._mode is Mode.LOITER:
                    self.stage = Stage.DONE
            case "SYS_STATUS":
                healthy = message.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK
                self._is_ready = bool(healthy)
            case "STATUSTEXT":
                self.last_status = [self.last_status, *self._texts.add_chunk(message)][-1]
            case "GLOBAL_POSITION_INT":
                self._on_position(message)

    def _on_position(self, message: Any) -> None:
        is_high = message.relative_alt * 1e-3 > self._spec.alt_rel_m - _NEAR_ALTITUDE_M
        east_m, north_m = self._frame.to_local(message.lat * 1e-7, message.lon * 1e-7)
        is_near = math.hypot(east_m - self._spec.east_m, north_m - self._spec.north_m) < _NEAR_START_M
        if self.stage is Stage.WAITING and self._armed and self._mode is Mode.TAKEOFF:
            self.stage = Stage.TAKING_OFF
        elif self.stage is Stage.TAKING_OFF and is_high:
            self.stage = Stage.RETURNING
        elif self.stage is Stage.RETURNING and self._mode is Mode.RTL and is_high and is_near:
            self.stage = Stage.LOITERING

    def poll(self, t_ns: int) -> list[Any]:
        """Return the commands that are due."""
        if t_ns < self._again_ns or self.stage is Stage.DONE:
            return []
        self._again_ns = t_ns + _AGAIN_NS
        match self.stage:
            case Stage.WAITING:
                streams = {TRUE_STATE[self._spec.autopilot]: 10.0, **_STREAMS_HZ}
                commands = [self._interval(number, rate_hz) for number, rate_hz in streams.items()]
                if self._spec.autopilot == "px4":
                    commands.append(self._accept_missions_without_landing())
                if self._spec.autopilot == "px4" and self._heartbeats_in_manual < _HEARTBEATS_IN_MANUAL:
                    if self._is_ready:
                        commands.append(self._set_mode(Mode.MANUAL))
                elif self._is_ready or self._heartbeats_in_manual:
                    commands.append(self._set_mode(Mode.TAKEOFF))
                if self._mode is Mode.TAKEOFF:
                    commands.append(self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0))
                return commands
            case Stage.RETURNING:
                return [self._set_mode(Mode.RTL)]
            case Stage.LOITERING:
                return [self._set_mode(Mode.LOITER)]
        return []

    def _accept_missions_without_landing(self) -> Any:
        """Set MIS_TKO_LAND_REQ to 0. The start script's default of 2 goes before the environment's value."""
        return mavlink.MAVLink_param_set_message(
            self._spec.system_id, 1, b"MIS_TKO_LAND_REQ", 0.0, mavlink.MAV_PARAM_TYPE_INT32
        )

    def _set_mode(self, mode: Mode) -> Any:
        flag = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        custom_mode = self._traits.custom_mode(mode)
        is_px4 = self._spec.autopilot == "px4"
        numbers = ((custom_mode >> 16) & 0xFF, custom_mode >> 24) if is_px4 else (custom_mode,)
        return self._command(mavlink.MAV_CMD_DO_SET_MODE, flag, *numbers)

    def _interval(self, message_id: int, rate_hz: float) -> Any:
        return self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz)

    def _command(self, command: int, *values: float) -> Any:
        padded = (*values, *[0.0] * (7 - len(values)))
        return mavlink.MAVLink_command_long_message(self._spec.system_id, 1, command, 0, *padded)


def true_place(message: Any) -> tuple[float, float] | None:
    """Return the true latitude and longitude in degrees of a simulation's message, or None."""
    match message.get_type():
        case "SIMSTATE":
            return message.lat * 1e-7, message.lng * 1e-7
        case "HIL_STATE_QUATERNION":
            return message.lat * 1e-7, message.lon * 1e-7
    return None


def truth_messages(t_ns: int, place: tuple[float, float] | None, alt_msl_m: float = math.nan) -> list[Any]:
    """Return the messages of a true state for the simulated world; without a place, of a loss."""
    messages = [mavlink.MAVLink_system_time_message(t_ns // 1000, (t_ns // 1_000_000) & 0xFFFFFFFF)]
    if place is not None:
        lat_deg, lon_deg = place
        lat_lon_e7 = (round(lat_deg * 1e7), round(lon_deg * 1e7))
        state = mavlink.MAVLink_sim_state_message(
            1.0, *[0.0] * 12, *place, alt_msl_m, *[0.0] * 5, *lat_lon_e7
        )
        messages.append(state)
    return messages
