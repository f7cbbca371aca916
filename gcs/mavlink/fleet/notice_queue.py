"""Operator notices of links and vehicles: bounded in number, and rate limited."""

from __future__ import annotations

from typing import Final

from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Level, Notice

_MIN_REPEAT_NS: Final = ns(10.0)
_MAX_NOTICES: Final = 500
_MAX_STATUSTEXTS_PER_S: Final = 5


class NoticeQueue:
    """Notices until they are drained."""

    def __init__(self) -> None:
        self.dropped = 0
        """Notices beyond the bounds."""
        self._notices: list[Notice] = []
        self._last_t_ns: dict[tuple[str, int], int] = {}
        self._texts: dict[int, tuple[int, int]] = {}

    def drain(self) -> list[Notice]:
        """Return the notices since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def add(self, level: Level, text: str, t_ns: int, vehicle: int | None = None) -> None:
        """Add a notice."""
        if len(self._notices) < _MAX_NOTICES:
            self._notices.append(Notice(t_ns, level, text, vehicle))
        else:
            self.dropped += 1

    def add_rate_limited(self, kind: str, vehicle: int, t_ns: int, level: Level, text: str) -> None:
        """Add a notice, unless one of its kind for the vehicle (0: none) came within 10 s."""
        last_t_ns = self._last_t_ns.get((kind, vehicle))
        if last_t_ns is None or t_ns - last_t_ns >= _MIN_REPEAT_NS:
            self._last_t_ns[kind, vehicle] = t_ns
            self.add(level, text, t_ns, vehicle or None)

    def add_statustext(self, text: str, severity: int, vehicle: int, t_ns: int) -> None:
        """Add a vehicle's STATUSTEXT with its MAV_SEVERITY, up to a few a second per vehicle."""
        second = t_ns // NS_PER_S
        last, count = self._texts.get(vehicle, (second, 0))
        count = count + 1 if last == second else 1
        self._texts[vehicle] = (second, count)
        if count > _MAX_STATUSTEXTS_PER_S:
            self.dropped += 1
            return
        level: Level = "alarm" if severity <= 2 else "warning" if severity <= 4 else "info"
        self.add(level, text, t_ns, vehicle)
