"""Upload window of a link: how many uploads at a time, by its round trip and loss.

A radio is slow and shared. With too many uploads at a time every request is repeated before its reply can
come. The window follows TCP (Jacobson, *Congestion Avoidance and Control*, 1988): each success adds one. Long
round trips, or many repeated messages, halve it, at most once for uploads that overlapped. A link with much
loss and short round trips is poor rather than congested, and keeps a few uploads at a time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

_FIRST_WINDOW: Final = 8
_LONG: Final = 3.0
_SLACK_S: Final = 0.1
_REPEATED: Final = 0.25
_LOSSY_WINDOW: Final = 4


@dataclass(slots=True)
class UploadWindow:
    """Upload window of one link."""

    max_window: int
    window: int
    """Number of uploads at a time."""
    active: int = 0
    """Number of uploads in progress."""
    round_trip_s: float = 0.0
    """Round-trip time of the last upload; 0 before the first."""
    min_round_trip_s: float = math.inf
    narrowed_t_ns: int = -1
    """Time at which the window was halved; -1 if it never was."""

    @classmethod
    def first(cls, max_window: int) -> UploadWindow:
        """Return the window before the first upload."""
        return cls(max_window, min(max_window, _FIRST_WINDOW))

    def note_end(self, began_t_ns: int, t_ns: int, round_trip_s: float | None, repeated: float) -> None:
        """Adjust the window to the result of an upload.

        Parameters
        ----------
        began_t_ns, t_ns
            Time of its begin and end.
        round_trip_s
            Time from an item to the next request; None if it was not measured.
        repeated
            Number of repeated messages, per item.
        """
        is_long = False
        if round_trip_s is not None:
            self.round_trip_s = round_trip_s
            self.min_round_trip_s = min(self.min_round_trip_s, round_trip_s)
            is_long = round_trip_s > _LONG * self.min_round_trip_s + _SLACK_S
        if not is_long and repeated <= _REPEATED:
            self.window = min(self.max_window, self.window + 1)
        elif began_t_ns > self.narrowed_t_ns:
            is_lossy = round_trip_s is not None and not is_long
            self.window = max(1, min(_LOSSY_WINDOW, self.window) if is_lossy else 0, self.window // 2)
            self.narrowed_t_ns = t_ns
