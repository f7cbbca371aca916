"""Missed targets: vehicles that pass the ends of their routes without having reached their targets.

Behind the last point of its route a vehicle circles, returns or lands. An ArduPlane without a further item
goes to RTL. If the vehicle passed too far from its target, or the target was elsewhere, the operator is
notified and the next plan gives the vehicle a new mission. A vehicle in its landing is not turned back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from gcs.core.state import Agent, with_status
from gcs.core.tasking.onboard_missions import OnboardMissions
from gcs.core.tasking.tasking_state import NO_MISSION
from gcs.core.tasking.terminal_phase import TerminalPhase
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Notice, NoticeCode, Parameter

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


def check_missed_targets(
    agents: Mapping[int, Agent], missions: OnboardMissions, capture_radius_m: float, t_ns: int
) -> list[Effect]:
    """Check the active vehicles, which have not reached a target; report each mission once."""
    effects: list[Effect] = []
    for agent in agents.values():
        agent.tasking.route_end.has_missed = False
    for vehicle in with_status(agents, "active"):
        mission = agents[vehicle].tasking.onboard
        end = agents[vehicle].tasking.route_end
        phase = missions.terminal_phase(vehicle)
        is_old = mission is not None and mission.route.target in agents[vehicle].perception.reached
        is_old = is_old or agents[vehicle].routes.stacked is not None
        if is_old or not phase or (mission is None and phase != "return"):
            end.since_t_ns = None
            continue
        mission_id = NO_MISSION if mission is None else mission.mission_id
        if end.since_t_ns is None or end.mission_id != mission_id:
            end.since_t_ns = t_ns
            end.mission_id = mission_id
            continue
        circle = None if mission is None else mission.circle
        is_at_target = phase == "circle" and circle is not None and circle.radius_m <= capture_radius_m
        if t_ns - end.since_t_ns < (_CIRCLING_NS if is_at_target else _ARRIVAL_NS):
            continue
        end.has_missed = not is_at_target and phase != "landing"
        if end.reported_id != mission_id:
            end.reported_id = mission_id
            state: dict[str, Parameter] = {"state": _PHASE_WORDS[phase]}
            effects.append(Notice(t_ns, NoticeCode.ROUTE_ENDED_SHORT, vehicle, state))
    return effects
