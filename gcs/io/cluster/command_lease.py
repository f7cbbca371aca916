"""Lease of a command node over the bridges of its mission, on the clock of this machine."""

from __future__ import annotations

import secrets
from typing import Final

from gcs.core.lease.lease_messages import TIMES, Answer, Ask, NodeId, Permit
from gcs.core.lease.node_lease import (
    Duty,
    duty,
    epochs_held,
    permit_for,
    receive_answer,
    start_node,
    take_due_asks,
)
from gcs.io.clock import steady_ns

_HOLDER_ALIVE_NS: Final = 2 * TIMES.lease_ns
"""Time after which a holder that a new node finds is alive: it renews its lease."""


class CommandLease:
    """State of `gcs.core.lease.node_lease`.

    Parameters
    ----------
    node : str
        Name of this node.
    bridges : tuple of str
        Bridges of the mission, in the order of its file.
    delay_ns : int
        Time that this node leaves to others when a lease has run out.
    is_only_node : bool
        True if the mission has no standby.
    """

    def __init__(self, node: str, bridges: tuple[str, ...], delay_ns: int, *, is_only_node: bool) -> None:
        self._began_ns = 0
        """Time of the first ask."""
        self._has_held = False
        """True if this node ever had a lease."""
        own = NodeId(node, secrets.randbits(63))
        self._state = start_node(own, bridges, steady_ns(), delay_ns=delay_ns, is_only_node=is_only_node)

    def due_asks(self) -> dict[str, Ask]:
        """Return the asks that are to be sent now, by bridge."""
        self._began_ns = self._began_ns or steady_ns()
        self._state, asks = take_due_asks(self._state, steady_ns())
        return asks

    def note_answer(self, bridge: str, answer: Answer) -> None:
        """Note the answer of a bridge."""
        self._state = receive_answer(self._state, bridge, answer, steady_ns())
        self._has_held = self._has_held or self._holds_one()

    def permit(self, bridge: str) -> Permit | None:
        """Return the permit for what is sent now through a bridge; None if nothing may be sent."""
        return permit_for(self._state, bridge, steady_ns())

    @property
    def duty(self) -> Duty:
        """What this node may do now."""
        return duty(self._state, steady_ns())

    def missing(self) -> tuple[str, ...]:
        """Return the bridges whose lease this node does not have."""
        held = epochs_held(self._state, steady_ns())
        return tuple(bridge for bridge in self._state.bridges if bridge not in held)

    def commander(self) -> str:
        """Return the name of another node that has leases while this one has none; empty if there is none.

        A node that starts waits for the end of the lease of one that was killed.
        """
        if self._holds_one():
            return ""
        if not self._has_held and steady_ns() - self._began_ns < _HOLDER_ALIVE_NS:
            return ""
        own = self._state.node.name
        return next((view.holder for view in self._state.views if view.holder not in ("", own)), "")

    def _holds_one(self) -> bool:
        return any(view.hold is not None for view in self._state.views)
