"""Bridge's side of the lease: one epoch at a time may command its vehicles.

An epoch is granted when the lease before it has ended. Its holder renews it, also after its end, as long as
no other node got the bridge. Effects need a permit of the present epoch that is younger than a lease. So
those of older epochs are dropped, and those that took too long.
"""

from __future__ import annotations

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


class Claim(NamedTuple):
    """Refused ask of a node with a higher standing than the holder."""

    node: NodeId
    standing: Standing
    t_ns: int


class BridgeLease(NamedTuple):
    """Lease of one bridge. All times are of the bridge's clock."""

    epoch: Epoch
    """Present epoch, or the last one; number 0 before the first grant."""
    holder: NodeId | None
    """Node of the epoch; None before the first grant."""
    standing: Standing
    """Of the holder, by its last ask."""
    answered_t_ns: int
    """Time of the last grant or renewal; of the start before that."""
    highest: int
    """Highest number of an epoch, granted here or known to a node that asked."""
    opens_t_ns: int
    """Earliest time of a grant."""
    claim: Claim | None = None


def start_lease(boot: int, t_ns: int, *, is_only_bridge: bool, times: LeaseTimes = TIMES) -> BridgeLease:
    """Return the lease of a bridge that starts.

    A bridge beside others grants nothing for a lease: a node may still count it to those that it holds.
    """
    opens_t_ns = t_ns if is_only_bridge else t_ns + times.lease_ns
    return BridgeLease(Epoch(0, boot), None, NO_STANDING, t_ns, 0, opens_t_ns)


def answer_ask(
    lease: BridgeLease, ask: Ask, t_ns: int, times: LeaseTimes = TIMES
) -> tuple[BridgeLease, Answer]:
    """Grant, renew or refuse a lease; return the bridge's new state and its answer."""
    lease = lease._replace(highest=max(lease.highest, ask.seen))
    is_holder = lease.holder == ask.node
    if not is_holder and is_held(lease, t_ns, times):
        return _refused(_with_claim(lease, ask, t_ns, times), ask, t_ns, times)
    if t_ns < lease.opens_t_ns or _is_outranked(lease, ask, t_ns, times):
        return _refused(lease, ask, t_ns, times)
    if not is_holder:
        number = lease.highest + 1
        lease = lease._replace(
            epoch=lease.epoch._replace(number=number), holder=ask.node, highest=number, claim=None
        )
    lease = lease._replace(standing=ask.standing, answered_t_ns=t_ns)
    permit = Permit(lease.epoch, t_ns)
    return lease, Answer(ask.node, ask.sent_t_ns, permit, ask.node.name, lease.highest, times.lease_ns)


def extend_lease(lease: BridgeLease, t_ns: int) -> BridgeLease:
    """Return the lease of a bridge that stood still: its holder has a whole lease to renew it.

    The asks of a standby may be read before those of the holder. Permits are not extended.
    """
    return lease._replace(answered_t_ns=t_ns)


def accepts(lease: BridgeLease, permit: Permit, t_ns: int, times: LeaseTimes = TIMES) -> bool:
    """Return True if effects with a permit may go to the vehicles."""
    return lease.holder is not None and permit.epoch == lease.epoch and t_ns < permit.t_ns + times.lease_ns


def is_held(lease: BridgeLease, t_ns: int, times: LeaseTimes = TIMES) -> bool:
    """Return True if the lease of the holder has not ended."""
    return lease.holder is not None and t_ns < lease.answered_t_ns + times.lease_ns


def _refused(lease: BridgeLease, ask: Ask, t_ns: int, times: LeaseTimes) -> tuple[BridgeLease, Answer]:
    """Refuse a lease."""
    free_t_ns = lease.opens_t_ns
    holder = ""
    if lease.holder is not None and is_held(lease, t_ns, times):
        free_t_ns = lease.answered_t_ns + times.lease_ns
        holder = lease.holder.name
    return lease, Answer(ask.node, ask.sent_t_ns, None, holder, lease.highest, max(free_t_ns - t_ns, 0))


def _with_claim(lease: BridgeLease, ask: Ask, t_ns: int, times: LeaseTimes) -> BridgeLease:
    """Note a refused ask if its node holds more than the holder, and than other nodes that asked."""
    if ask.standing <= lease.standing or _is_outranked(lease, ask, t_ns, times):
        return lease
    return lease._replace(claim=Claim(ask.node, ask.standing, t_ns))


def _is_outranked(lease: BridgeLease, ask: Ask, t_ns: int, times: LeaseTimes) -> bool:
    """Return True if another node with a higher standing asked a short time ago."""
    claim = lease.claim
    return (
        claim is not None
        and claim.node != ask.node
        and claim.standing > ask.standing
        and t_ns < claim.t_ns + times.claim_ns
    )
