"""How long an answer takes on a link, and how long to wait for one before the question is repeated.

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

_REMEMBERED: Final = 9
_ROUND_TRIPS: Final = 2.0
_UNKNOWN_S: Final = 0.2
"""Before the first measurement."""
_LEAST_S: Final = 0.05
"""The service's tick: repeats cannot come sooner."""
_TWICE_S: Final = 0.1
_SHORT_S: Final = 0.25
_MOST_S: Final = 1.2
"""Between two tries on a link that is not slow: a PX4 gives up after 5 s in which it hears none of them."""
_GROWTH: Final = 1.5
_MOST_GROWTH: Final = 3.0
_SHORT_GROWTH: Final = 1.1
_MOST_SHORT_GROWTH: Final = 1.3


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
        self.repeats = 0
        """Messages that were sent again."""
        self._took_s = deque([round_trip_s] if round_trip_s else [], _REMEMBERED)
        self._usual_s = max(_LEAST_S, _ROUND_TRIPS * round_trip_s) if round_trip_s else _UNKNOWN_S
        self._growth = 1.0

    @property
    def wait_s(self) -> float:
        """How long to wait for an answer now."""
        return max(self._usual_s, min(self._usual_s * self._growth, _MOST_S))

    @property
    def copies(self) -> int:
        """Times to send a repeat at once."""
        return 2 if self._took_s and self._usual_s < _TWICE_S else 1

    @property
    def _is_short(self) -> bool:
        return bool(self._took_s) and self._usual_s < _SHORT_S

    def patience(self, tries: int, least_s: float = 0.0) -> RetryPolicy:
        """Return that as the patience of one question: so many tries, and more for at least so long."""
        wait_s, growth = self.wait_s, _SHORT_GROWTH if self._is_short else _GROWTH
        wait_max_s = max(_MOST_S, wait_s)
        total_s, next_s, needed = 0.0, wait_s, 0
        while total_s < least_s:
            total_s, next_s, needed = total_s + next_s, min(next_s * growth, wait_max_s), needed + 1
        return RetryPolicy(wait_s=wait_s, wait_max_s=wait_max_s, growth=growth, tries=max(tries, needed))

    def took(self, took_s: float | None) -> None:
        """Take what an answer took to come; None for one to a question that was asked more than once."""
        if took_s is None:
            return
        self._took_s.append(took_s)
        self.round_trip_s = median_low(self._took_s)
        self._usual_s = max(_LEAST_S, _ROUND_TRIPS * self.round_trip_s)
        self._growth = 1.0

    def late(self) -> None:
        """Note that no answer came in time."""
        growth, most = (_SHORT_GROWTH, _MOST_SHORT_GROWTH) if self._is_short else (_GROWTH, _MOST_GROWTH)
        self._growth = max(self._growth, min(self._growth * growth, most))
