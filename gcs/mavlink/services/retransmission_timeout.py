"""Round-trip time of a link, and the wait before a request is repeated.

Only requests that were sent once are measured. A wait that has grown stays so until the next measurement
(Karn & Partridge, *Improving Round-Trip Time Estimates in Reliable Transport Protocols*, 1987). The estimate
is the median of the last samples, not a mean (RFC 6298): a vehicle repeats its own requests, and a false
sample may result.

On a short round trip a missing answer was lost, not delayed: waits hardly grow there, and on the shortest
each repeat is sent twice. ArduPlane itself repeats a lost request after 1 s only, PX4 after 250 ms.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from statistics import median_low
from typing import Final

from gcs.mavlink.services.retry import RetryPolicy

_MAX_SAMPLES: Final = 9
_WAIT_ROUND_TRIPS: Final = 2.0
_INITIAL_WAIT_S: Final = 0.2
"""Before the first sample."""
_MIN_WAIT_S: Final = 0.05
"""Tick of the service: repeats cannot come sooner."""
_DUPLICATE_BELOW_S: Final = 0.1
_SHORT_WAIT_S: Final = 0.25
_MAX_WAIT_S: Final = 1.2
"""Between two tries, unless the link is slow: PX4 gives up after 5 s without one."""
_GROWTH: Final = 1.5
_MAX_GROWTH: Final = 3.0
_SHORT_GROWTH: Final = 1.1
_MAX_SHORT_GROWTH: Final = 1.3


@dataclass(slots=True)
class RttEstimator:
    """Round-trip time of one vehicle's link."""

    earlier_s: float = 0.0
    """Earlier measurement; 0 for none."""
    samples_s: list[float] = field(default_factory=list)
    """Last measurements here."""
    retransmissions: int = 0
    """Messages sent again."""
    growth: float = 1.0
    """Growth of the wait since the last measurement."""

    @property
    def round_trip_s(self) -> float | None:
        """Estimate; None before the first sample here."""
        return self._estimate_s() if self.samples_s else None

    def _estimate_s(self) -> float:
        """Return the estimate, also from the earlier measurement; 0 without any."""
        earlier_s = [self.earlier_s] if self.earlier_s else []
        samples_s = [*earlier_s, *self.samples_s][-_MAX_SAMPLES:]
        return median_low(samples_s) if samples_s else 0.0

    @property
    def wait_s(self) -> float:
        """Present wait for an answer."""
        base_wait_s = self._base_wait_s
        return max(base_wait_s, min(base_wait_s * self.growth, _MAX_WAIT_S))

    @property
    def _base_wait_s(self) -> float:
        if not self._is_measured:
            return _INITIAL_WAIT_S
        return max(_MIN_WAIT_S, _WAIT_ROUND_TRIPS * self._estimate_s())

    @property
    def _is_measured(self) -> bool:
        return bool(self.earlier_s or self.samples_s)

    @property
    def copies(self) -> int:
        """Copies of a repeat to send at once."""
        return 2 if self._is_measured and self._base_wait_s < _DUPLICATE_BELOW_S else 1

    @property
    def _is_short(self) -> bool:
        return self._is_measured and self._base_wait_s < _SHORT_WAIT_S

    def retry_policy(self, max_tries: int, min_total_s: float = 0.0) -> RetryPolicy:
        """Return the policy of one request: at least `max_tries`, and more for at least `min_total_s`."""
        wait_s = self.wait_s
        growth = _SHORT_GROWTH if self._is_short else _GROWTH
        max_wait_s = max(_MAX_WAIT_S, wait_s)
        total_s = 0.0
        next_s = wait_s
        needed = 0
        while total_s < min_total_s:
            total_s = total_s + next_s
            next_s = min(next_s * growth, max_wait_s)
            needed = needed + 1
        return RetryPolicy(
            wait_s=wait_s, max_wait_s=max_wait_s, growth=growth, max_tries=max(max_tries, needed)
        )

    def add_sample(self, round_trip_s: float | None) -> None:
        """Add the round trip of an answer; None if it was ambiguous."""
        if round_trip_s is None:
            return
        self.samples_s = [*self.samples_s, round_trip_s][-_MAX_SAMPLES:]
        self.growth = 1.0

    def back_off(self) -> None:
        """Note a missing answer: the wait grows."""
        growth, max_growth = (_SHORT_GROWTH, _MAX_SHORT_GROWTH) if self._is_short else (_GROWTH, _MAX_GROWTH)
        self.growth = max(self.growth, min(self.growth * growth, max_growth))
