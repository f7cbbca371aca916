"""Order of agents by need of attention, and other parts that every display shows alike."""

from __future__ import annotations

from collections.abc import Iterable

from gcs.mavlink.fleet.checks.link_timeouts import STALE_AFTER_S
from gcs.model import AgentRecord, Label


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
    elif agent.has_failed or agent.track is None or is_late(agent):
        rank = 3
    else:
        rank = 4
    return rank, agent.vehicle


def is_late(agent: AgentRecord) -> bool:
    """Return True if an agent was not heard for some time, or never."""
    return agent.heard_age_s is None or agent.heard_age_s > STALE_AFTER_S


def pinned_vehicles(agents: Iterable[AgentRecord]) -> dict[Label, list[int]]:
    """Return the vehicles that are pinned to each target."""
    pins: dict[Label, list[int]] = {}
    for agent in agents:
        if agent.pinned is not None:
            pins.setdefault(agent.pinned, []).append(agent.vehicle)
    return pins
