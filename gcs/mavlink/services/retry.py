"""A request that is repeated, ever more slowly, until somebody answers it.

MAVLink has no transport: every request is sent again when its answer does not come. The waits grow
geometrically up to a bound, so that a slow radio is not flooded by the very repeats that its delay caused.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.mavlink.frames.codec import Message
from gcs.model import NS_PER_S


def ns(seconds: float) -> int:
    """Seconds as integer nanoseconds."""
    return round(seconds * NS_PER_S)


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """How long to wait for an answer, and how often to ask."""

    wait_s: float
    max_wait_s: float
    growth: float = 1.5
    max_tries: int = 12
    """Times that the request is sent before it counts as unanswered; 0 means for ever."""


class RetryTimer:
    """One request on its way. Time is an argument; nothing is sent from here."""

    def __init__(self, request: Message, policy: RetryPolicy, first_t_ns: int) -> None:
        self.request = request
        self.sent = 0
        self._policy = policy
        self._wait_s = policy.wait_s
        self._next_t_ns = first_t_ns
        self._sent_t_ns = first_t_ns

    @property
    def next_t_ns(self) -> int:
        """Before then nothing is due."""
        return self._next_t_ns

    def start_try(self, t_ns: int) -> bool:
        """Whether to send the request now; if so, the next wait begins."""
        if t_ns < self._next_t_ns or self.is_exhausted(t_ns):
            return False
        self.sent += 1
        self._sent_t_ns = t_ns
        self._next_t_ns = t_ns + ns(self._wait_s)
        self._wait_s = min(self._wait_s * self._policy.growth, self._policy.max_wait_s)
        return True

    def is_exhausted(self, t_ns: int) -> bool:
        """Whether the last try has been waited out."""
        return 0 < self._policy.max_tries <= self.sent and t_ns >= self._next_t_ns

    def round_trip_s(self, t_ns: int) -> float | None:
        """How long an answer took that comes now; None when it cannot be told which try it answers."""
        return (t_ns - self._sent_t_ns) / NS_PER_S if self.sent == 1 else None
