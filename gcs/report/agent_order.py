"""Order of agents by need of attention."""

from __future__ import annotations

from gcs.model import AgentRecord


def attention(agent: AgentRecord) -> tuple[int, int]:
    """Return a sort key: agents that need attention first, the others by number."""
    if agent.is_position_doubted:
        rank = 0
    elif agent.status in ("lost", "down"):
        rank = 1
    elif agent.status == "arrived":
        rank = 5
    elif agent.authority != "ours" or agent.problems:
        rank = 2
    elif agent.has_failed or agent.track is None or agent.is_late:
        rank = 3
    else:
        rank = 4
    return rank, agent.vehicle
