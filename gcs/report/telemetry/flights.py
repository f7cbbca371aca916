"""Flights of vehicles from telemetry: position, height, speed and flight mode over time.

Read from GLOBAL_POSITION_INT and HEARTBEAT of a recording or telemetry log. Impossible positions (before the
first fix, beyond `_MAX_DISTANCE_M` of the origin) are left out. At most two positions a second are kept, and
at most `_MOST` for each vehicle. The path is smoothed, and checked for position jumps (`smoothed_path`).
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.geo import LocalFrame
from gcs.mavlink.autopilots import profile_of
from gcs.mavlink.fleet.checks.position_checks import position_problem
from gcs.mavlink.frames.codec import Frame, Message
from gcs.model import NS_PER_S, FloatArray, IntArray, read_only
from gcs.planning.terrain.ground import Terrain
from gcs.report.telemetry.smoothed_path import smooth_path

_LEAST_NS: Final = NS_PER_S // 2
_MOST: Final = 40_000
_MOST_MODES: Final = 2_000
_MAX_VEHICLES: Final = 250
_MAX_JUMPS_LISTED: Final = 5
_MAX_DISTANCE_M: Final = 200_000.0
_COLUMNS: Final = 8
_READ: Final = frozenset({dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_HEARTBEAT})
_PLANE_LIKE: Final = frozenset({dialect.MAV_TYPE_FIXED_WING, *range(19, 26)})
"""Aeroplanes and the VTOL types of MAV_TYPE."""


class PositionJump(NamedTuple):
    """A jump of a vehicle's reported position."""

    t_s: float
    size_m: float


@dataclass(frozen=True, slots=True)
class Flight:
    """Telemetry of one vehicle. Times are seconds since the start of the recording."""

    system_id: int
    t_s: FloatArray
    """(n,)."""
    points_m: FloatArray
    """(n, 2) east/north of the origin."""
    alt_rel_m: FloatArray
    """(n,) reported height above home."""
    alt_msl_m: FloatArray
    """(n,) reported height above mean sea level."""
    ground_speed_m_s: FloatArray
    """(n,)."""
    modes: tuple[tuple[float, str, bool], ...]
    """(start, mode, True if armed)."""
    heard_s: float
    """Time of the last frame."""
    length_m: float
    """Length of the smoothed path, without jumps."""
    jumps: tuple[PositionJump, ...]


class Reports(NamedTuple):
    """Reported positions of one vehicle, as they were received."""

    t_ns: IntArray
    """(n,) in order."""
    places: FloatArray
    """(n, 3) latitude and longitude in degrees, metres above mean sea level."""


@dataclass(slots=True)
class _Vehicle:
    t_ns: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    """Of each report: east, north, height above home, speed, boot time; latitude, longitude, height MSL."""
    modes: list[tuple[int, str, bool]] = field(default_factory=list)
    least_ns: int = _LEAST_NS
    heard_ns: int = 0


class Flights:
    """Collects telemetry from frames.

    Parameters
    ----------
    frame : LocalFrame, optional
        Frame of east and north; by default at the first reported position.
    """

    def __init__(self, frame: LocalFrame | None = None) -> None:
        self.frame = frame
        self._vehicles: dict[int, _Vehicle] = {}

    def add_frame(self, t_ns: int, frame: Frame) -> None:
        """Add a frame with a valid checksum; only positions and heartbeats are used."""
        if frame.message_id not in _READ:
            return
        vehicle = self._vehicles.get(frame.system_id)
        if vehicle is not None:
            vehicle.heard_ns = max(vehicle.heard_ns, t_ns)
        is_position = frame.message_id == dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
        if is_position and vehicle and vehicle.t_ns and 0 <= t_ns - vehicle.t_ns[-1] < vehicle.least_ns:
            return
        message = frame.message()
        if message is None:
            return
        if not is_position and (
            message.type == dialect.MAV_TYPE_GCS or message.autopilot == dialect.MAV_AUTOPILOT_INVALID
        ):
            return
        if vehicle is None:
            if len(self._vehicles) >= _MAX_VEHICLES:
                return
            vehicle = self._vehicles[frame.system_id] = _Vehicle(heard_ns=t_ns)
        if is_position:
            self._position(vehicle, t_ns, message)
        else:
            _mode(vehicle, t_ns, message)

    def _position(self, vehicle: _Vehicle, t_ns: int, message: Message) -> None:
        lat_deg = message.lat * 1e-7
        lon_deg = message.lon * 1e-7
        alt_msl_m = message.alt * 1e-3
        origin = self.frame if self.frame is not None else LocalFrame(lat_deg, lon_deg, alt_msl_m)
        if position_problem(lat_deg, lon_deg, alt_msl_m, origin, _MAX_DISTANCE_M):
            return
        self.frame = origin
        speed_m_s = math.hypot(message.vx, message.vy) * 1e-2
        vehicle.t_ns.append(t_ns)
        vehicle.values.extend((
            *origin.to_local(lat_deg, lon_deg), message.relative_alt * 1e-3, speed_m_s,
            message.time_boot_ms * 1e-3, lat_deg, lon_deg, alt_msl_m,
        ))  # fmt: skip
        if len(vehicle.t_ns) > _MOST:
            vehicle.least_ns *= 2
            vehicle.t_ns = vehicle.t_ns[::2]
            vehicle.values = array("d", np.array(vehicle.values).reshape(-1, _COLUMNS)[::2].ravel())

    def reports(self) -> dict[int, Reports]:
        """Return the reported positions of each vehicle with telemetry."""
        found = {}
        for system_id, vehicle in sorted(self._vehicles.items()):
            t_ns = np.array(vehicle.t_ns, dtype=np.int64)
            order = np.argsort(t_ns, kind="stable")
            places = np.array(vehicle.values).reshape(-1, _COLUMNS)[order, 5:]
            found[system_id] = Reports(t_ns[order], read_only(places))
        return found

    def flights(self, start_t_ns: int) -> dict[int, Flight]:
        """Return the flight of each vehicle with telemetry."""
        found = {}
        for system_id, vehicle in sorted(self._vehicles.items()):
            t_s = (np.array(vehicle.t_ns, dtype=np.int64) - start_t_ns) / NS_PER_S
            order = np.argsort(t_s, kind="stable")  # a clock that was set back must not draw lines across
            values = np.array(vehicle.values).reshape(-1, _COLUMNS)
            path = smooth_path(values[:, 4], values[:, :2])
            jumps = tuple(PositionJump(float(t_s[jump.report]), jump.size_m) for jump in path.jumps)
            values = values[order]
            modes = tuple(
                ((t_ns - start_t_ns) / NS_PER_S, mode, armed) for t_ns, mode, armed in vehicle.modes
            )
            found[system_id] = Flight(
                system_id, read_only(t_s[order]), read_only(values[:, :2]), read_only(values[:, 2]),
                read_only(values[:, 7]), read_only(values[:, 3]), modes,
                (vehicle.heard_ns - start_t_ns) / NS_PER_S, path.length_m, jumps,
            )  # fmt: skip
        return found


def agl_m(flight: Flight, terrain: Terrain) -> FloatArray:
    """Return the height of each report above the ground, (n,); NaN beyond the elevation model."""
    above: FloatArray = flight.alt_msl_m - terrain.elevation.heights_at(flight.points_m)
    return above


def least_agl_m(flight: Flight, terrain: Terrain) -> float | None:
    """Return the least height above ground between the first and the last time above the floor of the band.

    So take-off and landing are left out. None: it was never above the floor.
    """
    above_m = agl_m(flight, terrain)
    inside = np.flatnonzero(above_m >= terrain.min_agl_m)
    return float(np.nanmin(above_m[inside[0] : inside[-1] + 1])) if len(inside) else None


def jump_lines(flights: Mapping[int, Flight]) -> list[str]:
    """Return a line for each vehicle whose reported position jumps."""
    lines = []
    for system_id, flight in flights.items():
        listed = [f"{jump.size_m:.0f} m at {jump.t_s:.1f} s" for jump in flight.jumps[:_MAX_JUMPS_LISTED]]
        more = len(flight.jumps) - len(listed)
        if listed:
            text = ", ".join(listed) + (f" and {more} more" if more else "")
            lines.append(f"Vehicle {system_id}: the reported position jumps by {text}.")
    return lines


def _mode(vehicle: _Vehicle, t_ns: int, message: Message) -> None:
    """Add a mode when it changes; unknown modes are numbers."""
    plane_like = message.autopilot == dialect.MAV_AUTOPILOT_PX4 or message.type in _PLANE_LIKE
    profile = profile_of(message.autopilot) if plane_like else None
    mode = _copter_mode(message) if profile is None else profile.mode_name(message.custom_mode)
    armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
    if (not vehicle.modes or vehicle.modes[-1][1:] != (mode, armed)) and len(vehicle.modes) < _MOST_MODES:
        vehicle.modes.append((t_ns, mode, armed))


def _copter_mode(message: Message) -> str:
    """Return the mode name of a vehicle other than an aeroplane, from pymavlink's tables."""
    from pymavlink.mavutil import mode_mapping_bynumber

    names = mode_mapping_bynumber(message.type) or {}
    return str(names.get(message.custom_mode, f"MODE({message.custom_mode})"))
