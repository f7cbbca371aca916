"""Orders about targets: ignore one, rank one, or pin vehicles to one.

An ignored target is tracked, and no vehicle flies to it: the track of a false target, for example. Targets of
higher priority get their agents first. A pinned vehicle flies to its target, if that needs an agent and a
path leads there, whatever other assignment is shorter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from gcs.core.operator.operator_state import OperatorState, OrderInProgress, TargetSettings
from gcs.core.operator.order_refusals import not_in_mission
from gcs.core.perception.track_lifecycle import TrackConfirmation
from gcs.core.replanning.replanner import Replanner
from gcs.core.state import Agent
from gcs.model import Effect, Order, named, target_name

_MAX_NAMED: Final = 10
_DONE: Final = {"ignore": "is ignored", "attend": "is a target again", "unpin": "may fly to any target"}


@dataclass(frozen=True, slots=True)
class TargetOrders:
    """Carries out orders about targets."""

    agents: Mapping[int, Agent]
    state: OperatorState
    targets: TrackConfirmation
    replanner: Replanner

    def carry_out(self, order: Order, replan: Callable[[], list[Effect]]) -> list[Effect]:
        """Carry out an order about a target, and plan again at once."""
        ongoing = OrderInProgress(order)
        refusal = self._refusal(order)
        if refusal:
            return [ongoing.answer(order.t_ns, "refused", refusal)]
        text = self._note(order)
        self.replanner.order_plan(order.t_ns, f"order: {text}")
        return [ongoing.answer(order.t_ns, "done", text), *replan()]

    def _refusal(self, order: Order) -> str:
        unknown = [v for v in order.vehicles or () if v not in self.agents]
        if unknown:
            return f"{named(unknown)}: {not_in_mission(self.agents)}"
        label = order.target
        tracks = self.targets.tracks
        if label is not None and label not in tracks and order.action != "attend":
            names = [target_name(one) for one in tracks][:_MAX_NAMED]
            return f"there is no target {target_name(label)}; there are: {', '.join(names) or 'none'}"
        if order.action != "pin" or label is None:
            return ""
        if self.state.is_ignored(label):
            return f"target {target_name(label)} is ignored"
        idle = [v for v in order.vehicles or () if self.agents[v].perception.status.status != "active"]
        return f"{named(idle)} not active" if idle else ""

    def _note(self, order: Order) -> str:
        """Change the state; return the change in words."""
        label = order.target
        targets = self.state.targets
        vehicles = order.vehicles or tuple(self.agents)
        if order.action in ("pin", "unpin"):
            for vehicle in vehicles:
                self.agents[vehicle].orders.pinned = label
            where = _DONE["unpin"] if label is None else f"to fly to target {target_name(label)}"
            return f"{named(vehicles)} {where}"
        assert label is not None
        gone = [one for one in targets if one not in self.targets.existing]
        for one in gone:
            del targets[one]
        settings = targets.setdefault(label, TargetSettings())
        if order.action == "priority":
            settings.priority = order.priority
            return f"target {target_name(label)} has priority {order.priority}"
        settings.is_ignored = order.action == "ignore"
        return f"target {target_name(label)} {_DONE[order.action]}"
