"""Command node's side of the lease: when it asks, which bridges it holds, whether it commands.

A node counts a bridge as held until a lease after it *sent* the ask, less a margin. The bridge's answer is
later than the ask, so the permit ends later, whatever the two clocks show. Each node waits another short
time before it asks for a free bridge (`delay_ns`, chosen at random in `gcs.service.bridge_connection`).

A node commands while it holds most of the mission's bridges; of half of them, those with the first. Two
nodes with most of them have one in common, which granted them one after the other. For a lease, a bridge
that the new node does not hold may still accept effects of the one before. So a new bridge counts after
that time only, unless all are held.
"""

from __future__ import annotations

from collections.abc import Collection
from enum import Enum
from typing import NamedTuple

from gcs.core.lease.lease_messages import (
    NO_STANDING,
    TIMES,
    Answer,
    Ask,
    Epoch,
    LeaseTimes,
    NodeId,
    Permit,
    Standing,
)


class Duty(Enum):
    """What a node may do; the values are words for operators."""

    STANDBY = "standby"
    """Holds no bridge."""
    HOLDS_FEWER = "holds fewer bridges"
    """Sends nothing; vehicles finish their verified missions."""
    WAITS = "waits for effects of the node before"
    """Holds most bridges, not all, since a short time; sends nothing yet."""
    COMMANDS = "commands"


class Hold(NamedTuple):
    """Lease of one bridge that was granted to this node."""

    permit: Permit
    sent_t_ns: int
    """Time of the ask for the permit."""
    since_t_ns: int
    """Time of the first answer with this epoch."""


class BridgeView(NamedTuple):
    """What a node knows of one bridge. All times are of the node's clock."""

    asked_t_ns: int
    """Time of the last ask."""
    answered_t_ns: int
    """Time of sending of the latest ask that was answered."""
    free_t_ns: int
    """Time of the next ask while this node holds no bridge."""
    seen: int = 0
    """Highest number of an epoch."""
    holder: str = ""
    """Name of the node that had the lease at the last answer; empty if none had it."""
    hold: Hold | None = None
    """None if the last answer was a refusal."""


class NodeLease(NamedTuple):
    """Leases of one command node."""

    node: NodeId
    bridges: tuple[str, ...]
    """All bridges of the mission, in the order of the mission file; equal at all nodes."""
    views: tuple[BridgeView, ...]
    """One for each bridge, in the same order."""
    delay_ns: int
    """Time that this standby leaves to other standbys when a lease has run out; another one for each."""
    is_only_node: bool
    """True if the mission has no other command node: one bridge suffices to command its vehicles."""


def start_node(
    node: NodeId,
    bridges: tuple[str, ...],
    t_ns: int,
    *,
    delay_ns: int,
    is_only_node: bool,
    times: LeaseTimes = TIMES,
) -> NodeLease:
    """Return the state of a node that starts; its first asks are due."""
    view = BridgeView(t_ns - times.period_ns, t_ns, t_ns)
    return NodeLease(node, bridges, (view,) * len(bridges), delay_ns, is_only_node)


def take_due_asks(node: NodeLease, t_ns: int, times: LeaseTimes = TIMES) -> tuple[NodeLease, dict[str, Ask]]:
    """Return the asks that are to be sent now, by bridge, and the node's new state."""
    own = standing(node, t_ns, times)
    views = list(node.views)
    asks = dict[str, Ask]()
    for index, view in enumerate(views):
        if t_ns >= _next_ask_t_ns(view, times, is_standby=own == NO_STANDING):
            asks[node.bridges[index]] = Ask(node.node, t_ns, view.seen, own)
            views[index] = view._replace(asked_t_ns=t_ns)
    return node._replace(views=tuple(views)), asks


def receive_answer(node: NodeLease, bridge: str, answer: Answer, t_ns: int) -> NodeLease:
    """Process an answer. Late ones, and those to an earlier process of the node, change nothing."""
    index = node.bridges.index(bridge)
    view = node.views[index]
    if answer.node != node.node or answer.sent_t_ns < view.answered_t_ns:
        return node
    view = view._replace(
        answered_t_ns=answer.sent_t_ns,
        free_t_ns=t_ns + answer.free_in_ns + node.delay_ns,
        seen=max(view.seen, answer.number),
        holder=answer.holder,
        hold=_hold(view.hold, answer, t_ns),
    )
    return node._replace(views=(*node.views[:index], view, *node.views[index + 1 :]))


def epochs_held(node: NodeLease, t_ns: int, times: LeaseTimes = TIMES) -> dict[str, Epoch]:
    """Return the epoch of each bridge that this node holds.

    A new epoch is a take-over of that bridge's vehicles: they are reconciled. The same epoch after a time
    without it is none: no other node had the bridge.
    """
    return {
        bridge: view.hold.permit.epoch
        for bridge, view in zip(node.bridges, node.views, strict=True)
        if view.hold is not None and t_ns < view.hold.sent_t_ns + times.lease_ns - times.margin_ns
    }


def duty(node: NodeLease, t_ns: int, times: LeaseTimes = TIMES) -> Duty:
    """Return what a node may do now."""
    held = epochs_held(node, t_ns, times)
    if not held:
        return Duty.STANDBY
    if node.is_only_node or len(held) == len(node.bridges):
        return Duty.COMMANDS
    if not are_most(held, node.bridges):
        return Duty.HOLDS_FEWER
    wait_ns = times.lease_ns + times.margin_ns
    settled = [
        bridge
        for bridge, view in zip(node.bridges, node.views, strict=True)
        if bridge in held and view.hold is not None and t_ns >= view.hold.since_t_ns + wait_ns
    ]
    return Duty.COMMANDS if are_most(settled, node.bridges) else Duty.WAITS


def permit_for(node: NodeLease, bridge: str, t_ns: int, times: LeaseTimes = TIMES) -> Permit | None:
    """Return the permit for effects that are sent now to vehicles of a bridge; None if none may be sent."""
    hold = node.views[node.bridges.index(bridge)].hold
    is_allowed = bridge in epochs_held(node, t_ns, times) and duty(node, t_ns, times) is Duty.COMMANDS
    return hold.permit if hold is not None and is_allowed else None


def are_most(held: Collection[str], bridges: tuple[str, ...]) -> bool:
    """Return True for more than half of the bridges, or for half of them with the first."""
    return 2 * len(held) > len(bridges) or (2 * len(held) == len(bridges) and bridges[0] in held)


def standing(node: NodeLease, t_ns: int, times: LeaseTimes = TIMES) -> Standing:
    """Return how many bridges a node holds, and minus the index of the first of them."""
    held = epochs_held(node, t_ns, times)
    if not held:
        return NO_STANDING
    return len(held), -min(map(node.bridges.index, held))


def _next_ask_t_ns(view: BridgeView, times: LeaseTimes, *, is_standby: bool) -> int:
    """Return when a bridge is asked next: by a standby when the lease has ended, by others each period."""
    due_t_ns = view.asked_t_ns + times.period_ns
    return max(due_t_ns, view.free_t_ns) if is_standby else due_t_ns


def _hold(before: Hold | None, answer: Answer, t_ns: int) -> Hold | None:
    """Return the lease after an answer; None after a refusal."""
    if answer.permit is None:
        return None
    is_same = before is not None and before.permit.epoch == answer.permit.epoch
    since_t_ns = before.since_t_ns if before is not None and is_same else t_ns
    return Hold(answer.permit, answer.sent_t_ns, since_t_ns)
