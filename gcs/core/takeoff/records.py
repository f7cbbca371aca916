"""State of take-offs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class AgentTakeoff:
    """Take-off of one vehicle."""


@dataclass(slots=True)
class TakeoffState:
    """What belongs to no single vehicle."""
