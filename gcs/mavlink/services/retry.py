"""Retries of a request until it is answered: how often, and the waits between (`RetryPolicy`, `RetryTimer`).

MAVLink has no transport layer: every request is sent again if its answer does not come. Waits grow
geometrically up to a bound, so that repeats do not flood a slow radio.
"""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.model import NS_PER_S


def ns(seconds: float) -> int:
    """Return seconds as integer nanoseconds."""
    return round(seconds * NS_PER_S)


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """Waits and number of tries of a request."""

    wait_s: float
    max_wait_s: float
    growth: float = 1.5
    max_tries: int = 12
    """Tries before the request counts as unanswered; 0 for no bound."""


@dataclass(slots=True)
class RetryTimer:
    """Timer of one request. It sends nothing itself."""

    request: dialect.MAVLink_message
    policy: RetryPolicy
    next_t_ns: int
    """Earliest time of the next try."""
    sent: int = 0
    sent_t_ns: int = 0
    """Time of the last try."""
    next_wait_s: float = 0.0
    """Wait after the next try; 0 for that of the policy."""

    def start_try(self, t_ns: int) -> bool:
        """Start the next try if it is due; return True if the request is to be sent now."""
        if t_ns < self.next_t_ns or self.is_exhausted(t_ns):
            return False
        wait_s = self.next_wait_s or self.policy.wait_s
        self.sent += 1
        self.sent_t_ns = t_ns
        self.next_t_ns = t_ns + ns(wait_s)
        self.next_wait_s = min(wait_s * self.policy.growth, self.policy.max_wait_s)
        return True

    def is_exhausted(self, t_ns: int) -> bool:
        """Return True if the wait after the last try is over."""
        return 0 < self.policy.max_tries <= self.sent and t_ns >= self.next_t_ns

    def round_trip_s(self, t_ns: int) -> float | None:
        """Return the round trip of an answer that comes now; None if it is ambiguous which try it answers."""
        return (t_ns - self.sent_t_ns) / NS_PER_S if self.sent == 1 else None
