"""What each vehicle holds by the last read-back, and what it flies to by itself because of it.

Over a mixed store nobody may take the next item (`gcs.mavlink.mission.upload_task`); whoever is about to
would have to hold, which is a turn that nobody planned, from where it happens to be. It is past its item
within seconds: so long a transfer should wait.
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
from gcs.mavlink.mission.upload_stages import UploadTiming
from gcs.model import NS_PER_S, Route
from gcs.planning.route_progress import time_to_point_s
from gcs.planning.vehicle_model import LoiterCircle, RemainingMission

TerminalLoiter: TypeAlias = Literal["", "circle", "circle elsewhere", "way home", "landing", "return"]
"""What a mission has behind its route; "return": RTL behind its last item."""

_PAST_S: Final = 0.3
"""Until a vehicle that should have turned to its next item says so."""


@dataclass(frozen=True, slots=True)
class OnboardMission:
    """What a vehicle holds, by the last read-back."""

    route: Route
    items: tuple[Item, ...]
    first_point: int
    """Number of the item that is the route's first point."""

    @property
    def circle(self) -> LoiterCircle | None:
        """What it ends with; None where the autopilot alone knows how wide that is, or it lands."""
        radius_m = self.items[-1].param3 if self.items[-1].command == MAV_CMD_NAV_LOITER_UNLIM else 0.0
        east_m, north_m = self.route.flown_m[-1].tolist()
        return LoiterCircle((east_m, north_m), radius_m) if radius_m > 0.0 else None


class OnboardMissions:
    """What all vehicles hold.

    Parameters
    ----------
    fleet : Fleet
        Where vehicles are, and which item they fly to.
    stays : bool
        Whether a vehicle circles at its mission's end for ever.
    """

    def __init__(self, fleet: Fleet, *, stays: bool) -> None:
        self._fleet, self._stays = fleet, stays
        self._flown: dict[int, OnboardMission] = {}
        self._unselected: set[int] = set()

    def of(self, vehicle: int) -> OnboardMission | None:
        """What a vehicle holds; None when that is not known."""
        return self._flown.get(vehicle)

    def note(self, flown: OnboardMission) -> None:
        """Note what a vehicle was found to hold."""
        self._flown[flown.route.vehicle] = flown

    def forget(self, vehicle: int) -> None:
        """Note that it is not known what a vehicle holds."""
        self._flown.pop(vehicle, None)

    def select(self, vehicle: int, *, selected: bool = True) -> None:
        """Note whether a vehicle flies by what it holds, or on by the numbers of a mission before."""
        (self._unselected.discard if selected else self._unselected.add)(vehicle)

    def points_ahead(self, vehicle: int) -> tuple[tuple[float, float], ...]:
        """Points that a vehicle in AUTO flies to by what it holds, the next one first."""
        flown, state = self._flown.get(vehicle), self._fleet.state(vehicle)
        if flown is None or state is None or state.mode != AUTO or vehicle in self._unselected:
            return ()
        if state.mission_seq < flown.first_point:
            return ()
        left = flown.route.points_m[state.mission_seq - flown.first_point :]
        return tuple((east_m, north_m) for east_m, north_m in left.tolist())

    def forward_simulation(self, vehicle: int, wait_s: float, t_ns: int) -> RemainingMission:
        """What a vehicle flies to by itself, when it gets no other mission before `wait_s`."""
        points = self.points_ahead(vehicle)
        if not points:
            return RemainingMission()
        flown = self._flown[vehicle]
        last = flown.first_point + len(flown.route.points_m)
        radii = tuple(item.param2 for item in flown.items[last - len(points) : last])
        next_s = max(0.0, self.time_to_next_s(vehicle, t_ns))
        return RemainingMission(points, radii, wait_s, next_s, flown.circle)

    def is_in_takeoff(self, vehicle: int) -> bool:
        """Tell whether a vehicle in AUTO flies to the take-off item of what it holds."""
        flown, state = self._flown.get(vehicle), self._fleet.state(vehicle)
        if flown is None or state is None or not state.armed or state.mode != AUTO:
            return False
        seq = state.mission_seq
        return 0 <= seq == flown.first_point - 1 and flown.items[seq].command == MAV_CMD_NAV_TAKEOFF

    def has_passed_route_end(self, vehicle: int) -> bool:
        """Whether a vehicle has its route's last point behind it, on a circle elsewhere."""
        flown, state = self._flown.get(vehicle), self._fleet.state(vehicle)
        if flown is None or flown.route.wait_m is None or vehicle in self._unselected:
            return False
        passed = 0 if state is None or state.mode != AUTO else state.mission_seq - flown.first_point
        return passed >= len(flown.route.points_m)

    def terminal_phase(self, vehicle: int) -> TerminalLoiter:
        """Return what a vehicle in AUTO flies behind the last point of its route; empty before that."""
        flown, state = self._flown.get(vehicle), self._fleet.state(vehicle)
        if flown is None or state is None or state.mode != AUTO or vehicle in self._unselected:
            return ""
        seq = state.mission_seq
        if not state.armed or not flown.first_point + len(flown.route.points_m) <= seq < len(flown.items):
            return ""
        if flown.items[seq].command == MAV_CMD_NAV_LOITER_UNLIM:
            return "circle" if flown.route.wait_m is None else "circle elsewhere"
        return "landing" if flown.items[seq].command == MAV_CMD_NAV_LAND else "way home"

    def is_at_end(self, vehicle: int, profile: AutopilotProfile) -> bool:
        """Whether a LOITER of a vehicle is its mission's end."""
        flown, state = self._flown.get(vehicle), self._fleet.state(vehicle)
        if profile.ends_in != LOITER or flown is None or state is None:
            return False
        return state.mission_seq == len(flown.items) - 1

    def time_to_next_s(self, vehicle: int, t_ns: int) -> float:
        """Seconds until it can take its next item from the store; 0 when that is not known."""
        flown, state = self._flown.get(vehicle), self._fleet.state(vehicle)
        if flown is None or state is None or vehicle in self._unselected:
            return 0.0
        if state.mission_seq < flown.first_point:
            return 0.0
        place, index = (state.east_m, state.north_m), state.mission_seq - flown.first_point
        if index >= len(flown.route.points_m):
            return math.inf if self._stays else 0.0
        points_m, speed_m_s = flown.route.points_m, state.ground_speed_m_s
        radius_m = flown.items[state.mission_seq].param2 if state.mission_seq < len(flown.items) else 0.0
        to_go_s = time_to_point_s(points_m, index, place, speed_m_s, radius_m)
        return to_go_s - (t_ns - state.t_ns) / NS_PER_S

    def wait_s(self, vehicle: int, t_ns: int) -> float:
        """How long to wait with a transfer, so that the vehicle need not be told to hold for it."""
        profile = self._fleet.profile(vehicle)
        if profile is None or profile.atomic or not self.points_ahead(vehicle):
            return 0.0
        to_go_s = self.time_to_next_s(vehicle, t_ns)
        return to_go_s + _PAST_S if to_go_s < UploadTiming().guard_s + DELIVERY_S else 0.0
