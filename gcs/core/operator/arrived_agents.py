"""Arrived agents that are tasked again: after the end of the mission, or out of a new no-fly zone.

Arrival is final for the mission that it belongs to. When targets appear after the end, an operator may
continue the mission: its agents are free again, and the targets that they reached need no others.

An agent that circles in a zone that was closed since is active again, and its target needs an agent again. It
keeps its last route, which is blocked: the next plan leads it to the nearest clear place, at once.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from typing import Final

import numpy as np

from gcs.core.airspace.no_fly_zones import MapChange
from gcs.core.operator.operator_state import OrderInProgress
from gcs.core.replanning.replanner import Replanner
from gcs.core.replanning.route_crossing import is_crossed
from gcs.core.state import Agent, State, with_status
from gcs.model import Effect, Label, Order, VehicleState, named, read_only, targets_text

_CIRCLE_POINTS: Final = 24


def continue_mission(
    order: Order, state: State, replanner: Replanner, targets: Collection[Label]
) -> list[Effect]:
    """Carry out an order to continue a mission that has ended; `targets` need agents.

    The named agents are free for another target, or all that arrived. The caller plans.
    """
    ongoing = OrderInProgress(order)
    agents = state.agents
    free = with_status(agents, "arrived")
    if order.vehicles is not None:
        free = [vehicle for vehicle in free if vehicle in order.vehicles]
    refusal = ""
    if not state.has_ended:
        refusal = "the mission has not ended"
    elif not targets:
        refusal = "no target needs an agent"
    elif not free and not with_status(agents, "active"):
        refusal = "no agent is active or at a target"
        if order.vehicles is not None:
            refusal = f"{named(order.vehicles)} not at a target, and no agent is active"
    if refusal:
        return [ongoing.answer(order.t_ns, "refused", refusal)]
    state.has_ended = False
    effects: list[Effect] = [
        agents[vehicle].perception.leave_target(order.t_ns, has_served=True) for vehicle in free
    ]
    text = f"the mission continues with {targets_text(targets)}"
    replanner.order_plan(order.t_ns, f"order: {text}")
    detail = f"{text}; {named(free)} free for them" if free else text
    return [*effects, ongoing.answer(order.t_ns, "done", detail)]


def leave_zones(state: State, closed: MapChange, vehicles: Iterable[VehicleState], t_ns: int) -> list[Effect]:
    """Make arrived agents that circle in a zone that was closed active again; return their statuses."""
    effects: list[Effect] = []
    for vehicle in vehicles:
        agent = state.agents[vehicle.system_id]
        latest = agent.routes.latest
        status = agent.perception.status
        is_at_target = latest is not None and (status.status, status.target) == ("arrived", latest.target)
        if is_at_target and agent.control.is_ours and _circles_in(closed, agent, vehicle):
            effects.append(agent.perception.leave_target(t_ns, has_served=False))
            agent.routes.resume_latest()
            state.has_ended = False
    return effects


def _circles_in(closed: MapChange, agent: Agent, vehicle: VehicleState) -> bool:
    """Return True if a vehicle, or the loiter circle at the end of its mission, is in the zone."""
    mission = agent.tasking.onboard
    circle = None if mission is None else mission.circle
    points = [(vehicle.east_m, vehicle.north_m)]
    if circle is not None:
        east_m, north_m = circle.centre_m
        radius_m = circle.radius_m
        angles = [2.0 * math.pi * k / _CIRCLE_POINTS for k in range(_CIRCLE_POINTS + 1)]
        points += [(east_m + radius_m * math.sin(a), north_m + radius_m * math.cos(a)) for a in angles]
    latest = agent.routes.latest
    if latest is not None and latest.heights_msl_m is not None:
        circled = [(*point, float(latest.heights_msl_m[-1])) for point in points[1:]]
        parts = [[(*points[0], vehicle.alt_msl_m)], circled]
        return any(closed.is_crossed(np.array(part)) for part in parts if part)
    cells = closed.layers
    return is_crossed(cells, read_only(points[:1]), None) or is_crossed(cells, read_only(points[1:]), None)
