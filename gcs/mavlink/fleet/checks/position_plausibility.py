"""Checks of a vehicle's positions against each other: too fast, jumps, frozen, two senders with one id.

Reports carry the time since boot; between two of them a vehicle flies at most `max_speed_m_s`.

* ``speed``: greater ground speed. Refused.
* ``jump``: out of reach of the last accepted position. Refused, unless reports continue from there for
  `CONFIRM_S` and none from the old position: then it is accepted, with an alarm. The receiver has recovered,
  or is spoofed; `gcs.core.perception.position_integrity` decides, where sensors cover it.
* ``frozen``: the same position while the ground speed adds up to `FROZEN_M`. Refused, with an alarm, until
  the position changes: a receiver that stands still, or replayed reports.
* Two *sources* whose reports alternate, with different boot times or positions out of each other's reach, are
  two vehicles with one system id behind one address. Alarm until one source is no longer heard.

Pure. Thresholds have hysteresis: each alarm has its all-clear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from gcs.model import NS_PER_S, NoticeCode, Notify

POSITION_SLACK_M: Final = 100.0
"""Allowance for a correction by the estimator, or for noise between two samples."""
CONFIRM_S: Final = 2.0
FROZEN_M: Final = 60.0
FROZEN_S: Final = 3.0
MAX_STANDING_M_S: Final = 1.0
"""Below this ground speed a vehicle may stand still."""
MIN_BOOT_DIFFERENCE_S: Final = 5.0
_MIN_SWITCHES: Final = 6
_SWITCH_WINDOW_NS: Final = 10 * NS_PER_S
_BOOT_WRAP_MS: Final = 1 << 32


@dataclass(frozen=True, slots=True)
class Report:
    """One position report in the local frame."""

    t_ns: int
    boot_ms: int
    east_m: float
    north_m: float
    speed_m_s: float


def _elapsed_s(report: Report, than: Report) -> float:
    """Return how much later a report was measured; negative if earlier."""
    ahead = (report.boot_ms - than.boot_ms) % _BOOT_WRAP_MS
    return (ahead if ahead < _BOOT_WRAP_MS // 2 else ahead - _BOOT_WRAP_MS) * 1e-3


def _distance_m(one: Report, other: Report) -> float:
    return math.hypot(one.east_m - other.east_m, one.north_m - other.north_m)


@dataclass(slots=True)
class MotionCheck:
    """Checks the reports of one vehicle, in the order of their measurement."""

    last: Report | None = None
    """Last accepted report."""
    jump: tuple[Report, Report, int] | None = None
    """First and last report from out of reach, and their number."""
    still_report: Report | None = None
    """First report at the present position."""
    before: Report | None = None
    """Last report, accepted or frozen."""
    flown_m: float = 0.0
    """Distance flown by the reported speed since the first report at the present position."""
    is_frozen: bool = False

    def begin(self) -> None:
        """Forget the position: the vehicle has rebooted and may have been carried."""
        self.last = self.jump = self.still_report = self.before = None

    def resume(self, report: Report) -> None:
        """Continue from a report that was accepted elsewhere (`gcs.mavlink.fleet.fast_telemetry`)."""
        self.last = self.still_report = self.before = report
        self.jump = None
        self.flown_m = 0.0

    def check_report(self, report: Report, max_speed_m_s: float, notify: Notify) -> str:
        """Return why a report is refused; empty if it is accepted.

        Parameters
        ----------
        max_speed_m_s : float
            Over ground, with the strongest wind.
        """
        if report.speed_m_s > max_speed_m_s:
            return "speed"
        refusal = self._check_jump(report, max_speed_m_s, notify) or self._check_frozen(report, notify)
        if not refusal:
            self.last = report
        return refusal

    def _check_jump(self, report: Report, max_speed_m_s: float, notify: Notify) -> str:
        if self.last is None or is_in_reach(report, self.last, max_speed_m_s):
            self.jump = None
            return ""
        jump = self.jump
        if jump is None or not is_in_reach(report, jump[1], max_speed_m_s):
            self.jump = (report, report, 1)
            return "jump"
        self.jump = (jump[0], report, jump[2] + 1)
        if self.jump[2] < 3 or _elapsed_s(report, self.jump[0]) < CONFIRM_S:
            return "jump"
        notify(NoticeCode.POSITION_JUMP, distance_m=_distance_m(report, self.last))
        self.jump = None
        return ""

    def _check_frozen(self, report: Report, notify: Notify) -> str:
        """Compare the distance flown by the reported speed with the reported position."""
        still = self.still_report
        before = self.before
        self.before = report
        stands = report.speed_m_s < MAX_STANDING_M_S
        if still is None or before is None or stands or _distance_m(report, still) > 0.0:
            self.still_report = report
            self.flown_m = 0.0
            if self.is_frozen:
                self.is_frozen = False
                notify(NoticeCode.POSITION_MOVES)
            return ""
        self.flown_m += report.speed_m_s * max(0.0, _elapsed_s(report, before))
        stood_s = _elapsed_s(report, still)
        if not self.is_frozen and self.flown_m >= FROZEN_M and stood_s >= FROZEN_S:
            self.is_frozen = True
            notify(NoticeCode.POSITION_FROZEN, stood_s=stood_s, speed_m_s=report.speed_m_s)
        return "frozen" if self.is_frozen else ""


def is_in_reach(report: Report, other: Report, max_speed_m_s: float) -> bool:
    """Return True if one vehicle can have sent both reports."""
    return _distance_m(report, other) <= max_speed_m_s * abs(_elapsed_s(report, other)) + POSITION_SLACK_M


@dataclass(slots=True)
class DuplicateIdDetector:
    """Detects two vehicles that report with one system id from one address."""

    has_duplicate: bool = False
    sources: list[Report] = field(default_factory=list)
    """Last report of each source, the latest first."""
    switches_t_ns: list[int] = field(default_factory=list)
    """Times of the last changes between two sources."""

    def add_report(self, report: Report, max_speed_m_s: float, notify: Notify) -> None:
        """Add a report with a possible position, accepted or not; parameters as for `MotionCheck`."""
        sources = self.sources
        t_ns = report.t_ns
        if len(sources) > 1 and t_ns - sources[1].t_ns > _SWITCH_WINDOW_NS:
            del sources[1]
        if not sources:
            sources.append(report)
        elif _is_same_source(report, sources[0], max_speed_m_s):
            sources[0] = report if _elapsed_s(report, sources[0]) > 0.0 else sources[0]
        else:
            known = len(sources) > 1 and _is_same_source(report, sources[1], max_speed_m_s)
            self.switches_t_ns = [*self.switches_t_ns, t_ns][-_MIN_SWITCHES:] if known else []
            self.sources = [report, sources[0]]
        switches = self.switches_t_ns
        if (
            not self.has_duplicate
            and len(switches) == _MIN_SWITCHES
            and t_ns - switches[0] <= _SWITCH_WINDOW_NS
        ):
            self.has_duplicate = True
            notify(NoticeCode.DUPLICATE_ID, **_difference(*self.sources))
        elif self.has_duplicate and (not switches or t_ns - switches[-1] > _SWITCH_WINDOW_NS):
            self.has_duplicate = False
            notify(NoticeCode.DUPLICATE_ID_OVER)

    @property
    def is_watching(self) -> bool:
        """True if a second source was heard recently, or its alarm is active."""
        return self.has_duplicate or len(self.sources) > 1

    def resume(self, report: Report) -> None:
        """Continue from a report that was accepted elsewhere, if there is one source."""
        self.sources[:1] = [report]


def _is_same_source(report: Report, source: Report, max_speed_m_s: float) -> bool:
    return _boot_difference_s(report, source) < MIN_BOOT_DIFFERENCE_S and is_in_reach(
        report, source, max_speed_m_s
    )


def _boot_difference_s(one: Report, other: Report) -> float:
    return abs((one.t_ns - other.t_ns) / NS_PER_S - _elapsed_s(one, other))


def _difference(one: Report, other: Report) -> dict[str, float]:
    boots_s = _boot_difference_s(one, other)
    distance = {"distance_m": _distance_m(one, other)}
    return distance | {"boots_s": boots_s} if boots_s >= MIN_BOOT_DIFFERENCE_S else distance
