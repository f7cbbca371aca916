"""State of orders and of plans that wait for approval."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class AgentOrders:
    """Orders to one vehicle."""


@dataclass(slots=True)
class OperatorState:
    """The proposal that waits, and orders to several vehicles."""
