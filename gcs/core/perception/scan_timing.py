"""The times that sensors give their scans: late ones are worked, shifted ones corrected, old ones refused.

A scan that arrives up to `MAX_AGE_S` after it was measured is late and welcome. One that is older, or from
the future, would place tracks where nothing is now, and is refused. When a sensor's scans are all off by the
same amount, its clock is off: after `SHOWN` such scans its times are corrected by that amount, and the
operator is told. When the wall clock of this machine is set, sensors on the same machine move with it: their
next scan shows whether they did.

Latency and a clock that is behind cannot be told apart by one scan. A corrected sensor keeps the latency that
it had before; one that never had a good scan is taken to have none.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from statistics import median_low

from gcs.model import NS_PER_S, ClockStep, Effect, Notice, Scan

MAX_AGE_S = 5.0
"""Older scans are refused: an agent flies 100 m and more in that time."""
MAX_AHEAD_S = 1.0
"""Scans measured farther in the future than this are refused."""
SHOWN = 5
"""So many scans in a row that are off by the same amount show that a clock is off."""
_SHOWN_FOR_NS = 2 * NS_PER_S
_SAME_NS = NS_PER_S // 2
_MAX_SENSORS = 256
_REMEMBERED = 9


@dataclass(slots=True)
class _SensorClock:
    """What is known of one sensor's times."""

    offset_ns: int = 0
    """Added to the times of its scans."""
    lags_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
    """From measurement, corrected, to arrival: of the last scans that were good."""
    refused: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=SHOWN))
    """(arrival, lag by the sensor's own clock) of scans that were refused since the last good one."""
    step_ns: int = 0
    """How far the wall clock was set since the sensor's last scan."""

    @property
    def usual_lag_ns(self) -> int:
        """Latency that the sensor had so far."""
        return median_low(self.lags_ns) if self.lags_ns else 0


class ScanTiming:
    """Clocks of all sensors."""

    def __init__(self) -> None:
        self._clocks: dict[str, _SensorClock] = {}

    def step(self, event: ClockStep) -> None:
        """Note that the wall clock of this machine was set."""
        for clock in self._clocks.values():
            clock.step_ns += event.step_ns

    def corrected(self, scan: Scan) -> tuple[Scan, str, list[Effect]]:
        """Judge the time of a scan that has just arrived.

        Returns
        -------
        scan : Scan
            With its time corrected by what is known of the sensor's clock.
        refusal : str
            Why it must not be worked; empty when it may.
        effects : list of Effect
            What the operator is to be told of the sensor's clock.
        """
        clock, effects = self._clock(scan.sensor.name), list[Effect]()
        own_lag_ns = scan.t_ns - scan.measured_t_ns
        if clock.step_ns:
            effects += self._follow_step(scan, clock, own_lag_ns)
        lag_ns = own_lag_ns - clock.offset_ns
        if not _is_good(lag_ns):
            effects += self._show(scan, clock, own_lag_ns)
            lag_ns = own_lag_ns - clock.offset_ns
        if _is_good(lag_ns):
            clock.refused.clear()
            clock.lags_ns.append(lag_ns)
            if clock.offset_ns:
                scan = replace(scan, measured_t_ns=scan.measured_t_ns + clock.offset_ns)
            return scan, "", effects
        when = f"{lag_ns / NS_PER_S:.1f} s ago" if lag_ns > 0 else f"{-lag_ns / NS_PER_S:.1f} s in the future"
        return scan, f"measured {when} by its clock", effects

    def _clock(self, sensor: str) -> _SensorClock:
        clock = self._clocks.setdefault(sensor, _SensorClock())
        if len(self._clocks) > _MAX_SENSORS:  # invented names do not fill the memory
            del self._clocks[next(iter(self._clocks))]
        return clock

    def _follow_step(self, scan: Scan, clock: _SensorClock, own_lag_ns: int) -> list[Effect]:
        """Correct a sensor that moved with this machine's clock; leave one that did not."""
        step_ns, clock.step_ns = clock.step_ns, 0
        if not clock.lags_ns:
            return []
        usual_ns, lag_ns = clock.usual_lag_ns, own_lag_ns - clock.offset_ns
        if abs(lag_ns + step_ns - usual_ns) >= min(abs(lag_ns - usual_ns), _SAME_NS):
            return []
        clock.offset_ns -= step_ns
        text = (
            f"the clock of sensor {scan.sensor.name} was set by {step_ns / NS_PER_S:+.1f} s with this "
            "machine's; its times are corrected by as much"
        )
        return [Notice(scan.t_ns, "info", text)]

    def _show(self, scan: Scan, clock: _SensorClock, own_lag_ns: int) -> list[Effect]:
        """Note a scan that is off; when enough are off by the same amount, correct the sensor's clock."""
        clock.refused.append((scan.t_ns, own_lag_ns))
        lags_ns = [lag_ns for _, lag_ns in clock.refused]
        is_shown = len(lags_ns) == SHOWN and scan.t_ns - clock.refused[0][0] >= _SHOWN_FOR_NS
        if not is_shown or max(lags_ns) - min(lags_ns) > _SAME_NS:
            return []
        clock.offset_ns = median_low(lags_ns) - clock.usual_lag_ns
        name, off_s = scan.sensor.name, clock.offset_ns / NS_PER_S
        if abs(clock.offset_ns) < _SAME_NS:
            clock.offset_ns = 0
            return [Notice(scan.t_ns, "info", f"the clock of sensor {name} agrees with ours again")]
        side = "behind" if off_s > 0 else "ahead of"
        text = (
            f"the clock of sensor {name} is {abs(off_s):.1f} s {side} ours: its times are corrected by that "
            "from now on; set its clock (NTP, PTP)"
        )
        return [Notice(scan.t_ns, "alarm", text)]


def _is_good(lag_ns: int) -> bool:
    return -MAX_AHEAD_S * NS_PER_S <= lag_ns <= MAX_AGE_S * NS_PER_S
