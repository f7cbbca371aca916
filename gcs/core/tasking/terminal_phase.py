"""Phase of a mission behind the last point of its route: terminal loiter, return route, landing, or RTL."""

from __future__ import annotations

from typing import Literal, TypeAlias

from pymavlink.dialects.v20.ardupilotmega import MAV_CMD_NAV_LAND, MAV_CMD_NAV_LOITER_UNLIM

from gcs.core.tasking.tasking_state import AgentTasking
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.fleet.fleet_state import ModeRecord, VehicleLink

TerminalPhase: TypeAlias = Literal["", "circle", "circle elsewhere", "return route", "landing", "return"]
"""Empty before the last point; "return": RTL after the last item."""


def terminal_phase(tasking: AgentTasking, link: VehicleLink, mode: ModeRecord) -> TerminalPhase:
    """Return the phase of the current item of a vehicle; empty unless it flies its verified mission."""
    if mode.has_ended:
        return "return"
    mission = tasking.onboard
    if mission is None or not tasking.is_selected or link.mode != AUTO or not link.armed:
        return ""
    seq = link.mission_seq
    if not mission.first_point + len(mission.route.points_m) <= seq < len(mission.items):
        return ""
    command = mission.items[seq].command
    if command == MAV_CMD_NAV_LOITER_UNLIM:
        return "circle" if mission.route.wait_m is None else "circle elsewhere"
    return "landing" if command == MAV_CMD_NAV_LAND else "return route"
