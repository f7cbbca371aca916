"""State of orders and of plans that wait for approval."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

from gcs.mavlink.services.command_sender import CommandSender
from gcs.model import NS_PER_S, Action, AnswerState, Label, Order, OrderAnswer, Plan, Proposal, RouteFigures

WAIT_PERIOD_NS: Final = NS_PER_S
"""Time between two checks of an order that waits."""


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


@dataclass(slots=True)
class Command:
    """Command in progress to one vehicle."""

    sender: CommandSender
    order: int
    """Its order (`OperatorState.orders`)."""
    action: Action
    """Action of that order."""


@dataclass(slots=True)
class WaitingOrder:
    """Order to hold or return that is not commanded yet: its vehicle would come near others."""

    order: int
    """Its number (`OperatorState.orders`)."""
    mode: str
    """Mode of the vehicle when it was given."""
    next_check_t_ns: int
    uploads_since_t_ns: int | None = None
    """Time since which a mission that returns it is uploaded; None: it waits."""
    is_told: bool = False
    """True if an alarm has told that it waits."""


@dataclass(slots=True)
class AgentOrders:
    """Orders to one vehicle."""

    command: Command | None = None
    """Command of an order to hold, resume, return, arm or disarm."""
    waiting: WaitingOrder | None = None
    pinned: Label | None = None
    """Target that the vehicle is to fly to, by order."""
    confirmation: int | None = None
    """Order that confirmed the mission on its way to the vehicle (`OperatorState.orders`)."""

    def wait(self, number: int, mode: str, t_ns: int, uploads_since_t_ns: int | None = None) -> None:
        """Let an order wait, or go on waiting, that was given in a mode."""
        before = self.waiting
        is_told = before is not None and before.order == number and before.is_told
        self.waiting = WaitingOrder(number, mode, t_ns + WAIT_PERIOD_NS, uploads_since_t_ns, is_told)


@dataclass(slots=True)
class TargetSettings:
    """Settings of a target by order."""

    is_ignored: bool = False
    priority: int | None = None
    """A higher one is served first; None: that of the mission file."""


@dataclass(slots=True)
class Approval:
    """The proposal that waits."""

    pending: Proposal | None = None
    count: int = 0
    """Number of the last proposal."""
    plan: Plan | None = None
    """Plan of the last proposal."""
    shown: dict[int, RouteFigures] = field(default_factory=dict)
    """Figures of each vehicle when the number was first shown."""
    numbered_t_ns: int | None = None
    """Time of the last new number."""
    renewed_t_ns: int = 0
    """Time at which the routes of the proposal were planned."""
    is_urgent: bool = False
    """True if the next plan is proposed at once: a vehicle was lost."""


@dataclass(slots=True)
class Standstill:
    """A mission that no agent can continue without the operator."""

    since_t_ns: int | None = None
    """None while it goes on."""
    is_told: bool = False
    next_check_t_ns: int = 0


@dataclass(slots=True)
class OperatorState:
    """The proposal that waits, and orders to several vehicles."""

    approval: Approval = field(default_factory=Approval)
    orders: dict[int, OrderInProgress] = field(default_factory=dict)
    """Orders with outstanding results, by number."""
    targets: dict[Label, TargetSettings] = field(default_factory=dict)
    """Targets that are ignored or ranked by order."""
    order_count: int = 0
    """Number of the last order."""
    standstill: Standstill = field(default_factory=Standstill)

    def is_ignored(self, target: Label) -> bool:
        """Return True if a target is ignored by order."""
        return target in self.targets and self.targets[target].is_ignored

    def begin(self, ongoing: OrderInProgress) -> int:
        """Keep an order until all its results are known; return its number."""
        self.order_count += 1
        self.orders[self.order_count] = ongoing
        return self.order_count

    def finish(self, number: int, t_ns: int, state: AnswerState, detail: str, vehicle: int) -> OrderAnswer:
        """Return the final reply of an order for one vehicle."""
        ongoing = self.orders[number]
        answer = ongoing.answer(t_ns, state, detail, vehicle)
        if not ongoing.waiting:
            del self.orders[number]
        return answer
