"""State of replanning: routes and triggers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class AgentRoutes:
    """Routes of one vehicle."""


@dataclass(slots=True)
class ReplanningState:
    """What belongs to no single vehicle."""
