"""Pauses between failed uploads to one vehicle.

After repeated failures uploads pause, so that a vehicle that refuses its missions does not block its link.
The first failure causes no pause.

A newer route supersedes an upload in progress for `_SUPERSEDE_NS` only, counted from the first upload of such
a series. After that the upload may finish. On a lossy link an upload takes longer than the plan takes to
change, and a vehicle whose uploads were all superseded would circle for minutes.

An inconsistent mission that cannot be cleared is cleared again after growing pauses, and after
`_MAX_CLEARINGS` attempts no more: the vehicle does not obey.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gcs.model import NS_PER_S, Effect, Notice

_FIRST_PAUSE_NS: Final = 5 * NS_PER_S
"""Pause after the second failure; each further one doubles it."""
_MAX_PAUSE_NS: Final = 60 * NS_PER_S
_SUPERSEDE_NS: Final = 10 * NS_PER_S
_MAX_CLEARINGS: Final = 5


@dataclass(slots=True)
class UploadRetry:
    """Failures since the last successful upload to one vehicle."""

    failures: int = 0
    """Failed uploads in a row."""
    paused_until_t_ns: int = 0
    """End of the pause after repeated failures."""
    first_began_t_ns: int | None = None
    """Begin of the first upload of a series in which each superseded the one before; None without one."""

    def may_supersede(self, t_ns: int) -> bool:
        """Return True if a newer route may replace an upload in progress."""
        return self.first_began_t_ns is None or t_ns - self.first_began_t_ns < _SUPERSEDE_NS

    def note_begin(self, t_ns: int) -> None:
        """Note that an upload begins, perhaps in place of another."""
        if self.first_began_t_ns is None:
            self.first_began_t_ns = t_ns

    def note_failure(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Note a failed upload; return a notice if the next one has to wait."""
        self.first_began_t_ns = None
        self.failures += 1
        if self.failures == 1:
            return []
        pause_ns = min(_FIRST_PAUSE_NS << min(self.failures - 2, 8), _MAX_PAUSE_NS)
        self.paused_until_t_ns = t_ns + pause_ns
        text = f"last {self.failures} mission uploads failed: next attempt in {pause_ns / NS_PER_S:.0f} s"
        return [Notice(t_ns, "alarm", text, vehicle)]


@dataclass(slots=True)
class ClearingRetry:
    """Failed clearings of one vehicle's inconsistent mission."""

    failures: int = 0
    """In a row."""
    next_t_ns: int = 0
    """Earliest time of the next one."""

    def is_due(self, t_ns: int) -> bool:
        """Return True if the mission may be cleared now."""
        return t_ns >= self.next_t_ns and self.failures < _MAX_CLEARINGS

    def note_failure(self, vehicle: int, t_ns: int, detail: str) -> list[Effect]:
        """Note a failed clearing; return an alarm."""
        self.failures += 1
        pause_ns = min(_FIRST_PAUSE_NS << (self.failures - 1), _MAX_PAUSE_NS)
        self.next_t_ns = t_ns + pause_ns
        if self.failures < _MAX_CLEARINGS:
            outlook = f"next attempt in {pause_ns / NS_PER_S:.0f} s"
        else:
            outlook = "no more attempts: it does not obey; keep it out of AUTO, or order it to resume"
        text = f"its inconsistent mission could not be cleared ({detail}): {outlook}"
        return [Notice(t_ns, "alarm", text, vehicle)]
