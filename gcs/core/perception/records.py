"""State of perception: trackers, associations, statuses, sensors."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class AgentPerception:
    """What is believed of one agent."""


@dataclass(slots=True)
class PerceptionState:
    """Trackers and sensors."""
