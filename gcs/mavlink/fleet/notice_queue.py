"""What the operator should know of the links and vehicles: bounded, and no news twice in a breath."""

from __future__ import annotations

from typing import Final

from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Level, Notice

_AGAIN_NS: Final = ns(10.0)
_MOST: Final = 500
_TEXTS_PER_S: Final = 5


class NoticeQueue:
    """Notices until somebody takes them."""

    def __init__(self) -> None:
        self.dropped = 0
        """Notices that were too many."""
        self._notices: list[Notice] = []
        self._told_t_ns: dict[tuple[str, int], int] = {}
        self._texts: dict[int, tuple[int, int]] = {}

    def taken(self) -> list[Notice]:
        """Return the notices since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def tell(self, level: Level, text: str, t_ns: int, vehicle: int | None = None) -> None:
        """Say it."""
        if len(self._notices) < _MOST:
            self._notices.append(Notice(t_ns, level, text, vehicle))
        else:
            self.dropped += 1

    def now_and_then(self, kind: str, vehicle: int, t_ns: int, level: Level, text: str) -> None:
        """Say it, unless something of its kind was said of the vehicle (0: of none) a moment ago."""
        told_t_ns = self._told_t_ns.get((kind, vehicle))
        if told_t_ns is None or t_ns - told_t_ns >= _AGAIN_NS:
            self._told_t_ns[kind, vehicle] = t_ns
            self.tell(level, text, t_ns, vehicle or None)

    def text(self, text: str, severity: int, vehicle: int, t_ns: int) -> None:
        """Pass on a vehicle's STATUSTEXT with its MAV_SEVERITY, a few a second per vehicle."""
        second = t_ns // NS_PER_S
        last, told = self._texts.get(vehicle, (second, 0))
        told = told + 1 if last == second else 1
        self._texts[vehicle] = (second, told)
        if told > _TEXTS_PER_S:
            self.dropped += 1
            return
        level: Level = "alarm" if severity <= 2 else "warning" if severity <= 4 else "info"
        self.tell(level, text, t_ns, vehicle)
