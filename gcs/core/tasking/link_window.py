"""How many transfers go at a time over one link.

A radio is slow, and shared: too many transfers at once wait for each other until every question is repeated
before its answer can come. So each link has a window, found as TCP finds its own (Jacobson, *Congestion
Avoidance and Control*, 1988): it opens by one with each transfer that went well, and is halved when round
trips become long against the shortest seen, or when many messages had to be repeated; at most once for the
transfers that were under way together. A link that loses much though its round trips stay short is a bad one
rather than a crowded one: it keeps a few places, so that vehicles do not wait for each other's repeats.
"""

from __future__ import annotations

import math
from typing import Final

_FIRST_WINDOW: Final = 8
_LONG: Final = 3.0
_SLACK_S: Final = 0.1
_REPEATED: Final = 0.25
_LOSSY_WINDOW: Final = 4


class UploadWindow:
    """One link's window; `most` bounds it."""

    def __init__(self, most: int) -> None:
        self.window = min(most, _FIRST_WINDOW)
        self.round_trip_s = 0.0
        """Of the last transfer."""
        self._most = most
        self._least_s = math.inf
        self._narrowed_t_ns = -1

    def ended(self, began_t_ns: int, t_ns: int, round_trip_s: float | None, repeated: float) -> None:
        """Take what a transfer found out.

        Parameters
        ----------
        began_t_ns, t_ns
            When it began and ended.
        round_trip_s
            From an item to the next request, None when it was not measured.
        repeated
            Messages sent again, as a part of its items.
        """
        is_long = False
        if round_trip_s is not None:
            self.round_trip_s = round_trip_s
            self._least_s = min(self._least_s, round_trip_s)
            is_long = round_trip_s > _LONG * self._least_s + _SLACK_S
        if not is_long and repeated <= _REPEATED:
            self.window = min(self._most, self.window + 1)
        elif began_t_ns > self._narrowed_t_ns:
            is_lossy = round_trip_s is not None and not is_long
            self.window = max(1, min(_LOSSY_WINDOW, self.window) if is_lossy else 0, self.window // 2)
            self._narrowed_t_ns = t_ns
