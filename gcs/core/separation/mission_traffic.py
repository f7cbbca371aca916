"""Traffic in the way of a new mission of a vehicle in the air: its upload waits for it.

A new mission leads a vehicle from its present place and height to another layer, or away from its circle.
Layers separate vehicles only once they are in them. The upload waits while the mission would lead the vehicle
near another one at once, and its present flight would not, or would only for a moment. Missions that others
are getting at the time count, too. Of vehicles that are near each other already, one after the other begins
its climb. Over terrain a mission waits, too, while its begin would lead below the flight band: from another
place on a circle the vehicle turns over lower ground. At most `MAX_CHECKS` missions are checked at a time,
those first that were not checked yet: with hundreds of vehicles nothing else would happen meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from gcs.core.separation.order_check import OrderCheck
from gcs.core.separation.separation_state import SeparationState
from gcs.core.state import Agent
from gcs.core.tasking.tasking_state import TaskingState
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Notice, NoticeCode, Route

_PERIOD_NS: Final = ns(1.0)
MAX_CHECKS: Final = 10
"""Missions that are checked at a time. Each takes some 3 ms beside twenty vehicles in reach."""
_MAX_WAIT_NS: Final = ns(60.0)
"""Longest wait: the mission may be needed for other reasons."""


class MissionTraffic:
    """Lets missions of vehicles in the air wait for other vehicles."""

    def __init__(
        self,
        order_check: OrderCheck,
        agents: Mapping[int, Agent],
        tasking: TaskingState,
        state: SeparationState,
    ) -> None:
        self._state = state
        self._order_check = order_check
        self._agents = agents
        self._tasking = tasking

    def is_known_to_wait(self, vehicle: int, t_ns: int) -> bool:
        """Return True if another vehicle was in the way less than a second ago, and it may be waited for."""
        seen = self._agents[vehicle].separation
        return bool(seen.traffic) and t_ns - seen.traffic_t_ns < _PERIOD_NS and self._may_wait(vehicle, t_ns)

    def last_checked_t_ns(self, vehicle: int) -> int:
        """Return when a vehicle was last found in the way of a mission; 0 if none was."""
        seen = self._agents[vehicle].separation
        return seen.traffic_t_ns if seen.traffic else 0

    def _may_check(self, t_ns: int) -> bool:
        """Return True, and count, if another mission may be checked at this time."""
        state = self._state
        if state.mission_checks_t_ns != t_ns:
            state.mission_checks_t_ns = t_ns
            state.mission_checks = 0
        state.mission_checks += 1
        return state.mission_checks <= MAX_CHECKS

    def _may_wait(self, vehicle: int, t_ns: int) -> bool:
        since_t_ns = self._agents[vehicle].separation.waits_since_t_ns
        return since_t_ns is None or t_ns - since_t_ns < _MAX_WAIT_NS

    def holds_back(self, route: Route, t_ns: int) -> str:
        """Return why the upload of a route must wait; empty if it need not."""
        seen = self._agents[route.vehicle].separation
        if seen.avoidance is not None and not seen.avoidance.is_before_zone:
            return f"holds for {seen.avoidance.other}"
        if not seen.traffic or t_ns - seen.traffic_t_ns >= _PERIOD_NS:
            if not self._may_check(t_ns):
                return "is not checked yet"
            seen.traffic_t_ns = t_ns
            uploads = self._tasking.uploads.items()
            uploading = {v: one.onboard.route for v, one in uploads if one.onboard is not None}
            seen.traffic = self._order_check.mission_problem(route, uploading, t_ns)
        return seen.traffic if self._may_wait(route.vehicle, t_ns) else ""

    def check(self, t_ns: int) -> list[Effect]:
        """Return a warning for each mission that begins to wait."""
        effects: list[Effect] = []
        for vehicle, agent in self._agents.items():
            seen = agent.separation
            queued = self._tasking.queue.get(vehicle)
            if queued is None or queued.at_once:
                seen.traffic = ""
            if not seen.traffic:
                seen.waits_since_t_ns = None
            elif seen.waits_since_t_ns is None:
                seen.waits_since_t_ns = t_ns
                effects.append(Notice(t_ns, NoticeCode.MISSION_WAITS, vehicle, {"reason": seen.traffic}))
        return effects
