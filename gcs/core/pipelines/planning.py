"""Plans when they are due, the missions that they send, and the end of the mission."""

from __future__ import annotations

from collections.abc import Container
from typing import Final

from gcs.core.restart import is_settled
from gcs.core.stages import Stages
from gcs.core.state import at_targets, with_status
from gcs.model import Effect, FlightPhase, MissionEnded, Notice, NoticeCode

MAX_RENEWED: Final = 2
"""Routes that are planned again at a tick because their uploads had to wait."""


def check_climbs(stages: Stages, t_ns: int) -> list[Effect]:
    """Check the climbs of vehicles on the ground that have a mission, or may get one."""
    agents = stages.state.agents
    ours = [
        vehicle
        for vehicle in with_status(agents, "active")
        if not agents[vehicle].flight.phase.is_in_air and agents[vehicle].control.is_ours
    ]
    notices = stages.climbs.check(stages.planning_inputs.climbs(ours), t_ns)
    for agent in agents.values():
        if agent.takeoff.blocked:
            agent.routes.drop()
    return [*notices]


def plan(stages: Stages, t_ns: int, picture_t_ns: int, urgent: Container[int] = ()) -> list[Effect]:
    """Plan if it is due, and send or propose the missions; `urgent` vehicles do not wait for anything."""
    state = stages.state
    if state.has_ended or not is_settled(state, t_ns):
        return []
    effects: list[Effect] = []
    if state.resumed_t_ns is not None:
        state.resumed_t_ns = None
        effects += stages.replanner.taken_up(t_ns, picture_t_ns)
    if not (stages.replanner.is_due(t_ns) or stages.approval.changed_control()):
        return effects
    inputs = stages.planning_inputs.build(t_ns, picture_t_ns)
    if stages.needs_approval:
        proposals = stages.approval.check(inputs)
        return [*effects, *_notes(stages, t_ns), *proposals]
    made = stages.replanner.check(inputs)
    effects += _notes(stages, t_ns) if made is None else [made, *_notes(stages, t_ns)]
    if made is not None:
        routes = [route for route in made.routes if route.vehicle in made.changed]
        effects += stages.dispatch.send(routes, made.t_ns, urgent)
    return effects


def plan_now(stages: Stages, t_ns: int, urgent: Container[int] = ()) -> list[Effect]:
    """Plan by an order, or on a changed map."""
    effects = check_climbs(stages, t_ns)
    if stages.state.perception.sensor_watchdog.scan_t_ns is not None:
        effects += plan(stages, t_ns, stages.state.measured_t_ns, urgent)
    return effects


def renew_outdated(stages: Stages, t_ns: int) -> list[Effect]:
    """Plan the routes again whose uploads had to wait, from where their vehicles are now.

    At most `MAX_RENEWED` at a tick: each costs some 20 ms with 400 vehicles. The others wait for later ticks.
    """
    effects: list[Effect] = []
    outdated = stages.tasking.outdated(t_ns, MAX_RENEWED)
    if not outdated:
        return effects
    inputs = stages.planning_inputs.build(t_ns, stages.state.measured_t_ns)
    for vehicle in outdated:
        queued = stages.state.tasking.queue[vehicle]
        made = stages.replanner.renew_flown(vehicle, queued.planned_t_ns, inputs)
        if made is None:
            stages.tasking.renew_queued(vehicle, queued.route, queued.return_route, t_ns)
            continue
        (route,) = (route for route in made.routes if route.vehicle == vehicle)
        return_route, warnings = stages.return_routes.plan(route, t_ns)
        if vehicle not in made.changed:  # it keeps its onboard mission
            stages.tasking.withdraw(vehicle)
            effects += [made, *warnings]
            continue
        stages.tasking.renew_queued(vehicle, route, return_route, t_ns)
        effects += [made, *warnings]
    return effects


def end_mission(stages: Stages, t_ns: int) -> list[Effect]:
    """End the mission when no active agent can fly, or every expected target has its agents.

    One that ended without an agent that can fly goes on with the first that can again: after an outage of all
    radios.
    """
    state = stages.state
    agents = state.agents
    active = with_status(agents, "active")
    flyable = [v for v in active if agents[v].flight.phase is not FlightPhase.LANDED]
    reached = len(at_targets(agents))
    is_done = reached >= max(1, stages.expected_targets) and not stages.planning_inputs.open_targets()
    goes_on = bool(flyable) and not is_done
    if state.has_ended:
        if not (state.ended_without_agents and goes_on):
            return []
        state.has_ended = False
        return [Notice(t_ns, NoticeCode.MISSION_GOES_ON, None, {"vehicles": tuple(flyable)})]
    if goes_on:
        return []
    state.has_ended = True
    state.ended_without_agents = not is_done
    arrived, lost, down = (tuple(with_status(agents, word)) for word in ("arrived", "lost", "down"))
    stages.replanner.end_notes()
    return [*_notes(stages, t_ns), MissionEnded(t_ns, arrived, lost, tuple(active), down)]


def _notes(stages: Stages, t_ns: int) -> list[Effect]:
    return [note.at(t_ns) for note in stages.replanner.take_notes()]
