"""A question that is repeated, ever more slowly, until somebody answers it.

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
    wait_max_s: float
    growth: float = 1.5
    tries: int = 12
    """Times that the question is sent before it counts as unanswered; 0 means for ever."""


class RetryTimer:
    """One question on its way. Time is an argument; nothing is sent from here."""

    def __init__(self, question: Message, patience: RetryPolicy, first_t_ns: int) -> None:
        self.question = question
        self.sent = 0
        self._patience = patience
        self._wait_s = patience.wait_s
        self._next_t_ns = first_t_ns
        self._sent_t_ns = first_t_ns

    @property
    def next_t_ns(self) -> int:
        """Before then nothing is due."""
        return self._next_t_ns

    def due(self, t_ns: int) -> bool:
        """Whether to send the question now; if so, the next wait begins."""
        if t_ns < self._next_t_ns or self.unanswered(t_ns):
            return False
        self.sent += 1
        self._sent_t_ns = t_ns
        self._next_t_ns = t_ns + ns(self._wait_s)
        self._wait_s = min(self._wait_s * self._patience.growth, self._patience.wait_max_s)
        return True

    def unanswered(self, t_ns: int) -> bool:
        """Whether the last try has been waited out."""
        return 0 < self._patience.tries <= self.sent and t_ns >= self._next_t_ns

    def took_s(self, t_ns: int) -> float | None:
        """How long an answer took that comes now; None when it cannot be told which try it answers."""
        return (t_ns - self._sent_t_ns) / NS_PER_S if self.sent == 1 else None
