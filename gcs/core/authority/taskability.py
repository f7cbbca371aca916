"""Vehicles that must not be tasked, for any reason: orders, overrides, other ground stations, take-offs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gcs.core.authority.external_uploads import ExternalUploads
from gcs.core.authority.onboard_audit import OnboardAudit
from gcs.core.operator.vehicle_orders import Orders
from gcs.core.takeoff.climbs import Climbs
from gcs.core.tasking.mission_ends import MissionEnds
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import Authority, Suspension

_AUTHORITY_OF: Final[dict[Suspension, Authority]] = {
    "hold": "held",
    "return": "returning",
    "found": "other station",
}
_TASKABLE_MODES = ("", "AUTO", "LOITER")
"""Before the first heartbeat, on a mission, and waiting for one."""


@dataclass(frozen=True, slots=True)
class Taskability:
    """Combines all reasons not to task a vehicle, from the stages that know them."""

    fleet: Fleet
    tasking: UploadManager
    orders: Orders
    external_uploads: ExternalUploads
    onboard_audit: OnboardAudit
    mission_ends: MissionEnds
    climbs: Climbs

    def untaskable(self) -> dict[int, str]:
        """Return the vehicles that are not ours to task, with the reason in words."""
        modes = {
            state.system_id: f"is in {state.mode} and left alone"
            for state in self.fleet.states()
            if state.mode not in _TASKABLE_MODES and not self._missed_in_rtl(state.system_id)
        }
        others = self.external_uploads.untaskable() | self.onboard_audit.untaskable()
        return modes | self.tasking.overrides.untaskable() | others | self.orders.untaskable()

    def authority(self, vehicle: int) -> Authority:
        """Return who controls a vehicle."""
        suspension = self.orders.suspensions.get(vehicle)
        if vehicle not in self.untaskable():
            return "grounded" if vehicle in self.climbs.blocked else "ours"
        if vehicle in self.orders.untaskable():
            return "ours" if suspension is None else _AUTHORITY_OF[suspension]
        if vehicle in self.onboard_audit.untaskable():
            return "unverified"
        if vehicle in self.external_uploads.untaskable():
            return "other station"
        if self.fleet.link(vehicle) and self.fleet.profile(vehicle) is None:
            return "unsupported"
        return "landing" if self.tasking.terminal_phase(vehicle) == "landing" else "overridden"

    def without_missions(self) -> dict[int, str]:
        """Return the vehicles that get no mission now: untaskable, or without a clear take-off."""
        blocked = dict.fromkeys(self.climbs.blocked, "stands where its take-off is not clear")
        return blocked | self.untaskable()

    def overridden(self) -> dict[int, str]:
        """Return the overriding modes by vehicle, except modes that orders here asked for."""
        modes = self.tasking.overrides.modes()
        return {v: mode for v, mode in modes.items() if not self.orders.has_ordered(v, mode)}

    def _missed_in_rtl(self, vehicle: int) -> bool:
        """Return True if a vehicle completed its mission, into RTL, without having reached its target."""
        return self.tasking.overrides.has_completed(vehicle) and self.mission_ends.has_missed(vehicle)
