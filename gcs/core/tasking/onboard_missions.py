"""Onboard missions by the last read-back, and the progress of vehicles in them.

A vehicle must not reach its next item while its mission is inconsistent (`gcs.mavlink.mission.upload_task`):
it would be put into LOITER, an unplanned turn. A vehicle that is about to pass an item does so within
seconds, so the upload waits for that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from pymavlink.dialects.v20.ardupilotmega import (
    MAV_CMD_NAV_LAND,
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_TAKEOFF,
)

from gcs.core.tasking.upload_latency import DELIVERY_S
from gcs.mavlink.autopilots import AutopilotProfile
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.upload_timing import UploadTiming
from gcs.model import NS_PER_S, Route
from gcs.planning.route_progress import time_to_point_s
from gcs.planning.vehicle_model import LoiterCircle, RemainingMission

TerminalPhase: TypeAlias = Literal["", "circle", "circle elsewhere", "return route", "landing", "return"]
"""Phase of a mission behind its route; "return": RTL after the last item."""

_REPORT_DELAY_S: Final = 0.3
"""Time until a vehicle reports that it has passed an item."""


@dataclass(frozen=True, slots=True)
class OnboardMission:
    """Onboard mission of one vehicle, by the last read-back."""

    route: Route
    items: tuple[Item, ...]
    first_point: int
    """Number of the item that is the route's first point."""

    @property
    def circle(self) -> LoiterCircle | None:
        """Loiter circle at the end; None if the autopilot sets the radius, or the vehicle lands."""
        radius_m = self.items[-1].param3 if self.items[-1].command == MAV_CMD_NAV_LOITER_UNLIM else 0.0
        east_m, north_m = self.route.flown_m[-1].tolist()
        return LoiterCircle((east_m, north_m), radius_m) if radius_m > 0.0 else None


class OnboardMissions:
    """Onboard missions of all vehicles.

    Parameters
    ----------
    stays : bool
        True if missions end with a loiter circle without a time limit.
    """

    def __init__(self, fleet: Fleet, *, stays: bool) -> None:
        self._fleet, self._stays = fleet, stays
        self._missions: dict[int, OnboardMission] = {}
        self._unselected: set[int] = set()

    def of(self, vehicle: int) -> OnboardMission | None:
        """Return the onboard mission of a vehicle; None if it is unknown."""
        return self._missions.get(vehicle)

    def note(self, mission: OnboardMission) -> None:
        """Note a verified mission."""
        self._missions[mission.route.vehicle] = mission

    def forget(self, vehicle: int) -> None:
        """Note that the onboard mission of a vehicle is unknown."""
        self._missions.pop(vehicle, None)

    def select(self, vehicle: int, *, selected: bool = True) -> None:
        """Note whether a vehicle flies its onboard mission, or still counts items of the one before."""
        (self._unselected.discard if selected else self._unselected.add)(vehicle)

    def points_ahead(self, vehicle: int) -> tuple[tuple[float, float], ...]:
        """Return the remaining route points of the onboard mission, the next one first; none but in AUTO."""
        mission, state = self._missions.get(vehicle), self._fleet.state(vehicle)
        if mission is None or state is None or state.mode != AUTO or vehicle in self._unselected:
            return ()
        if state.mission_seq < mission.first_point:
            return ()
        left = mission.route.points_m[state.mission_seq - mission.first_point :]
        return tuple((east_m, north_m) for east_m, north_m in left.tolist())

    def forward_simulation(self, vehicle: int, wait_s: float, t_ns: int) -> RemainingMission:
        """Return what a vehicle flies if it gets no other mission before `wait_s`."""
        points = self.points_ahead(vehicle)
        if not points:
            return RemainingMission()
        mission = self._missions[vehicle]
        last = mission.first_point + len(mission.route.points_m)
        radii = tuple(item.param2 for item in mission.items[last - len(points) : last])
        next_s = max(0.0, self.time_to_next_s(vehicle, t_ns))
        return RemainingMission(points, radii, wait_s, next_s, mission.circle)

    def is_in_takeoff(self, vehicle: int) -> bool:
        """Return True if a vehicle in AUTO flies to its take-off item."""
        mission, state = self._missions.get(vehicle), self._fleet.state(vehicle)
        if mission is None or state is None or not state.armed or state.mode != AUTO:
            return False
        seq = state.mission_seq
        return 0 <= seq == mission.first_point - 1 and mission.items[seq].command == MAV_CMD_NAV_TAKEOFF

    def has_passed_route_end(self, vehicle: int) -> bool:
        """Return True if a vehicle has passed the last point of its route, on a loiter circle elsewhere."""
        mission, state = self._missions.get(vehicle), self._fleet.state(vehicle)
        if mission is None or mission.route.wait_m is None or vehicle in self._unselected:
            return False
        passed = 0 if state is None or state.mode != AUTO else state.mission_seq - mission.first_point
        return passed >= len(mission.route.points_m)

    def terminal_phase(self, vehicle: int) -> TerminalPhase:
        """Return the phase of a mission behind the last point of its route; empty before that."""
        mission, state = self._missions.get(vehicle), self._fleet.state(vehicle)
        if mission is None or state is None or state.mode != AUTO or vehicle in self._unselected:
            return ""
        seq = state.mission_seq
        if not state.armed or not mission.first_point + len(mission.route.points_m) <= seq < len(
            mission.items
        ):
            return ""
        if mission.items[seq].command == MAV_CMD_NAV_LOITER_UNLIM:
            return "circle" if mission.route.wait_m is None else "circle elsewhere"
        return "landing" if mission.items[seq].command == MAV_CMD_NAV_LAND else "return route"

    def is_at_end(self, vehicle: int, profile: AutopilotProfile) -> bool:
        """Return True if LOITER is how the vehicle's mission ends, and it has reached its last item."""
        mission, state = self._missions.get(vehicle), self._fleet.state(vehicle)
        if profile.ends_in != LOITER or mission is None or state is None:
            return False
        return state.mission_seq == len(mission.items) - 1

    def time_to_next_s(self, vehicle: int, t_ns: int) -> float:
        """Return the time until a vehicle reaches its current item; 0 if that is unknown."""
        mission, state = self._missions.get(vehicle), self._fleet.state(vehicle)
        if mission is None or state is None or vehicle in self._unselected:
            return 0.0
        if state.mission_seq < mission.first_point:
            return 0.0
        place, index = (state.east_m, state.north_m), state.mission_seq - mission.first_point
        if index >= len(mission.route.points_m):
            return math.inf if self._stays else 0.0
        points_m, speed_m_s = mission.route.points_m, state.ground_speed_m_s
        radius_m = mission.items[state.mission_seq].param2 if state.mission_seq < len(mission.items) else 0.0
        to_go_s = time_to_point_s(points_m, index, place, speed_m_s, radius_m)
        return to_go_s - (t_ns - state.t_ns) / NS_PER_S

    def item_wait_s(self, vehicle: int, t_ns: int) -> float:
        """Return how long an upload should wait until the vehicle has passed its current item."""
        profile = self._fleet.profile(vehicle)
        if profile is None or profile.atomic or not self.points_ahead(vehicle):
            return 0.0
        to_go_s = self.time_to_next_s(vehicle, t_ns)
        return to_go_s + _REPORT_DELAY_S if to_go_s < UploadTiming().guard_s + DELIVERY_S else 0.0
