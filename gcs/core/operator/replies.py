"""Replies to one order, vehicle by vehicle."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from gcs.model import AnswerState, Order, OrderAnswer, Proposal, vehicle_name


@dataclass(slots=True)
class OrderInProgress:
    """An order with outstanding results of some vehicles."""

    order: Order
    waiting: tuple[int, ...] = ()

    def answer(self, t_ns: int, state: AnswerState, detail: str, vehicle: int | None = None) -> OrderAnswer:
        """Return the reply for one vehicle, which is final, or for the whole order."""
        self.waiting = tuple(sorted(one for one in self.waiting if one != vehicle))
        order = self.order
        return OrderAnswer(t_ns, order.order_id, order.action, state, detail, vehicle, self.waiting)

    def showing(self, proposal: Proposal) -> OrderAnswer:
        """Return the reply with the plan that waits."""
        detail = f"plan {proposal.plan_id} waits to be confirmed: {proposal.reason}"
        return replace(self.answer(proposal.t_ns, "done", detail), proposal=proposal)


def named(vehicles: Iterable[int]) -> str:
    """Return vehicles in words: ``agents 1, 3``."""
    ids = sorted(vehicles)
    return f"agent{'s' if len(ids) != 1 else ''} {', '.join(map(vehicle_name, ids))}"
