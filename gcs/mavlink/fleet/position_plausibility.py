"""Checks of a vehicle's position reports against each other.

Reports carry the time since boot; between two of them a vehicle flies at most `max_speed_m_s`.

* ``speed``: greater ground speed. Refused.
* ``jump``: out of reach of the last accepted position. Refused, unless reports continue from there for
  `CONFIRM_S` and none from the old position: then it is accepted, with an alarm. The receiver has recovered,
  or is spoofed; `gcs.core.perception.position_integrity` decides, where sensors cover it.
* ``frozen``: the same position while the ground speed adds up to `FROZEN_M`. Refused, with an alarm, until
  the position changes: a receiver that stands still, or replayed reports.
* Two *sources* whose reports alternate, with different boot times or positions out of each other's reach, are
  two vehicles with one system id behind one address. Alarm until one source is silent.

Pure. Thresholds have hysteresis: each alarm has its all-clear.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from gcs.model import NS_PER_S, Level

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

LeveledText = tuple[Level, str]


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


class MotionCheck:
    """Checks the reports of one vehicle, in the order of their measurement.

    Parameters
    ----------
    max_speed_m_s : float
        Over ground, with the strongest wind.
    """

    def __init__(self, max_speed_m_s: float) -> None:
        self.notices: list[LeveledText] = []
        """Notices caused by the last report."""
        self._max_speed_m_s = max_speed_m_s
        self._last: Report | None = None
        self._jump: tuple[Report, Report, int] | None = None
        """First and last report from out of reach, and their number."""
        self._still_report: Report | None = None
        """First report at the present position."""
        self._before: Report | None = None
        self._flown_m = 0.0
        self._frozen = False

    def begin(self) -> None:
        """Forget the position: the vehicle has rebooted and may have been carried."""
        self._last = self._jump = self._still_report = self._before = None

    def resume(self, report: Report) -> None:
        """Continue from a report that was accepted elsewhere (`gcs.mavlink.fleet.fast_telemetry`)."""
        self._last = self._still_report = self._before = report
        self._jump, self._flown_m = None, 0.0

    def check_report(self, report: Report) -> str:
        """Return why a report is refused; empty if it is accepted."""
        self.notices.clear()
        if report.speed_m_s > self._max_speed_m_s:
            return "speed"
        refusal = self._check_jump(report) or self._check_frozen(report)
        if not refusal:
            self._last = report
        return refusal

    def _check_jump(self, report: Report) -> str:
        if self._last is None or is_in_reach(report, self._last, self._max_speed_m_s):
            self._jump = None
            return ""
        jump = self._jump
        if jump is None or not is_in_reach(report, jump[1], self._max_speed_m_s):
            self._jump = (report, report, 1)
            return "jump"
        first, _, count = self._jump = (jump[0], report, jump[2] + 1)
        if count < 3 or _elapsed_s(report, first) < CONFIRM_S:
            return "jump"
        self.notices.append(("alarm", f"its position jumped by {_distance_m(report, self._last):.0f} m"))
        self._jump = None
        return ""

    def _check_frozen(self, report: Report) -> str:
        """Compare the distance flown by the reported speed with the reported position."""
        still, before = self._still_report, self._before
        self._before = report
        stands = report.speed_m_s < MAX_STANDING_M_S
        if still is None or before is None or stands or _distance_m(report, still) > 0.0:
            self._still_report, self._flown_m = report, 0.0
            if self._frozen:
                self._frozen = False
                self.notices.append(("info", "its position moves again"))
            return ""
        self._flown_m += report.speed_m_s * max(0.0, _elapsed_s(report, before))
        stood_s = _elapsed_s(report, still)
        if not self._frozen and self._flown_m >= FROZEN_M and stood_s >= FROZEN_S:
            self._frozen = True
            text = (
                f"reports one place for {stood_s:.0f} s at {report.speed_m_s:.0f} m/s: its position is frozen"
            )
            self.notices.append(("alarm", text))
        return "frozen" if self._frozen else ""


def is_in_reach(report: Report, other: Report, max_speed_m_s: float) -> bool:
    """Return True if one vehicle can have sent both reports."""
    return _distance_m(report, other) <= max_speed_m_s * abs(_elapsed_s(report, other)) + POSITION_SLACK_M


class DuplicateIdDetector:
    """Detects two vehicles that report with one system id from one address.

    Parameters
    ----------
    max_speed_m_s : float
        As for `MotionCheck`.
    """

    def __init__(self, max_speed_m_s: float) -> None:
        self.notices: list[LeveledText] = []
        """Notices caused by the last report."""
        self.has_duplicate = False
        self._max_speed_m_s = max_speed_m_s
        self._sources: list[Report] = []
        """Last report of each source, the latest first."""
        self._switches_t_ns: deque[int] = deque(maxlen=_MIN_SWITCHES)

    def add_report(self, report: Report) -> None:
        """Add a report with a possible position, accepted or not."""
        self.notices.clear()
        sources, t_ns = self._sources, report.t_ns
        if len(sources) > 1 and t_ns - sources[1].t_ns > _SWITCH_WINDOW_NS:
            del sources[1]
        if not sources:
            sources.append(report)
        elif self._is_same_source(report, sources[0]):
            sources[0] = report if _elapsed_s(report, sources[0]) > 0.0 else sources[0]
        else:
            self._switches_t_ns.append(t_ns)
            known = len(sources) > 1 and self._is_same_source(report, sources[1])
            if not known:
                self._switches_t_ns.clear()
            self._sources = [report, sources[0]]
        switches = self._switches_t_ns
        if (
            not self.has_duplicate
            and len(switches) == _MIN_SWITCHES
            and t_ns - switches[0] <= _SWITCH_WINDOW_NS
        ):
            self.has_duplicate = True
            self.notices.append(("alarm", f"two vehicles report with its system id, {self._describe()}"))
        elif self.has_duplicate and (not switches or t_ns - switches[-1] > _SWITCH_WINDOW_NS):
            self.has_duplicate = False
            self.notices.append(("info", "one vehicle reports with its system id again"))

    @property
    def is_watching(self) -> bool:
        """True if a second source was heard recently, or its alarm is active."""
        return self.has_duplicate or len(self._sources) > 1

    def resume(self, report: Report) -> None:
        """Continue from a report that was accepted elsewhere, if there is one source."""
        self._sources[:1] = [report]

    def _is_same_source(self, report: Report, source: Report) -> bool:
        return self._boot_difference_s(report, source) < MIN_BOOT_DIFFERENCE_S and is_in_reach(
            report, source, self._max_speed_m_s
        )

    def _boot_difference_s(self, one: Report, other: Report) -> float:
        return abs((one.t_ns - other.t_ns) / NS_PER_S - _elapsed_s(one, other))

    def _describe(self) -> str:
        one, other = self._sources
        boots_s = self._boot_difference_s(one, other)
        where = f"{_distance_m(one, other):.0f} m apart"
        return f"{where}, switched on {boots_s:.0f} s apart" if boots_s >= MIN_BOOT_DIFFERENCE_S else where
