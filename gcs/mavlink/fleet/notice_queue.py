"""Operator notices of links and vehicles: bounded in number, and rate limited.

A condition that begins all the time (arming, mode, position) is reported `MAX_REPEATS` times in ten seconds;
then a summary counts the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Notice, NoticeCode
from gcs.model.notices import MORE_COUNT, MORE_S, ConditionKey

_MIN_REPEAT_NS: Final = ns(10.0)
_MAX_NOTICES: Final = 500
MAX_REPEATS: Final = 5
_MAX_CONDITIONS: Final = 4096


@dataclass(slots=True)
class RepeatedNotice:
    """Notices of one condition."""

    began_t_ns: int
    count: int = 0
    last: Notice | None = None
    """Last notice that was not passed on."""


@dataclass(slots=True)
class RepeatLimit:
    """Limit of repeated notices: `MAX_REPEATS` in ten seconds, then a summary."""

    conditions: dict[ConditionKey, RepeatedNotice] = field(default_factory=dict)

    def admit(self, notice: Notice) -> bool:
        """Count a notice; return True if it is passed on."""
        key = notice.key
        repeated = self.conditions.get(key)
        if repeated is None:
            if len(self.conditions) >= _MAX_CONDITIONS:
                return True
            repeated = self.conditions[key] = RepeatedNotice(notice.t_ns)
        repeated.count += 1
        if repeated.count <= MAX_REPEATS:
            return True
        repeated.last = notice
        return False

    def summaries(self, t_ns: int) -> list[Notice]:
        """Return the summaries that are due; forget what was not repeated."""
        due = {
            key: repeated
            for key, repeated in self.conditions.items()
            if t_ns - repeated.began_t_ns >= _MIN_REPEAT_NS
        }
        notices = []
        for key, repeated in due.items():
            if repeated.last is None:
                del self.conditions[key]
                continue
            more = {
                MORE_COUNT: repeated.count - MAX_REPEATS,
                MORE_S: (t_ns - repeated.began_t_ns) / NS_PER_S,
            }
            parameters = {**repeated.last.parameters, **more}
            notices.append(replace(repeated.last, t_ns=t_ns, parameters=parameters))
            self.conditions[key] = RepeatedNotice(t_ns, MAX_REPEATS)
        return notices


@dataclass(slots=True)
class NoticeQueue:
    """Notices until they are drained."""

    queued: list[Notice] = field(default_factory=list)
    last_t_ns: dict[ConditionKey, int] = field(default_factory=dict)
    """Time of the last rate-limited notice of each condition."""

    def drain(self) -> list[Notice]:
        """Return the notices since the last call."""
        notices = self.queued
        self.queued = []
        return notices

    def add(self, notice: Notice) -> None:
        """Add a notice, unless there are too many."""
        if len(self.queued) < _MAX_NOTICES:
            self.queued.append(notice)

    def add_rate_limited(self, notice: Notice) -> None:
        """Add a notice, unless one of its condition came within 10 s."""
        last_t_ns = self.last_t_ns.get(notice.key)
        if last_t_ns is None or notice.t_ns - last_t_ns >= _MIN_REPEAT_NS:
            self.last_t_ns[notice.key] = notice.t_ns
            self.add(notice)

    def add_statustext(self, text: str, severity: int, vehicle: int, t_ns: int) -> None:
        """Add a vehicle's STATUSTEXT with its MAV_SEVERITY."""
        code = NoticeCode.AUTOPILOT_INFO
        if severity <= 2:
            code = NoticeCode.AUTOPILOT_ALARM
        elif severity <= 4:
            code = NoticeCode.AUTOPILOT_WARNING
        self.add(Notice(t_ns, code, vehicle, {"said": text}))
