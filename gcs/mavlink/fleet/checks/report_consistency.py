"""Checks of a vehicle's reports against each other, once a second: velocity, height, delay, number of frames.

Velocity and height are checked while the vehicle is armed: before its estimator has an origin, they mean
nothing. The checks refuse nothing. They name a vehicle whose reports contradict each other, so that an
operator does not trust them. Position reports that are refused are in `position_plausibility`.

* Velocity: the distance between two positions is the mean velocity times the time between them, by the
  vehicle's own clock. `_MIN_SAMPLES` wrong samples in a row are an alarm.
* Height: a jump, or a height above home that no mission has.
* Delay: the time of the vehicle's boot, by our clock when its positions arrive, is the same while they take
  equally long. Where a radio gets more than it can carry, they wait in it, and that time becomes later.
* Frames: more than `_MAX_FRAMES_PER_S`.

Pure. Each state that lasts has its all-clear.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from gcs.model import NS_PER_S, NoticeCode, Notify

_MIN_INTERVAL_S: Final = 0.9
_MAX_INTERVAL_S: Final = 2.5
"""Between two samples; over a longer time a vehicle may turn too far."""
_MIN_SAMPLES: Final = 5
_VELOCITY_SLACK_M: Final = 10.0
_VELOCITY_SLACK: Final = 0.4
"""Fraction of the distance."""
_HEIGHT_JUMP_M: Final = 100.0
_MAX_CLIMB_M_S: Final = 60.0
_HEIGHTS_M: Final = (-300.0, 3000.0)
"""Possible heights above home."""
_MAX_FRAMES_PER_S: Final = 1000.0
_LATE_S: Final = 1.5
"""Mean delay that is told; the warning ends at half of it."""
_DELAY_GAIN: Final = 0.1
_CLOCK_DRIFT: Final = 1e-3
"""Part by which a vehicle's clock may be slower than ours; autopilots' are by 1e-4 at most."""
_BOOT_WRAP_MS: Final = 1 << 32


@dataclass(frozen=True, slots=True)
class Sample:
    """Newest accepted position of a vehicle, and its number of frames."""

    t_ns: int
    boot_ms: int
    boot_t_ns: int
    """Time of its boot as the newest position tells it when it arrives."""
    east_m: float
    north_m: float
    alt_msl_m: float
    v_east_m_s: float
    v_north_m_s: float
    frames: int
    is_armed: bool


@dataclass(slots=True)
class Condition:
    """State that is raised after several bad samples in a row, and ends after as many good ones."""

    is_raised: bool = False
    samples: int = 0
    """Samples in a row that differ from the state."""

    def add(self, *, is_bad: bool, needed: int) -> bool:
        """Add a sample; return True if the state changes."""
        self.samples = self.samples + 1 if is_bad is not self.is_raised else 0
        if self.samples < needed:
            return False
        self.is_raised = is_bad
        self.samples = 0
        return True


@dataclass(slots=True)
class ReportDelay:
    """By how much later the reports of a vehicle arrive than the fastest ones did."""

    earliest_ns: int | None = None
    """Earliest time of its boot by its reports, moved on with the drift of its clock; None after a boot."""
    mean_s: float = 0.0
    is_raised: bool = False

    def add_sample(self, boot_t_ns: int, elapsed_s: float) -> bool:
        """Add a sample; return True if the state changes."""
        if self.earliest_ns is None:
            self.earliest_ns = boot_t_ns
        elif not self.is_raised:
            self.earliest_ns += round(_CLOCK_DRIFT * elapsed_s * NS_PER_S)
        self.earliest_ns = min(self.earliest_ns, boot_t_ns)
        self.mean_s += _DELAY_GAIN * ((boot_t_ns - self.earliest_ns) / NS_PER_S - self.mean_s)
        if self.mean_s > _LATE_S if not self.is_raised else self.mean_s < 0.5 * _LATE_S:
            self.is_raised = not self.is_raised
            return True
        return False


@dataclass(slots=True)
class ReportConsistency:
    """Checks of one vehicle."""

    last: Sample | None = None
    velocity: Condition = field(default_factory=Condition)
    height: Condition = field(default_factory=Condition)
    delay: ReportDelay = field(default_factory=ReportDelay)
    frames: Condition = field(default_factory=Condition)

    def is_due(self, t_ns: int) -> bool:
        """Return True if the next sample is due."""
        return self.last is None or t_ns - self.last.t_ns >= _MIN_INTERVAL_S * NS_PER_S

    def add_sample(self, sample: Sample, home_alt_msl_m: float | None, notify: Notify) -> None:
        """Compare a sample with the one before."""
        last = self.last
        if last is None:
            self.last = sample
            return
        elapsed_ms = (sample.boot_ms - last.boot_ms) % _BOOT_WRAP_MS
        elapsed_s = elapsed_ms * 1e-3 if elapsed_ms < _BOOT_WRAP_MS // 2 else 0.0
        if 0.0 < elapsed_s < _MIN_INTERVAL_S:
            return
        self.last = sample
        if elapsed_ms >= _BOOT_WRAP_MS // 2:
            self._restart_delay(notify)
        if elapsed_s == 0.0:
            return
        self._check_delay(sample, elapsed_s, notify)
        if elapsed_s > _MAX_INTERVAL_S:
            return
        self._check_velocity(last, sample, elapsed_s, notify)
        self._check_height(last, sample, elapsed_s, home_alt_msl_m, notify)
        self._check_frames(last, sample, notify)

    def _check_velocity(self, last: Sample, now: Sample, elapsed_s: float, notify: Notify) -> None:
        east_m = now.east_m - last.east_m
        north_m = now.north_m - last.north_m
        v_east_m_s = 0.5 * (last.v_east_m_s + now.v_east_m_s)
        v_north_m_s = 0.5 * (last.v_north_m_s + now.v_north_m_s)
        error_m = math.hypot(east_m - v_east_m_s * elapsed_s, north_m - v_north_m_s * elapsed_s)
        moved_m = math.hypot(east_m, north_m)
        speed_m_s = math.hypot(v_east_m_s, v_north_m_s)
        slack_m = max(_VELOCITY_SLACK_M, _VELOCITY_SLACK * max(moved_m, speed_m_s * elapsed_s))
        if not self.velocity.add(is_bad=now.is_armed and error_m > slack_m, needed=_MIN_SAMPLES):
            return
        if self.velocity.is_raised:
            notify(NoticeCode.VELOCITY_WRONG, speed_m_s=speed_m_s, error_m_s=error_m / elapsed_s)
        else:
            notify(NoticeCode.VELOCITY_RIGHT)

    def _check_height(
        self, last: Sample, now: Sample, elapsed_s: float, home_alt_msl_m: float | None, notify: Notify
    ) -> None:
        jump_m = now.alt_msl_m - last.alt_msl_m
        if last.is_armed and abs(jump_m) > _HEIGHT_JUMP_M + _MAX_CLIMB_M_S * elapsed_s:
            notify(NoticeCode.HEIGHT_JUMP, jump_m=jump_m)
        if home_alt_msl_m is None:
            return
        height_m = now.alt_msl_m - home_alt_msl_m
        low_m, high_m = _HEIGHTS_M
        is_bad = now.is_armed and not low_m <= height_m <= high_m
        if not self.height.add(is_bad=is_bad, needed=2):
            return
        if self.height.is_raised:
            notify(NoticeCode.HEIGHT_WRONG, height_m=height_m)
        else:
            notify(NoticeCode.HEIGHT_RIGHT)

    def _check_delay(self, now: Sample, elapsed_s: float, notify: Notify) -> None:
        if not self.delay.add_sample(now.boot_t_ns, elapsed_s):
            return
        if self.delay.is_raised:
            notify(NoticeCode.REPORTS_LATE, delay_s=self.delay.mean_s)
        else:
            notify(NoticeCode.REPORTS_IN_TIME)

    def _restart_delay(self, notify: Notify) -> None:
        """Begin anew after a boot, which ends a warning."""
        if self.delay.is_raised:
            notify(NoticeCode.REPORTS_IN_TIME)
        self.delay = ReportDelay()

    def _check_frames(self, last: Sample, now: Sample, notify: Notify) -> None:
        elapsed_s = max((now.t_ns - last.t_ns) / NS_PER_S, _MIN_INTERVAL_S)
        rate_hz = (now.frames - last.frames) / elapsed_s
        if not self.frames.add(is_bad=rate_hz > _MAX_FRAMES_PER_S, needed=_MIN_SAMPLES):
            return
        if self.frames.is_raised:
            notify(NoticeCode.FRAME_RATE_HIGH, rate_hz=rate_hz)
        else:
            notify(NoticeCode.FRAME_RATE_NORMAL)
