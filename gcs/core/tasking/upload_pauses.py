"""Pauses between failed uploads, clearings and rejections of one vehicle.

After repeated failures uploads pause, so that a vehicle that refuses its missions does not block its link.
The first failure causes no pause.

A newer route supersedes an upload in progress for `_SUPERSEDE_NS` only, counted from the first upload of such
a series. After that the upload may finish. On a lossy link an upload takes longer than the plan takes to
change, and a vehicle whose uploads were all superseded would circle for minutes.

An inconsistent mission that cannot be cleared is cleared again after growing pauses, and after
`_MAX_CLEARINGS` attempts no more: the vehicle does not obey.

So are missions that a vehicle's navigator rejects (`gcs.core.tasking.rejections`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from gcs.model import NS_PER_S, Effect, Notice, NoticeCode, Parameter

_FIRST_PAUSE_NS: Final = 5 * NS_PER_S
"""Pause after the second failure; each further one doubles it."""
_MAX_PAUSE_NS: Final = 60 * NS_PER_S
_SUPERSEDE_NS: Final = 10 * NS_PER_S
_MAX_CLEARINGS: Final = 5
_FIRST_REJECTION_NS: Final = 10 * NS_PER_S
"""Pause after the first rejection; each further one doubles it."""
_MAX_REJECTIONS: Final = 6
_FIRST_CHANGE_NS: Final = NS_PER_S
"""Least time from a rejection to an attempt after a changed parameter; each such attempt doubles it."""


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

    def note_rejection(self) -> None:
        """Note that an upload has ended with a rejected mission; its pauses are those of `RejectionRetry`."""
        self.first_began_t_ns = None

    def note_failure(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Note a failed upload; return a notice if the next one has to wait."""
        self.first_began_t_ns = None
        self.failures += 1
        if self.failures == 1:
            return []
        pause_ns = min(_FIRST_PAUSE_NS << min(self.failures - 2, 8), _MAX_PAUSE_NS)
        self.paused_until_t_ns = t_ns + pause_ns
        about: dict[str, Parameter] = {"failures": self.failures, "pause_s": pause_ns / NS_PER_S}
        return [Notice(t_ns, NoticeCode.UPLOADS_FAILED, vehicle, about)]


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
        if self.failures >= _MAX_CLEARINGS:
            return [Notice(t_ns, NoticeCode.CLEARING_GIVEN_UP, vehicle, {"detail": detail})]
        about: dict[str, Parameter] = {"detail": detail, "pause_s": pause_ns / NS_PER_S}
        return [Notice(t_ns, NoticeCode.CLEARING_FAILED, vehicle, about)]


@dataclass(slots=True)
class RejectionRetry:
    """Missions that one vehicle's navigator has rejected since it last accepted one."""

    count: int = 0
    cause: str = ""
    """Cause of the last one in the vehicle's words; empty without one."""
    rejected_t_ns: int = 0
    """Time of the last one."""
    began_t_ns: int = 0
    """Begin of its upload."""
    next_t_ns: int | None = None
    """Time of the next attempt without a change; None if there is none."""
    changed_t_ns: int = -1
    """Time at which a parameter last changed, or the vehicle rebooted; -1 before."""
    changes: int = 0
    """Attempts after a change."""
    texts: list[tuple[int, str]] = field(default_factory=list)
    """Time and text of its last messages that may name a cause, the oldest first."""

    @property
    def pause_ns(self) -> int:
        """Pause after this number of rejections."""
        return _FIRST_REJECTION_NS << (self.count - 1)

    def note_rejection(self, t_ns: int, began_t_ns: int) -> None:
        """Note a rejection, and when the upload of the mission began."""
        self.count += 1
        self.rejected_t_ns = t_ns
        self.began_t_ns = began_t_ns
        self.next_t_ns = t_ns + self.pause_ns if self.count < _MAX_REJECTIONS else None

    def note_change(self, t_ns: int) -> None:
        """Note that a parameter of the vehicle has changed."""
        self.changed_t_ns = t_ns

    @property
    def has_changed(self) -> bool:
        """True if a parameter has changed since the upload of the rejected mission began."""
        return self.changed_t_ns > self.began_t_ns

    def is_due(self, t_ns: int) -> bool:
        """Return True if the next attempt may begin."""
        if self.has_changed:
            pause_ns = min(_FIRST_CHANGE_NS << min(self.changes, 8), _MAX_PAUSE_NS)
            return t_ns >= self.rejected_t_ns + pause_ns
        return self.next_t_ns is not None and t_ns >= self.next_t_ns

    def note_attempt(self) -> None:
        """Note that the next attempt may begin."""
        self.changes += self.has_changed
