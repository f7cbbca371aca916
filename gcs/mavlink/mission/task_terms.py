"""The terms of a mission task: what it waits for, and what it reports.

How long an answer is waited for is learnt from the link (`gcs.mavlink.services.rtt`); the bounds here follow
what ArduPlane does. Radios that are slow get other numbers, not other code.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

from gcs.mavlink.services.retry import RetryPolicy

Stage: TypeAlias = Literal["new", "park", "upload", "verify", "select", "mode", "hold", "clear", "done"]
Holds: TypeAlias = Literal["equal", "old", "whole", "cleared", "unknown"]

_SHORT_ROUND_TRIP_S = 0.2


@dataclass(frozen=True, slots=True)
class Timing:
    """Time-outs and bounds, per step: the only bound on the whole is `give_up_s`."""

    tries: int = 24
    """Times that MISSION_COUNT, MISSION_CLEAR_ALL or a command is sent."""
    answer_s: float = 20.0
    """For at least so long."""
    hold: RetryPolicy = field(default_factory=lambda: RetryPolicy(wait_s=0.25, wait_max_s=1.0, tries=40))
    """LOITER, on which a vehicle's safety may hang."""
    silence_s: float = 8.5
    """Upload without a request; ArduPlane asks each second and gives up after 8 s."""
    last_ack_s: float = 2.5
    """After the last item; then the read-back decides."""
    settle_s: float = 1.2
    """Before a failure ACK or a late request is believed: longer than ArduPlane takes to ask again."""
    uploads: int = 8
    """Times that the upload is started before the task is abandoned."""
    refusals: int = 4
    """Times that a command may be refused."""
    guard_s: float = 3.0
    """In AUTO over a mixed store: LOITER when the next item is nearer than this."""
    hold_again_s: float = 0.25
    """Between two such orders, until the vehicle says that it does: twelve of them in `guard_s`."""
    delegate_s: float = 60.0
    """For another program to upload."""
    give_up_s: float = 300.0
    """Upload and read-back together: generous, against a stall that no step sees."""

    def over(self, round_trip_s: float) -> Timing:
        """Return the same for a link of this round trip: nothing is judged while its answer may be due."""
        if round_trip_s <= _SHORT_ROUND_TRIP_S:
            return self
        return replace(
            self,
            last_ack_s=max(self.last_ack_s, 2.0 * round_trip_s),
            settle_s=max(self.settle_s, 1.0 + round_trip_s),
        )


@dataclass(frozen=True, slots=True)
class TaskResult:
    """How a task ended."""

    t_ns: int
    ok: bool
    """Stored, read back equal, and being flown."""
    holds: Holds
    """What it stores: this mission ("equal"), what it had before ("old"), one of the two ("whole"), none
    ("cleared"), or perhaps a mix ("unknown")."""
    detail: str
    duration_s: float
    retries: int
    held: bool
    """Whether it was told to LOITER, and so does not fly its mission unless `ok`."""
    selected: bool
    """Whether what it stores is what it flies, if it flies: until the first item of another mission was
    selected, it flies an item of the mission before, and counts on from that one's number."""
