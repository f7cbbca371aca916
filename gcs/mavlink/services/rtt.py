"""How long an answer takes on a link, and how long to wait for one before the request is repeated.

The wait follows the round trip. Only what was asked once is measured, and a wait that grew stays so until the
next measurement (Karn & Partridge, *Improving Round-Trip Time Estimates in Reliable Transport Protocols*,
1987): repeats that a loss calls for come soon, and on a link that has become slow they soon become rare. Of
the last few measurements the median counts, not a mean (RFC 6298): a vehicle repeats its own questions, too,
and what then looks like an answer after a second is one to nothing.

Where round trips are short, a missing answer was lost and not held up. There repeats hardly become rarer, and
on the shortest each goes out twice at once. Autopilots are no help with that: ArduPlane asks for a lost item
again after 1 s, PX4 after 250 ms.
"""

from __future__ import annotations

from collections import deque
from statistics import median_low
from typing import Final

from gcs.mavlink.services.retry import RetryPolicy

_MAX_SAMPLES: Final = 9
_WAIT_ROUND_TRIPS: Final = 2.0
_INITIAL_WAIT_S: Final = 0.2
"""Before the first measurement."""
_MIN_WAIT_S: Final = 0.05
"""The service's tick: repeats cannot come sooner."""
_DUPLICATE_BELOW_S: Final = 0.1
_SHORT_WAIT_S: Final = 0.25
_MAX_WAIT_S: Final = 1.2
"""Between two tries on a link that is not slow: a PX4 gives up after 5 s in which it hears none of them."""
_GROWTH: Final = 1.5
_MAX_GROWTH: Final = 3.0
_SHORT_GROWTH: Final = 1.1
_MAX_SHORT_GROWTH: Final = 1.3


class RttEstimator:
    """Of one conversation after the other with one vehicle.

    Parameters
    ----------
    round_trip_s : float
        What was measured on its link before; 0 when nothing was.
    """

    def __init__(self, round_trip_s: float = 0.0) -> None:
        self.round_trip_s: float | None = None
        """None before it has been measured here."""
        self.retransmissions = 0
        """Messages that were sent again."""
        self._samples_s = deque([round_trip_s] if round_trip_s else [], _MAX_SAMPLES)
        self._base_wait_s = (
            max(_MIN_WAIT_S, _WAIT_ROUND_TRIPS * round_trip_s) if round_trip_s else _INITIAL_WAIT_S
        )
        self._growth = 1.0

    @property
    def wait_s(self) -> float:
        """How long to wait for an answer now."""
        return max(self._base_wait_s, min(self._base_wait_s * self._growth, _MAX_WAIT_S))

    @property
    def copies(self) -> int:
        """Times to send a repeat at once."""
        return 2 if self._samples_s and self._base_wait_s < _DUPLICATE_BELOW_S else 1

    @property
    def _is_short(self) -> bool:
        return bool(self._samples_s) and self._base_wait_s < _SHORT_WAIT_S

    def retry_policy(self, max_tries: int, min_total_s: float = 0.0) -> RetryPolicy:
        """Return that as the policy of one request: so many tries, and more for at least so long."""
        wait_s, growth = self.wait_s, _SHORT_GROWTH if self._is_short else _GROWTH
        max_wait_s = max(_MAX_WAIT_S, wait_s)
        total_s, next_s, needed = 0.0, wait_s, 0
        while total_s < min_total_s:
            total_s, next_s, needed = total_s + next_s, min(next_s * growth, max_wait_s), needed + 1
        return RetryPolicy(
            wait_s=wait_s, max_wait_s=max_wait_s, growth=growth, max_tries=max(max_tries, needed)
        )

    def add_sample(self, round_trip_s: float | None) -> None:
        """Take what an answer took to come; None for one to a request that was asked more than once."""
        if round_trip_s is None:
            return
        self._samples_s.append(round_trip_s)
        self.round_trip_s = median_low(self._samples_s)
        self._base_wait_s = max(_MIN_WAIT_S, _WAIT_ROUND_TRIPS * self.round_trip_s)
        self._growth = 1.0

    def back_off(self) -> None:
        """Note that no answer came in time."""
        growth, max_growth = (_SHORT_GROWTH, _MAX_SHORT_GROWTH) if self._is_short else (_GROWTH, _MAX_GROWTH)
        self._growth = max(self._growth, min(self._growth * growth, max_growth))
