"""Restart: what is done with a state after an outage, and how long is waited before the first plan.

The outage is a gap in all links: uploads, orders and authorities continue. What may have changed meanwhile is
checked.

* A vehicle counts as not heard until its next frame. Nothing but heartbeats is sent to it before its own: a
  pilot may have taken over.
* Commands to arm and disarm end, and after a long gap all commands: they are ordered again or not.
* Each onboard mission is read back before any upload (`gcs.core.authority.onboard_audit`).
* Tracks are predicted over the gap. After a long one the agents' tracks start again at their reports.
  Labels go on: they count the scans of the filter's state.

No plan is made before agents are heard and tracked and their missions read back, for a bounded time.
The restart itself is no reason for a new plan.
"""

from __future__ import annotations

from typing import Final

from gcs.core.perception.arrival_and_loss import UNSEEN_S
from gcs.core.perception.perception_state import AgentSighting, Association, IntegrityTest, TrackerState
from gcs.core.state import Agent, State, with_status
from gcs.model import NS_PER_S, Effect, Notice, NoticeCode, Parameter, Resumed, named

_MAX_WAIT_NS: Final = 25 * NS_PER_S
"""Maximum time until the first plan."""
_MAX_UNKNOWN_WAIT_NS: Final = 8 * NS_PER_S
"""Maximum wait for active agents that are not heard or not tracked."""
_MAX_PREDICTION_NS: Final = 10 * NS_PER_S
"""Maximum gap over which tracks of agents, which may turn, are predicted."""


def bridge_gap(state: State, event: Resumed) -> list[Effect]:
    """Change a state for the time that passed without the service; return what operators must know."""
    gap_ns = event.t_ns - event.saved_t_ns
    state.resumed_t_ns = event.t_ns
    state.fleet.begin_again()
    state.perception.sensor_watchdog.begin_again(event.t_ns)
    for agent in state.agents.values():
        agent.link.begin_again()
        _begin_sighting_again(agent, event.t_ns)
    if gap_ns > _MAX_PREDICTION_NS:
        tracker = state.perception.trackers.agents
        state.perception.trackers.agents = TrackerState(tracker.filter.without_tracks())
        state.perception.oosm_buffer.held.clear()  # agents would be born before the gap
        for agent in state.agents.values():
            agent.perception.association = Association()
            agent.perception.integrity = IntegrityTest()
    effects: list[Effect] = []
    for vehicle, agent in state.agents.items():
        agent.authority.loiter = None
        if agent.separation.avoidance is not None:
            agent.separation.avoidance.sender = None
        effects += _end_command(state, vehicle, event, is_long=gap_ns > _MAX_PREDICTION_NS)
    parameters: dict[str, Parameter] = {"age_s": gap_ns / NS_PER_S, "contents": _contents(state)}
    return [Notice(event.t_ns, NoticeCode.RESUMED, None, parameters), *effects]


def _end_command(state: State, vehicle: int, event: Resumed, *, is_long: bool) -> list[Effect]:
    """End the orders to a vehicle that must not be carried out after the gap."""
    orders = state.agents[vehicle].orders
    effects = list[Effect]()
    ended = [] if orders.waiting is None or not is_long else [orders.waiting.order]
    if ended:
        orders.waiting = None
    if orders.command is not None:
        action = state.operator.orders[orders.command.order].order.action
        if is_long or action in ("arm", "disarm"):
            ended.append(orders.command.order)
            orders.command = None
    for number in ended:
        action = state.operator.orders[number].order.action
        text = f"not confirmed before the restart of the service; to {action} it, order it again"
        effects.append(state.operator.finish(number, event.t_ns, "failed", text, vehicle))
        effects.append(Notice(event.t_ns, NoticeCode.ORDER_ENDED, vehicle, {"action": action}))
    return effects


def is_settled(state: State, t_ns: int) -> bool:
    """Return True if a plan may be made: agents are heard and tracked and their missions read back.

    A bounded wait for that ends, too.
    """
    if state.resumed_t_ns is None:
        return True
    passed_ns = t_ns - state.resumed_t_ns
    if passed_ns >= _MAX_WAIT_NS:
        return True
    active = [state.agents[vehicle] for vehicle in with_status(state.agents, "active")]
    heard = [agent for agent in active if agent.link.liveness == "alive"]
    is_audited = all(agent.authority.audit is None for agent in heard)
    is_known = len(heard) == len(active) and all(
        agent.perception.association.label is not None for agent in active
    )
    return is_audited and (is_known or passed_ns >= _MAX_UNKNOWN_WAIT_NS)


def _begin_sighting_again(agent: Agent, t_ns: int) -> None:
    """Wait for an agent: if it is not seen before the first plan, it is lost."""
    before = agent.perception.sighting
    sighting = AgentSighting(position_m=before.position_m, at_target=before.at_target)
    if before.seen_t_ns is not None:
        sighting.seen_t_ns = t_ns + _MAX_UNKNOWN_WAIT_NS - round(UNSEEN_S * NS_PER_S)
    agent.perception.sighting = sighting


def _contents(state: State) -> str:
    """Return a state in words."""
    agents = state.agents
    active = with_status(agents, "active")
    suspended = [v for v, agent in agents.items() if agent.control.suspension is not None]
    not_ours = [v for v, agent in agents.items() if not agent.control.is_ours]
    groups = {
        "missions of {}": [v for v in active if agents[v].routes.flown is not None],
        "{} at their targets": with_status(agents, "arrived"),
        "{} down": with_status(agents, "down"),
        "{} lost, until they report and are tracked again": with_status(agents, "lost"),
        "{} suspended": suspended,
        "{} under other control": [v for v in not_ours if v not in suspended],
        "uploads to {}": list(state.tasking.uploads),
    }
    parts = [text.format(named(vehicles)) for text, vehicles in groups.items() if vehicles]
    parts.append(f"{len(state.perception.trackers.targets.confirmation.confirmed)} targets")
    if state.airspace.zones:
        parts.append("closed areas " + ", ".join(state.airspace.zones))
    return "; ".join(parts)
