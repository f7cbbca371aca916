"""Warnings of incursions: how soon a flight or an onboard mission leads into a closed no-fly zone.

After a zone is closed, a vehicle flies its verified mission until a new one is on board. If there is no other
route, or it is not confirmed or not uploaded, that leads into the zone. The operator is warned when the zone
is closed, and again shortly before the incursion. Then the vehicle holds, if its circle is clear
(`gcs.core.separation.avoidance`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from gcs.core.airspace.airspace_state import AirspaceState
from gcs.core.airspace.no_fly_zones import ClosedZone
from gcs.core.tasking.onboard_missions import OnboardMissions
from gcs.geo import LocalFrame
from gcs.mavlink.services.retry import ns
from gcs.model import UNLIMITED, Notice, NoticeCode, Parameter, VehicleState
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight

WARNING_S = 20.0
"""Time before an incursion at which the warning is repeated."""
_PERIOD_NS: Final = ns(1.0)
_MIN_SPEED_M_S = 1.0
_HALVINGS = 12


@dataclass(frozen=True, slots=True)
class Incursion:
    """Predicted incursion of one vehicle."""

    vehicle: int
    zone: str
    item: int
    """Mission item that it flies to then."""
    after_s: float
    """Time until then, in seconds; 0: it is inside."""

    def notice(self, t_ns: int, remedy: str = "") -> Notice:
        """Return the alarm of the incursion, with a remedy if one is known."""
        if self.after_s == 0.0:
            return Notice(t_ns, NoticeCode.ZONE_ENTERED, self.vehicle, {"zone": self.zone})
        parameters: dict[str, Parameter] = {
            "zone": self.zone,
            "after_s": self.after_s,
            "item": self.item,
            "remedy": remedy,
        }
        return Notice(t_ns, NoticeCode.ZONE_AHEAD, self.vehicle, parameters)


class IncursionWarnings:
    """Predicts incursions of onboard missions."""

    def __init__(self, state: AirspaceState, onboard_missions: OnboardMissions, frame: LocalFrame) -> None:
        self._state = state
        self._onboard_missions = onboard_missions
        self._frame = frame

    def entries(self, states: Iterable[VehicleState], zones: Mapping[str, ClosedZone]) -> list[Incursion]:
        """Return the first predicted incursion of each vehicle."""
        if not zones:
            return []
        blocked = np.logical_or.reduce([zone.grid.blocked for zone in zones.values()])
        # One check, at all heights, for vehicles clear of all.
        first = next(iter(zones.values()))
        union = ClosedZone(replace(first.grid, blocked=blocked), UNLIMITED, first.obstacles)
        found = []
        for state in states:
            if self._entry(state, "", union) is not None:
                ones = [one for name, closed in zones.items() if (one := self._entry(state, name, closed))]
                found += sorted(ones, key=lambda one: one.after_s)[:1]
        return found

    def is_due(self, t_ns: int) -> bool:
        """Return True once a second."""
        return t_ns >= self._state.next_zone_check_t_ns

    def imminent(
        self, t_ns: int, states: Iterable[VehicleState], zones: Mapping[str, ClosedZone]
    ) -> list[Incursion]:
        """Return the incursions within `WARNING_S`; the next check is a second later."""
        self._state.next_zone_check_t_ns = t_ns + _PERIOD_NS
        return [entry for entry in self.entries(states, zones) if entry.after_s <= WARNING_S]

    def tell(self, t_ns: int, imminent: Iterable[Incursion]) -> list[Notice]:
        """Return alarms of imminent and actual incursions, each once until it is over."""
        due = {(e.vehicle, e.zone): e for e in imminent}
        notices = []
        for key, entry in due.items():
            before_s = self._state.incursions_s.get(key)
            if before_s is None or (entry.after_s == 0.0 and before_s > 0.0):
                notices.append(entry.notice(t_ns))
        over = sorted(self._state.incursions_s.keys() - due.keys())
        notices += [Notice(t_ns, NoticeCode.ZONE_CLEAR, vehicle, {"zone": zone}) for vehicle, zone in over]
        self._state.incursions_s = {key: entry.after_s for key, entry in due.items()}
        return notices

    def _entry(self, state: VehicleState, name: str, zone: ClosedZone) -> Incursion | None:
        position = (state.east_m, state.north_m)
        missions = self._onboard_missions
        ahead = missions.points_ahead(state.system_id)
        back = missions.return_items_ahead(state.system_id)
        points = (position, *ahead, *(self._frame.to_local(one.x * 1e-7, one.y * 1e-7) for one in back))
        heights_m = [state.alt_msl_m] * len(points)
        if not zone.limits.are_open:
            heights_m[1:] = missions.heights_ahead_msl_m(state.system_id)
            heights_m += missions.heights_msl_m(state.system_id, back)
        if zone.is_met(position, position, (state.alt_msl_m, state.alt_msl_m)):
            return Incursion(state.system_id, name, state.mission_seq, 0.0)
        flown_m = 0.0
        for number, ((start, end), heights) in enumerate(
            zip(pairwise(points), pairwise(heights_m), strict=True)
        ):
            if zone.is_met(start, end, heights):
                flown_m += _clear_m(zone.grid, start, end)
                after_s = flown_m / max(state.ground_speed_m_s, _MIN_SPEED_M_S)
                return Incursion(state.system_id, name, state.mission_seq + number, max(after_s, 0.1))
            flown_m += math.dist(start, end)
        return None


def _clear_m(closed: Grid, start: Point, end: Point) -> float:
    """Return the clear length of a leg, by bisection."""
    low = 0.0
    high = 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        point = (start[0] + middle * (end[0] - start[0]), start[1] + middle * (end[1] - start[1]))
        low, high = (middle, high) if line_of_sight(closed, start, point) else (low, middle)
    return low * math.dist(start, end)
