"""Load of the service: times of scans and plans, dropped events, and how late it is, with a warning."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from gcs.model import NS_PER_S, Notice, NoticeCode, Parameter

LAG_WARNING_NS = NS_PER_S // 2
"""Wait of an event above which the operator is warned, once."""
_TIMES_KEPT = 10_000


@dataclass(slots=True)
class ServiceLoad:
    """Timing and losses of the service itself."""

    scan_ms: deque[float] = field(default_factory=lambda: deque(maxlen=_TIMES_KEPT))
    plan_ms: deque[float] = field(default_factory=lambda: deque(maxlen=_TIMES_KEPT))
    dropped: int = 0
    """Events that found the queue full."""
    worst_lag_s: float = 0.0
    """Longest run time that an event waited in the queue."""
    has_warned: bool = False

    def note_lag(self, lag_ns: int, t_ns: int, *, is_fast: bool) -> Notice | None:
        """Note how long an event waited, or a tick came late; return a warning once if that is too long."""
        self.worst_lag_s = max(self.worst_lag_s, lag_ns / NS_PER_S)
        if lag_ns <= LAG_WARNING_NS or self.has_warned:
            return None
        self.has_warned = True
        remedy = (
            "a lower --speed would help"
            if is_fast
            else "end other programs here, lower telemetry.rate_hz, or publish fewer scans a second"
        )
        about: dict[str, Parameter] = {
            "lag_s": lag_ns / NS_PER_S,
            "dropped": self.dropped,
            "remedy": remedy,
        }
        return Notice(t_ns, NoticeCode.SERVICE_SLOW, None, about)
