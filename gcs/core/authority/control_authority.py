"""Control authority over all vehicles: only those that are ours get missions.

Orders, uploads of other stations, audits and mode changes are events of a vehicle's control
(`gcs.model.control`) when they happen. `update` adds the events that follow from other states.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from gcs.core.operator.vehicle_orders import Orders
from gcs.core.state import Agent
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import Control, ControlEvent

_MISSION_MODES: Final = ("", "AUTO", "LOITER")
"""Before the first heartbeat, on a mission, and waiting for one."""


@dataclass(frozen=True, slots=True)
class ControlAuthority:
    """Control of all vehicles."""

    agents: Mapping[int, Agent]
    fleet: Fleet
    tasking: UploadManager
    orders: Orders

    def update(self, t_ns: int) -> None:
        """Apply the events that follow from modes, missions, commands and climbs."""
        for vehicle in self.agents:
            self.updated(vehicle, t_ns)

    def updated(self, vehicle: int, t_ns: int) -> Control:
        """Apply these events to one vehicle; return its control."""
        control = self.agents[vehicle].control
        for event, detail in self._events(vehicle):
            control.apply(event, t_ns, detail)
        return control

    def _events(self, vehicle: int) -> Iterator[tuple[ControlEvent, str]]:
        state = self.fleet.state(vehicle)
        mode = "" if state is None else state.mode
        missions, agent = self.tasking.onboard_missions, self.agents[vehicle]
        has_missed_in_rtl = agent.authority.mode.has_ended and missions.has_missed(vehicle)
        is_mission_mode = mode in _MISSION_MODES or has_missed_in_rtl
        is_landing = missions.terminal_phase(vehicle) == "landing"
        is_unknown = bool(self.fleet.link(vehicle)) and self.fleet.profile(vehicle) is None
        is_blocked = bool(agent.takeoff.blocked)
        if is_mission_mode:
            yield ControlEvent.MISSION_MODE_SEEN, ""
        else:
            yield ControlEvent.OTHER_MODE_SEEN, mode
        yield ControlEvent.LANDING_BEGUN if is_landing else ControlEvent.LANDING_ENDED, ""
        yield ControlEvent.FIRMWARE_UNKNOWN if is_unknown else ControlEvent.FIRMWARE_KNOWN, ""
        yield ControlEvent.TAKEOFF_BLOCKED if is_blocked else ControlEvent.TAKEOFF_CLEAR, ""
        is_waiting = self.orders.is_waiting(vehicle)
        yield ControlEvent.WAIT_COMMANDED if is_waiting else ControlEvent.WAIT_ENDED, ""
