"""Reminders of a plan that waits to be confirmed, every minute."""

from __future__ import annotations

from typing import Final

from gcs.model import NS_PER_S, Proposal

REMIND_S: Final = 60.0
"""Seconds between log lines about the same proposed plan."""


class ProposalLog:
    """Limits the log lines about proposed plans: each new plan, and a reminder now and then."""

    def __init__(self) -> None:
        self._last: tuple[int, tuple[int, ...]] | None = None
        self._last_t_ns = 0

    def add_if_due(self, proposal: Proposal) -> bool:
        """Return True if the log gets a line for the proposal, and note that it was logged."""
        content = proposal.plan_id, tuple(route.vehicle for route in proposal.routes)
        if content == self._last and proposal.t_ns - self._last_t_ns < REMIND_S * NS_PER_S:
            return False
        self._last = content
        self._last_t_ns = proposal.t_ns
        return True
