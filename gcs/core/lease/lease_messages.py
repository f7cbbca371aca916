"""Messages of the lease and its times. Clocks are monotonic, each machine's own."""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias

from gcs.model import NS_PER_S

Standing: TypeAlias = tuple[int, int]
"""Number of bridges that a node holds, and minus the index of the first of them; a higher one prevails."""
NO_STANDING: Final[Standing] = (0, 0)


class LeaseTimes(NamedTuple):
    """Times of the lease, in nanoseconds; equal at all bridges and nodes of a mission."""

    lease_ns: int = 3 * NS_PER_S // 2
    """Time from a bridge's answer until its permit ends, by the bridge's clock."""
    period_ns: int = 3 * NS_PER_S // 10
    """Time between the asks of a node."""
    margin_ns: int = NS_PER_S // 10
    """Time by which two clocks may differ after a lease."""
    claim_ns: int = 6 * NS_PER_S // 10
    """Time for which the ask of a node with a higher standing keeps a holder from renewing its lease."""


TIMES: Final = LeaseTimes()


class NodeId(NamedTuple):
    """One process of a command node. After a restart it is another holder."""

    name: str
    run: int
    """Random number of 63 bits, new at each start of the process."""


class Epoch(NamedTuple):
    """Identity of a lease, from its grant until another node gets the bridge."""

    number: int
    """Grows strictly while the bridge runs, and for each node over restarts of the bridge, too."""
    boot: int
    """Random number of 63 bits, new at each start of the bridge. So no epoch is granted twice."""


class Permit(NamedTuple):
    """Right to send effects to the vehicles of a bridge; each batch of effects has one.

    It lasts for a lease from its time.
    """

    epoch: Epoch
    t_ns: int
    """Time of the bridge's answer, by the bridge's clock."""


class Ask(NamedTuple):
    """Request of a node to a bridge for a lease, or for more time."""

    node: NodeId
    sent_t_ns: int
    """By the node's clock; the answer repeats it."""
    seen: int
    """Highest number of an epoch that the node knows of this bridge."""
    standing: Standing


class Answer(NamedTuple):
    """Answer of a bridge to an `Ask`."""

    node: NodeId
    sent_t_ns: int
    permit: Permit | None
    """None if the lease is refused."""
    holder: str
    """Name of the node that has the lease now; empty if no node has it."""
    number: int
    """Highest number of an epoch of this bridge."""
    free_in_ns: int
    """Time until the lease of the holder ends unless it is renewed."""
