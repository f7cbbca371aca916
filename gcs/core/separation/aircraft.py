"""Aircraft that are not ours: those that we know of, how many, and how long they are kept unheard.

ADS-B (ADSB_VEHICLE) and Remote ID (OPEN_DRONE_ID_*), see `gcs.core.separation.traffic_reports`. Several
vehicles may receive one aircraft: its newest report counts. An aircraft is predicted to fly straight on. Its
height is a band. A report that agrees with one of our vehicles is of its own transponder.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from gcs.config import Config
from gcs.core.separation.forward_flight import Flight, Goal, GoalKind
from gcs.core.separation.separation_state import Aircraft, SeparationState
from gcs.core.separation.traffic_reports import (
    FIRST_ADSB,
    remote_id_number,
    traffic_name,
    traffic_report,
    uas_id,
)
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, vehicle_name

_MAX_AIRCRAFT: Final = 64
_MAX_AGE_NS: Final = ns(15.0)
_OWN_DISTANCE_M: Final = 60.0
_OWN_HEIGHT_M: Final = 120.0
_OWN_SPEED_M_S: Final = 6.0
"""Differences of a report from one of our vehicles within which it is of that vehicle."""


def is_aircraft(number: int) -> bool:
    """Return True if a number is of an aircraft, and not of one of our vehicles."""
    return number >= FIRST_ADSB


class AirTraffic:
    """Aircraft near the swarm, at most `_MAX_AIRCRAFT`."""

    def __init__(self, config: Config, fleet: Fleet, state: SeparationState) -> None:
        self._frame = config.local_frame
        self._fleet = fleet
        self._aircraft = state.aircraft

    def receive(self, message: Message, t_ns: int) -> None:
        """Process a message about an aircraft; one without a position or a height is ignored."""
        if message.get_type() == "OPEN_DRONE_ID_BASIC_ID":
            self._name(message)
            return
        number, report = traffic_report(message, self._frame, t_ns)
        before = self._aircraft.get(number)
        if report is None or (before is not None and before.t_ns > report.t_ns):
            return
        self._aircraft.pop(number, None)
        if self._is_own(report):
            return
        if before is not None and not report.callsign:
            report = replace(report, callsign=before.callsign)
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
        return traffic_name(number) + (f" ({callsign})" if callsign else "")

    def _name(self, message: Message) -> None:
        """Keep the serial number or registration of a drone whose position is known."""
        number = remote_id_number(message)
        if number in self._aircraft:
            self._aircraft[number] = replace(self._aircraft[number], callsign=uas_id(message))

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
