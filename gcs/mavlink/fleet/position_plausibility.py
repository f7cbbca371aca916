"""Whether a vehicle's position reports can be one vehicle's flight.

Each report was measured at a time since boot; between two of them a vehicle flies at most `max_speed_m_s`.

* ``speed``: a ground speed above that. Refused.
* ``jump``: a place out of reach from the last one that was believed. Refused, unless more reports go on
  from there for `CONFIRM_S` and none from the old place: then a receiver has found its place anew, or was
  led astray;
  it is believed and an alarm. `gcs.core.perception.position_integrity` tells which, where sensors look.
* ``frozen``: one and the same place while the ground speed adds up to `FROZEN_M` of way. Refused, and an
  alarm, until the place moves: a receiver that stands still, or reports that are played again.
* Reports that come in turns from two *voices*, which differ by their time since boot or by places out of
  each other's reach, are two vehicles with one system id behind one address: an alarm, until one voice is
  silent.

Pure; times in, words out. Thresholds have hysteresis: each alarm has its all-clear.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from gcs.model import NS_PER_S, Level

SLACK_M: Final = 100.0
"""What an estimator may correct at once, and what two samples of a noisy receiver may differ."""
CONFIRM_S: Final = 2.0
FROZEN_M: Final = 60.0
FROZEN_S: Final = 3.0
STANDING_M_S: Final = 1.0
"""A vehicle that is slower may stand."""
BOOTS_APART_S: Final = 5.0
_TURNS: Final = 6
_TURNS_WITHIN_NS: Final = 10 * NS_PER_S
_BOOT_WRAP_MS: Final = 1 << 32

News = tuple[Level, str]


@dataclass(frozen=True, slots=True)
class Report:
    """One position report in the local frame."""

    t_ns: int
    boot_ms: int
    east_m: float
    north_m: float
    speed_m_s: float


def _later_s(report: Report, than: Report) -> float:
    """How much later a report was measured; negative when it was earlier."""
    ahead = (report.boot_ms - than.boot_ms) % _BOOT_WRAP_MS
    return (ahead if ahead < _BOOT_WRAP_MS // 2 else ahead - _BOOT_WRAP_MS) * 1e-3


def _apart_m(one: Report, other: Report) -> float:
    return math.hypot(one.east_m - other.east_m, one.north_m - other.north_m)


class Motion:
    """One vehicle's reports, judged one by one in the order in which they were measured.

    Parameters
    ----------
    max_speed_m_s : float
        Over ground, with the strongest wind.
    """

    def __init__(self, max_speed_m_s: float) -> None:
        self.news: list[News] = []
        """What the last report made worth saying."""
        self._max_speed_m_s = max_speed_m_s
        self._last: Report | None = None
        self._leap: tuple[Report, Report, int] | None = None
        """First and last report from out of reach, and how many."""
        self._still: Report | None = None
        """Where it has stood since."""
        self._before: Report | None = None
        self._way_m = 0.0
        self._frozen = False

    def begin(self) -> None:
        """Forget where it was: it has rebooted, and may have been carried."""
        self._last = self._leap = self._still = self._before = None

    def resume(self, report: Report) -> None:
        """Go on from a report that was found in order elsewhere (`gcs.mavlink.fleet.fast_telemetry`)."""
        self._last = self._still = self._before = report
        self._leap, self._way_m = None, 0.0

    def judge(self, report: Report) -> str:
        """Return why a report is not believed; empty when it is."""
        self.news.clear()
        if report.speed_m_s > self._max_speed_m_s:
            return "speed"
        refusal = self._judge_place(report) or self._judge_way(report)
        if not refusal:
            self._last = report
        return refusal

    def _judge_place(self, report: Report) -> str:
        if self._last is None or is_in_reach(report, self._last, self._max_speed_m_s):
            self._leap = None
            return ""
        leap = self._leap
        if leap is None or not is_in_reach(report, leap[1], self._max_speed_m_s):
            self._leap = (report, report, 1)
            return "jump"
        first, _, count = self._leap = (leap[0], report, leap[2] + 1)
        if count < 3 or _later_s(report, first) < CONFIRM_S:
            return "jump"
        self.news.append(("alarm", f"its position jumped by {_apart_m(report, self._last):.0f} m"))
        self._leap = None
        return ""

    def _judge_way(self, report: Report) -> str:
        """Follow how far it says that it flew while it stands."""
        still, before = self._still, self._before
        self._before = report
        stands = report.speed_m_s < STANDING_M_S
        if still is None or before is None or stands or _apart_m(report, still) > 0.0:
            self._still, self._way_m = report, 0.0
            if self._frozen:
                self._frozen = False
                self.news.append(("info", "its position moves again"))
            return ""
        self._way_m += report.speed_m_s * max(0.0, _later_s(report, before))
        stood_s = _later_s(report, still)
        if not self._frozen and self._way_m >= FROZEN_M and stood_s >= FROZEN_S:
            self._frozen = True
            text = (
                f"reports one place for {stood_s:.0f} s at {report.speed_m_s:.0f} m/s: its position is frozen"
            )
            self.news.append(("alarm", text))
        return "frozen" if self._frozen else ""


def is_in_reach(report: Report, other: Report, max_speed_m_s: float) -> bool:
    """Whether one vehicle can have given both reports."""
    return _apart_m(report, other) <= max_speed_m_s * abs(_later_s(report, other)) + SLACK_M


class DuplicateIdDetector:
    """Who reports with a vehicle's system id from its address: one vehicle, or two.

    Parameters
    ----------
    max_speed_m_s : float
        As for `Motion`.
    """

    def __init__(self, max_speed_m_s: float) -> None:
        self.news: list[News] = []
        """What the last report made worth saying."""
        self.two = False
        self._max_speed_m_s = max_speed_m_s
        self._voices: list[Report] = []
        """Last report of each, the latest speaker first."""
        self._turns_t_ns: deque[int] = deque(maxlen=_TURNS)

    def take(self, report: Report) -> None:
        """Take any report with a place on Earth, believed or not."""
        self.news.clear()
        voices, t_ns = self._voices, report.t_ns
        if len(voices) > 1 and t_ns - voices[1].t_ns > _TURNS_WITHIN_NS:
            del voices[1]
        if not voices:
            voices.append(report)
        elif self._is_voice(report, voices[0]):
            voices[0] = report if _later_s(report, voices[0]) > 0.0 else voices[0]
        else:
            self._turns_t_ns.append(t_ns)
            known = len(voices) > 1 and self._is_voice(report, voices[1])
            if not known:
                self._turns_t_ns.clear()
            self._voices = [report, voices[0]]
        turns = self._turns_t_ns
        if not self.two and len(turns) == _TURNS and t_ns - turns[0] <= _TURNS_WITHIN_NS:
            self.two = True
            self.news.append(("alarm", f"two vehicles report with its system id, {self._how()}"))
        elif self.two and (not turns or t_ns - turns[-1] > _TURNS_WITHIN_NS):
            self.two = False
            self.news.append(("info", "one vehicle reports with its system id again"))

    @property
    def is_watching(self) -> bool:
        """Whether a second voice was heard just now, or its alarm stands."""
        return self.two or len(self._voices) > 1

    def resume(self, report: Report) -> None:
        """Go on from a report that was found in order elsewhere, when there is one voice."""
        self._voices[:1] = [report]

    def _is_voice(self, report: Report, voice: Report) -> bool:
        return self._boots_apart_s(report, voice) < BOOTS_APART_S and is_in_reach(
            report, voice, self._max_speed_m_s
        )

    def _boots_apart_s(self, one: Report, other: Report) -> float:
        return abs((one.t_ns - other.t_ns) / NS_PER_S - _later_s(one, other))

    def _how(self) -> str:
        one, other = self._voices
        boots_s = self._boots_apart_s(one, other)
        where = f"{_apart_m(one, other):.0f} m apart"
        return f"{where}, switched on {boots_s:.0f} s apart" if boots_s >= BOOTS_APART_S else where
