"""Operator notices of links and vehicles: bounded in number, and rate limited."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from gcs.mavlink.services.retry import ns
from gcs.model import Level, Notice

_MIN_REPEAT_NS: Final = ns(10.0)
_MAX_NOTICES: Final = 500


@dataclass(slots=True)
class NoticeQueue:
    """Notices until they are drained."""

    queued: list[Notice] = field(default_factory=list)
    last_t_ns: dict[tuple[str, int], int] = field(default_factory=dict)
    """Time of the last rate-limited notice, by kind and vehicle."""

    def drain(self) -> list[Notice]:
        """Return the notices since the last call."""
        notices, self.queued = self.queued, []
        return notices

    def add(self, level: Level, text: str, t_ns: int, vehicle: int | None = None) -> None:
        """Add a notice."""
        if len(self.queued) < _MAX_NOTICES:
            self.queued.append(Notice(t_ns, level, text, vehicle))

    def add_rate_limited(self, kind: str, vehicle: int, t_ns: int, level: Level, text: str) -> None:
        """Add a notice, unless one of its kind for the vehicle (0: none) came within 10 s."""
        last_t_ns = self.last_t_ns.get((kind, vehicle))
        if last_t_ns is None or t_ns - last_t_ns >= _MIN_REPEAT_NS:
            self.last_t_ns[kind, vehicle] = t_ns
            self.add(level, text, t_ns, vehicle or None)

    def add_statustext(self, text: str, severity: int, vehicle: int, t_ns: int) -> None:
        """Add a vehicle's STATUSTEXT with its MAV_SEVERITY."""
        level: Level = "alarm" if severity <= 2 else "warning" if severity <= 4 else "info"
        self.add(level, text, t_ns, vehicle)
