"""Traffic before a new mission of a vehicle in the air.

A new mission leads a vehicle from its present place and height to another layer, or away from its circle.
Layers separate vehicles only once they are in them. The upload waits while the mission would lead the vehicle
near another one at once, and its present flight would not. Missions that others are getting at the time
count, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from gcs.core.separation.order_check import OrderCheck
from gcs.core.state import Agent
from gcs.core.tasking.records import TaskingState
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Notice, NoticeCode, Route

_PERIOD_NS: Final = ns(1.0)
_MAX_WAIT_NS: Final = ns(60.0)
"""Longest wait: the mission may be needed for other reasons."""


class MissionTraffic:
    """Lets missions of vehicles in the air wait for other vehicles."""

    def __init__(self, order_check: OrderCheck, agents: Mapping[int, Agent], tasking: TaskingState) -> None:
        self._order_check = order_check
        self._agents = agents
        self._tasking = tasking

    def holds_back(self, route: Route, t_ns: int) -> str:
        """Return why the upload of a route must wait; empty if it need not."""
        seen = self._agents[route.vehicle].separation
        if seen.avoidance is not None:
            return f"holds for {seen.avoidance.other}"
        if not seen.traffic or t_ns - seen.traffic_t_ns >= _PERIOD_NS:
            seen.traffic_t_ns = t_ns
            uploads = self._tasking.uploads.items()
            uploading = {v: one.onboard.route for v, one in uploads if one.onboard is not None}
            seen.traffic = self._order_check.mission_problem(route, uploading, t_ns)
        if not seen.traffic:
            return ""
        since_ns = t_ns if seen.waits_since_t_ns is None else seen.waits_since_t_ns
        return seen.traffic if t_ns - since_ns < _MAX_WAIT_NS else ""

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
