"""Operator notices of links and vehicles: bounded in number, and rate limited.

A vehicle that changes something all the time (arming, mode, position) is reported `MAX_REPEATS` times in ten
seconds; then a summary counts the rest. Figures in a text do not make it another notice.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Level, Notice

_MIN_REPEAT_NS: Final = ns(10.0)
_MAX_NOTICES: Final = 500
MAX_REPEATS: Final = 5
_MAX_KINDS: Final = 4096


@dataclass(slots=True)
class RepeatedNotice:
    """Notices of one kind about one vehicle."""

    began_t_ns: int
    count: int = 0
    last: Notice | None = None
    """Last notice that was not passed on."""


@dataclass(slots=True)
class RepeatLimit:
    """Limit of equal notices: `MAX_REPEATS` in ten seconds, then a summary."""

    kinds: dict[tuple[str, int], RepeatedNotice] = field(default_factory=dict)
    """By text and vehicle (0: none)."""

    def admit(self, notice: Notice, *, with_figures: bool) -> bool:
        """Count a notice; return True if it is passed on. Without figures, texts are equal despite them."""
        text = notice.text if with_figures else "".join(one for one in notice.text if not one.isdigit())
        key, t_ns = (text, notice.vehicle or 0), notice.t_ns
        kind = self.kinds.get(key)
        if kind is None:
            if len(self.kinds) >= _MAX_KINDS:
                return True
            kind = self.kinds[key] = RepeatedNotice(t_ns)
        kind.count += 1
        if kind.count <= MAX_REPEATS:
            return True
        kind.last = notice
        return False

    def summaries(self, t_ns: int) -> list[Notice]:
        """Return the summaries that are due; forget what was not repeated."""
        due = {key: kind for key, kind in self.kinds.items() if t_ns - kind.began_t_ns >= _MIN_REPEAT_NS}
        notices = []
        for key, kind in due.items():
            if kind.last is None:
                del self.kinds[key]
                continue
            seconds = (t_ns - kind.began_t_ns) / NS_PER_S
            text = f"{kind.last.text} ({kind.count - MAX_REPEATS} more such notices in {seconds:.0f} s)"
            notices.append(Notice(t_ns, kind.last.level, text, kind.last.vehicle))
            self.kinds[key] = RepeatedNotice(t_ns, MAX_REPEATS)
        return notices


@dataclass(slots=True)
class NoticeQueue:
    """Notices until they are drained."""

    queued: list[Notice] = field(default_factory=list)
    last_t_ns: dict[tuple[str, int], int] = field(default_factory=dict)
    """Time of the last rate-limited notice, by kind and vehicle."""
    repeats: RepeatLimit = field(default_factory=RepeatLimit)

    def drain(self) -> list[Notice]:
        """Return the notices since the last call."""
        notices, self.queued = self.queued, []
        return notices

    def summarise(self, t_ns: int) -> None:
        """Add the summaries of repeated notices that are due."""
        self.queued += self.repeats.summaries(t_ns)

    def add(self, level: Level, text: str, t_ns: int, vehicle: int | None = None) -> None:
        """Add a notice, unless it comes all the time."""
        notice = Notice(t_ns, level, text, vehicle)
        if len(self.queued) < _MAX_NOTICES and self.repeats.admit(notice, with_figures=False):
            self.queued.append(notice)

    def add_rate_limited(self, kind: str, vehicle: int, t_ns: int, level: Level, text: str) -> None:
        """Add a notice, unless one of its kind for the vehicle (0: none) came within 10 s."""
        last_t_ns = self.last_t_ns.get((kind, vehicle))
        if last_t_ns is None or t_ns - last_t_ns >= _MIN_REPEAT_NS:
            self.last_t_ns[kind, vehicle] = t_ns
            self.add(level, text, t_ns, vehicle or None)

    def add_statustext(self, text: str, severity: int, vehicle: int, t_ns: int) -> None:
        """Add a vehicle's STATUSTEXT with its MAV_SEVERITY."""
        level: Level = "alarm" if severity <= 2 else "warning" if severity <= 4 else "info"
        if len(self.queued) < _MAX_NOTICES:
            self.queued.append(Notice(t_ns, level, text, vehicle))
