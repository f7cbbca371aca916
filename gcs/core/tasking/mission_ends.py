"""Vehicles that pass the ends of their routes without having reached their targets.

Behind the last point of its route a vehicle circles, returns or lands. An ArduPlane without a further item
goes to RTL. If the vehicle passed too far from its target, or the target was elsewhere, the operator is
notified and the next plan gives the vehicle a new mission. A vehicle in its landing is not turned back.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from gcs.core.state import Agent
from gcs.core.tasking.onboard_missions import TerminalPhase
from gcs.core.tasking.records import NO_MISSION
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Notice

_ARRIVAL_NS: Final = ns(5.0)
"""Time from the last point until an arrival would have been detected."""
_CIRCLING_NS: Final = ns(15.0)
"""The same on a loiter circle within the capture radius."""
_PHASE_WORDS: Final[dict[TerminalPhase, str]] = {
    "circle": "it circles at its route's end",
    "circle elsewhere": "it circles elsewhere",
    "return route": "it returns to land",
    "landing": "it lands, and gets no other mission before that",
    "return": "it ended its mission and flies RTL",
}


class MissionEnds:
    """Vehicles that have passed the ends of their routes.

    Parameters
    ----------
    capture_radius_m : float
        Distance at which a vehicle has reached its target.
    """

    def __init__(self, agents: Mapping[int, Agent], tasking: UploadManager, capture_radius_m: float) -> None:
        self._agents, self._tasking, self._max_radius_m = agents, tasking, capture_radius_m

    def check(self, t_ns: int, active: Iterable[int]) -> list[Effect]:
        """Check the vehicles that have not reached a target; report each mission once."""
        effects: list[Effect] = []
        for agent in self._agents.values():
            agent.tasking.route_end.has_missed = False
        for vehicle in active:
            tasking, phase = self._agents[vehicle].tasking, self._tasking.terminal_phase(vehicle)
            mission, end = tasking.onboard, tasking.route_end
            if not phase or (mission is None and phase != "return"):
                end.since_t_ns = None
                continue
            mission_id = NO_MISSION if mission is None else mission.mission_id
            if end.since_t_ns is None or end.mission_id != mission_id:
                end.since_t_ns, end.mission_id = t_ns, mission_id
                continue
            circle = None if mission is None else mission.circle
            is_at_target = phase == "circle" and circle is not None and circle.radius_m <= self._max_radius_m
            if t_ns - end.since_t_ns < (_CIRCLING_NS if is_at_target else _ARRIVAL_NS):
                continue
            end.has_missed = not is_at_target and phase != "landing"
            if end.reported_id != mission_id:
                end.reported_id = mission_id
                text = f"ended its route without having reached its target: {_PHASE_WORDS[phase]}"
                effects.append(Notice(t_ns, "alarm", text, vehicle))
        return effects
