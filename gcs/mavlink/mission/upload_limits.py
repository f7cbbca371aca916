"""Bounds of mission uploads: how often something is repeated, how long in all, how many items at a time.

Waits follow the measured round trip (`gcs.mavlink.services.retransmission_timeout`). The bounds here follow
ArduPlane.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

from gcs.mavlink.services.retry import RetryPolicy

MAX_ITEMS_IN_FLIGHT: Final = 12
"""Mission items of all uploads over one link that are outstanding; each upload has at least one."""
_SHORT_ROUND_TRIP_S = 0.2
"""Round trip up to which the limits are those of a short link."""


@dataclass(frozen=True, slots=True)
class UploadLimits:
    """Timeouts and bounds of each stage."""

    max_tries: int = 24
    """Times that MISSION_COUNT, MISSION_CLEAR_ALL or a command is sent."""
    min_answer_s: float = 20.0
    """They are repeated for at least so long."""
    loiter_retry: RetryPolicy = field(
        default_factory=lambda: RetryPolicy(wait_s=0.25, max_wait_s=1.0, max_tries=40)
    )
    """For LOITER, on which the vehicle's safety may depend."""
    request_timeout_s: float = 8.5
    """Upload without a request. ArduPlane repeats each second and gives up after 8 s."""
    ack_timeout_s: float = 2.5
    """Wait for MISSION_ACK after the last item; then the read-back decides."""
    settle_s: float = 1.2
    """Delay before a failure ACK or a late request counts. ArduPlane repeats its request sooner."""
    max_uploads: int = 8
    """Uploads before the task fails."""
    first_pause_s: float = 0.5
    """Pause before the second upload; each further one is twice as long."""
    max_pause_s: float = 4.0
    max_refusals: int = 4
    """Refusals of a command before the task fails."""
    max_mode_age_s: float = 0.3
    """Nothing that steers is sent unless a heartbeat has shown the mode so recently."""
    max_hold_age_s: float = 1.5
    """The same for LOITER over an inconsistent mission: as heartbeats come without a request."""
    mode_period_s: float = 0.4
    """Interval of the requests for heartbeats during transfers."""
    rejection_s: float = 2.5
    """Wait for the MISSION_CURRENT (1 Hz) that tells a rejected mission from an operator's Hold."""
    guard_s: float = 3.0
    """In AUTO over an inconsistent mission: LOITER when the next item is nearer than this."""
    loiter_repeat_s: float = 0.25
    """Interval of that LOITER command until the heartbeat shows it."""
    transfer_timeout_s: float = 300.0
    """For all uploads and read-backs together."""
    stall_s: float = 25.0
    """Transfer in which no further item is requested or received."""
    max_stalls: int = 2
    """Such transfers before the task fails: the vehicle does not obey."""
    max_same_differences: int = 4
    """Read-backs with the same difference before the task fails."""
    max_clearings: int = 4
    """Clearings that are acknowledged, but leave items, before the task fails."""
    slow_s: float = 10.0
    """Time after which the operator is told what an upload waits for; again after three times as long."""

    def pause_s(self, attempts: int) -> float:
        """Return the pause after so many attempts."""
        return min(self.max_pause_s, self.first_pause_s * 2.0 ** (attempts - 1)) if attempts else 0.0

    def for_round_trip(self, round_trip_s: float) -> UploadLimits:
        """Return the limits for a link with this round trip: no decision before an answer can have come."""
        if round_trip_s <= _SHORT_ROUND_TRIP_S:
            return self
        return replace(
            self,
            ack_timeout_s=max(self.ack_timeout_s, 2.0 * round_trip_s),
            settle_s=max(self.settle_s, 1.0 + round_trip_s),
        )


class UploadPolicy:
    """Policy of uploads by flight and link; this one is for an unknown flight, alone on its link."""

    def time_to_next_s(self, _vehicle: int, _t_ns: int, /) -> float:
        """Return the least time in seconds before a vehicle reaches its next item.

        0 if unknown, infinite if it flies no mission.
        """
        return 0.0

    def first_item(self, _vehicle: int, /) -> int:
        """Return the item to begin with; asked again after verification, since the vehicle moves."""
        return 0

    def max_items_in_flight(self, _vehicle: int, /) -> int:
        """Return the number of mission items that the link may carry at a time."""
        return 1 << 16
