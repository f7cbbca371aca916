"""Aircraft that are not ours: ADS-B traffic that our vehicles receive (ADSB_VEHICLE).

Source: https://mavlink.io/en/messages/common.html#ADSB_VEHICLE. Several vehicles may receive one aircraft:
the newest report of its ICAO address counts. An aircraft is predicted to fly straight on. Its height is a
band: by ADS-B it is mostly a pressure altitude. A report that agrees with one of our vehicles is of its own
transponder.
"""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.core.separation.forward_flight import Flight, Goal, GoalKind
from gcs.core.separation.records import Aircraft, SeparationState
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.adsb import UNASSIGNED_ICAO_BLOCK
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, vehicle_name
from gcs.safe_text import printable

_FIRST: Final = 1 << 24
"""Number of the aircraft with ICAO address 0; those of our vehicles are lower."""
_MAX_AIRCRAFT: Final = 64
_MAX_AGE_NS: Final = ns(15.0)
_MAX_DISTANCE_M: Final = 50_000.0
_MAX_SPEED_M_S: Final = 400.0
_PRESSURE_ERROR_M: Final = 100.0
_GEOMETRIC_ERROR_M: Final = 30.0
_OWN_DISTANCE_M: Final = 60.0
_OWN_HEIGHT_M: Final = 120.0
_OWN_SPEED_M_S: Final = 6.0
"""Differences of a report from one of our vehicles within which it is of that vehicle."""
_NEEDED: Final[int] = dialect.ADSB_FLAGS_VALID_COORDS | dialect.ADSB_FLAGS_VALID_ALTITUDE
_MOTION: Final[int] = dialect.ADSB_FLAGS_VALID_HEADING | dialect.ADSB_FLAGS_VALID_VELOCITY


def is_aircraft(number: int) -> bool:
    """Return True if a number is of an aircraft, and not of one of our vehicles."""
    return number >= _FIRST


class AirTraffic:
    """Aircraft near the swarm, at most `_MAX_AIRCRAFT`."""

    def __init__(self, config: Config, fleet: Fleet, state: SeparationState) -> None:
        self._frame = config.local_frame
        self._fleet = fleet
        self._aircraft = state.aircraft

    def receive(self, message: Message, t_ns: int) -> None:
        """Process an ADSB_VEHICLE; one without a position or a height is ignored."""
        report = self._report(message, t_ns)
        number = _FIRST + message.ICAO_address
        before = self._aircraft.get(number)
        if report is None or (before is not None and before.t_ns > report.t_ns):
            return
        self._aircraft.pop(number, None)
        if self._is_own(report):
            return
        if len(self._aircraft) >= _MAX_AIRCRAFT:
            del self._aircraft[min(self._aircraft, key=lambda one: self._aircraft[one].t_ns)]
        self._aircraft[number] = report

    def flights(self, t_ns: int) -> list[Flight]:
        """Return the predicted flights of the aircraft that were received lately."""
        for number in [n for n, one in self._aircraft.items() if t_ns - one.t_ns > _MAX_AGE_NS]:
            del self._aircraft[number]
        return [
            Flight(
                number,
                one.east_m,
                one.north_m,
                one.alt_msl_m,
                one.speed_m_s,
                one.course_rad,
                one.climb_m_s,
                0.0,
                1.0,
                (Goal(GoalKind.DRIFT),),
                max(t_ns - one.t_ns, 0) / NS_PER_S,
                height_error_m=one.height_error_m,
            )
            for number, one in sorted(self._aircraft.items())
        ]

    def name(self, number: int) -> str:
        """Return a vehicle or an aircraft in words."""
        if not is_aircraft(number):
            return f"agent {vehicle_name(number)}"
        callsign = self._aircraft[number].callsign if number in self._aircraft else ""
        return f"aircraft {number - _FIRST:06X}" + (f" ({callsign})" if callsign else "")

    def _report(self, message: Message, t_ns: int) -> Aircraft | None:
        lat_deg = message.lat * 1e-7
        lon_deg = message.lon * 1e-7
        is_valid = message.flags & _NEEDED == _NEEDED and abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0
        if not is_valid or not 0 <= message.ICAO_address < UNASSIGNED_ICAO_BLOCK:
            return None  # the block is used for target tracks that we send
        east_m, north_m = self._frame.to_local(lat_deg, lon_deg)
        speed_m_s = message.hor_velocity * 0.01
        if math.hypot(east_m, north_m) > _MAX_DISTANCE_M or speed_m_s > _MAX_SPEED_M_S:
            return None
        is_moving = message.flags & _MOTION == _MOTION
        is_climbing = bool(message.flags & dialect.ADSB_FLAGS_VERTICAL_VELOCITY_VALID)
        is_geometric = message.altitude_type == dialect.ADSB_ALTITUDE_TYPE_GEOMETRIC
        return Aircraft(
            t_ns=t_ns - message.tslc * NS_PER_S,
            east_m=east_m,
            north_m=north_m,
            alt_msl_m=message.altitude * 1e-3,
            speed_m_s=speed_m_s if is_moving else 0.0,
            course_rad=math.radians(message.heading * 0.01) if is_moving else 0.0,
            climb_m_s=message.ver_velocity * 0.01 if is_climbing else 0.0,
            height_error_m=_GEOMETRIC_ERROR_M if is_geometric else _PRESSURE_ERROR_M,
            callsign=printable(message.callsign.strip()),
        )

    def _is_own(self, report: Aircraft) -> bool:
        """Return True if one of our vehicles flies where and as a report says."""
        for state in self._fleet.states():
            ahead_s = (report.t_ns - state.t_ns) / NS_PER_S
            moved_m = state.ground_speed_m_s * ahead_s
            east_m = state.east_m + moved_m * math.sin(state.course_rad) - report.east_m
            north_m = state.north_m + moved_m * math.cos(state.course_rad) - report.north_m
            is_there = math.hypot(east_m, north_m) < _OWN_DISTANCE_M
            is_high = abs(state.alt_msl_m - report.alt_msl_m) < _OWN_HEIGHT_M
            v_east = state.ground_speed_m_s * math.sin(state.course_rad)
            v_north = state.ground_speed_m_s * math.cos(state.course_rad)
            v_east -= report.speed_m_s * math.sin(report.course_rad)
            v_north -= report.speed_m_s * math.cos(report.course_rad)
            if is_there and is_high and math.hypot(v_east, v_north) < _OWN_SPEED_M_S:
                return True
        return False
