"""The answers to one order, as they come in vehicle by vehicle."""

from __future__ import annotations

from collections.abc import Iterable

from gcs.model import AnswerState, Order, OrderAnswer, vehicle_name


class Ongoing:
    """An order of which some vehicles' answers are still to come."""

    def __init__(self, order: Order, waiting: Iterable[int] = ()) -> None:
        self.order = order
        self.waiting = set(waiting)

    def answer(self, t_ns: int, state: AnswerState, detail: str, vehicle: int | None = None) -> OrderAnswer:
        """Answer for one vehicle, which is final, or for the order as a whole."""
        if vehicle is not None:
            self.waiting.discard(vehicle)
        order = self.order
        return OrderAnswer(
            t_ns, order.order_id, order.action, state, detail, vehicle, tuple(sorted(self.waiting))
        )


def named(vehicles: Iterable[int]) -> str:
    """Vehicles in words: ``agents 1, 3``."""
    ids = sorted(vehicles)
    return f"agent{'s' if len(ids) != 1 else ''} {', '.join(map(vehicle_name, ids))}"
