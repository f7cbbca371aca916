"""How long an answer takes on a link, and how long to wait for one before the question is repeated.

Only what was asked once is measured, and a wait that grew stays so until the next measurement (Karn &
Partridge, *Improving Round-Trip Time Estimates in Reliable Transport Protocols*, 1987): repeats that a loss
calls for come soon, and on a link that has become slow they soon become rare. Of the last few measurements
the median counts, not a mean (RFC 6298): a vehicle repeats its own questions, too, and what then looks like
an answer after a second is one to nothing.
"""

from __future__ import annotations

from collections import deque
from statistics import median_low
from typing import Final

from gcs.mavlink.asking import Patience

_REMEMBERED: Final = 9
_ROUND_TRIPS: Final = 2.0
_UNKNOWN_S: Final = 0.5
"""Before the first measurement."""
_LEAST_S: Final = 0.25
_MOST_S: Final = 1.2
"""Between two tries on a link that is not slow: a PX4 gives up after 5 s in which it hears none of them."""
_GROWTH: Final = 1.5
_MOST_GROWTH: Final = 3.0


class Pace:
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

    def patience(self, tries: int) -> Patience:
        """Return that as the patience of one question."""
        wait_s = self.wait_s
        return Patience(wait_s=wait_s, wait_max_s=max(_MOST_S, wait_s), growth=_GROWTH, tries=tries)

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
        self._growth = min(self._growth * _GROWTH, _MOST_GROWTH)
