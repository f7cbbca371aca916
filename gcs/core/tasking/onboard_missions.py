"""Onboard missions by the last read-back, and the progress of vehicles in them.

A vehicle must not reach its next item while its mission is inconsistent (`gcs.mavlink.mission.upload_rules`):
it would be put into LOITER, an unplanned turn. A vehicle that is about to pass an item does so within
seconds, so the upload waits for that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from pymavlink.dialects.v20.ardupilotmega import (
    MAV_CMD_NAV_LOITER_UNLIM,
    MAV_CMD_NAV_TAKEOFF,
    MAV_CMD_NAV_WAYPOINT,
    MAV_FRAME_GLOBAL,
)

from gcs.core.state import Agent
from gcs.core.tasking.tasking_state import OnboardMission
from gcs.core.tasking.terminal_phase import TerminalPhase, terminal_phase
from gcs.core.tasking.upload_latency import DELIVERY_S
from gcs.mavlink.autopilots import AutopilotProfile
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.upload_limits import UploadLimits
from gcs.model import NS_PER_S, VehicleState
from gcs.planning.forward_simulation import RemainingMission
from gcs.planning.route_progress import time_to_point_s

_REPORT_DELAY_S: Final = 0.3
"""Time until a vehicle reports that it has passed an item."""


class OnboardMissions:
    """Onboard missions of all vehicles."""

    def __init__(self, fleet: Fleet, agents: Mapping[int, Agent]) -> None:
        self._fleet = fleet
        self._agents = agents

    def note(self, mission: OnboardMission) -> None:
        """Note a verified mission."""
        self._agents[mission.route.vehicle].tasking.onboard = mission

    def _selected(self, vehicle: int) -> tuple[OnboardMission, VehicleState] | None:
        """Return the onboard mission and the state of a vehicle that counts the items of this mission."""
        tasking = self._agents[vehicle].tasking
        state = self._fleet.state(vehicle)
        if tasking.onboard is None or state is None or not tasking.is_selected:
            return None
        return tasking.onboard, state

    def _flown(self, vehicle: int) -> tuple[OnboardMission, VehicleState] | None:
        """Return the same for a vehicle in AUTO."""
        selected = self._selected(vehicle)
        return None if selected is None or selected[1].mode != AUTO else selected

    def points_ahead(self, vehicle: int) -> tuple[tuple[float, float], ...]:
        """Return the remaining route points of the onboard mission, the next one first; none but in AUTO."""
        flown = self._flown(vehicle)
        if flown is None or flown[1].mission_seq < flown[0].first_point:
            return ()
        mission, state = flown
        left = mission.route.points_m[state.mission_seq - mission.first_point :]
        return tuple((east_m, north_m) for east_m, north_m in left.tolist())

    def heights_ahead_msl_m(self, vehicle: int) -> tuple[float, ...]:
        """Return the heights of the points of `points_ahead`, as far as the height of home is known."""
        count = len(self.points_ahead(vehicle))
        onboard = self._agents[vehicle].tasking.onboard
        if not count or onboard is None:
            return ()
        last = onboard.first_point + len(onboard.route.points_m)
        return self.heights_msl_m(vehicle, onboard.items[last - count : last])

    def heights_msl_m(self, vehicle: int, items: Sequence[Item]) -> tuple[float, ...]:
        """Return the heights of mission items above sea level, as far as the height of home is known."""
        home = self._fleet.home(vehicle)
        home_m = 0.0 if home is None else home.alt_msl_m
        return tuple(item.z_m + home_m * (item.frame != MAV_FRAME_GLOBAL) for item in items)

    def return_items_ahead(self, vehicle: int) -> tuple[Item, ...]:
        """Return the waypoints that are left of the return route that a vehicle flies, before its descent."""
        flown = self._flown(vehicle)
        if flown is None or self.terminal_phase(vehicle) != "return route":
            return ()
        mission, state = flown
        left = mission.items[state.mission_seq :]
        return tuple(item for item in left if item.command == MAV_CMD_NAV_WAYPOINT)

    def forward_simulation(self, vehicle: int, wait_s: float, t_ns: int) -> RemainingMission:
        """Return what a vehicle flies if it gets no other mission before `wait_s`."""
        points = self.points_ahead(vehicle)
        mission = self._agents[vehicle].tasking.onboard
        if not points or mission is None:
            return RemainingMission()
        last = mission.first_point + len(mission.route.points_m)
        radii = tuple(item.param2 for item in mission.items[last - len(points) : last])
        next_s = max(0.0, self.time_to_next_s(vehicle, t_ns))
        return RemainingMission(points, radii, wait_s, next_s, mission.circle)

    def is_in_takeoff(self, vehicle: int) -> bool:
        """Return True if a vehicle in AUTO flies to its take-off item."""
        mission = self._agents[vehicle].tasking.onboard
        state = self._fleet.state(vehicle)
        if mission is None or state is None or not state.armed or state.mode != AUTO:
            return False
        seq = state.mission_seq
        is_before_route = seq >= 0 and seq == mission.first_point - 1
        return is_before_route and mission.items[seq].command == MAV_CMD_NAV_TAKEOFF

    def has_passed_route_end(self, vehicle: int) -> bool:
        """Return True if a vehicle has passed its target's place on the way to a loiter circle elsewhere."""
        flown = self._flown(vehicle)
        if flown is None or flown[0].route.wait_m is None:
            return False
        mission, state = flown
        route = mission.route
        target_point = route.target_point % len(route.points_m)
        return state.mission_seq - mission.first_point > target_point

    def has_missed(self, vehicle: int) -> bool:
        """Return True if a vehicle has passed its target, and its mission does not lead back to it."""
        has_missed = self._agents[vehicle].tasking.route_end.has_missed
        return has_missed or self.has_passed_route_end(vehicle)

    def terminal_phase(self, vehicle: int) -> TerminalPhase:
        """Return the phase of a mission behind the last point of its route; empty before that."""
        agent = self._agents[vehicle]
        return terminal_phase(agent.tasking, agent.link, agent.authority.mode)

    def is_at_end(self, vehicle: int, profile: AutopilotProfile) -> bool:
        """Return True if LOITER is how the vehicle's mission ends, and it has reached its last item."""
        mission = self._agents[vehicle].tasking.onboard
        state = self._fleet.state(vehicle)
        if profile.ends_in != LOITER or mission is None or state is None:
            return False
        return state.mission_seq == len(mission.items) - 1

    def time_to_next_s(self, vehicle: int, t_ns: int) -> float:
        """Return the time until a vehicle reaches its current item; 0 if that is unknown."""
        selected = self._selected(vehicle)
        if selected is None or selected[1].mission_seq < selected[0].first_point:
            return 0.0
        mission, state = selected
        place = (state.east_m, state.north_m)
        index = state.mission_seq - mission.first_point
        if index >= len(mission.route.points_m):
            return math.inf if mission.items[-1].command == MAV_CMD_NAV_LOITER_UNLIM else 0.0
        radius_m = mission.items[state.mission_seq].param2 if state.mission_seq < len(mission.items) else 0.0
        to_go_s = time_to_point_s(mission.route.points_m, index, place, state.ground_speed_m_s, radius_m)
        return to_go_s - (t_ns - state.t_ns) / NS_PER_S

    def item_wait_s(self, vehicle: int, t_ns: int) -> float:
        """Return how long an upload should wait until the vehicle has passed its current item."""
        profile = self._fleet.profile(vehicle)
        if profile is None or profile.atomic or not self.points_ahead(vehicle):
            return 0.0
        to_go_s = self.time_to_next_s(vehicle, t_ns)
        return to_go_s + _REPORT_DELAY_S if to_go_s < UploadLimits().guard_s + DELIVERY_S else 0.0
