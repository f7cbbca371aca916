"""What follows when the status of an agent changes."""

from __future__ import annotations

from collections.abc import Iterable

from gcs.core.stages import Stages
from gcs.model import AgentStatus, ControlEvent, Effect


def follow_status(stages: Stages, status: AgentStatus) -> list[Effect]:
    """End routes, uploads and approvals of an agent that is not active any more."""
    agent = stages.state.agents[status.vehicle]
    if status.status != "active":
        agent.routes.drop()
    if status.status == "lost":
        agent.claims.apply(ControlEvent.AGENT_LOST, status.t_ns)
        stages.association.forget(status.vehicle)
    if status.status not in ("lost", "down"):
        return []
    stages.tasking.cancel(status.vehicle, status.t_ns)
    stages.approval.hurry()
    return [*stages.approval.end(status.vehicle, status.t_ns, f"the agent is {status.status}")]


def apply_statuses(stages: Stages, effects: Iterable[Effect]) -> list[Effect]:
    """Apply the statuses among effects that follow from flight phases, and plan at the next scan."""
    applied: list[Effect] = []
    for effect in effects:
        applied.append(effect)
        if isinstance(effect, AgentStatus):
            stages.agent_status.apply(effect)
            stages.replanner.hurry(effect.t_ns)
            applied += follow_status(stages, effect)
    return applied
