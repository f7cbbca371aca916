"""Measurement times of scans: refusal of old ones, correction of sensors' clock offsets.

A scan may arrive up to `MAX_AGE_S` after its measurement. Older and future scans are refused. After
`OFFSET_SCANS` consecutive scans with one offset, the sensor's times are corrected by it, with an alarm. After
a step of this machine's wall clock, the next scan shows whether the sensor's clock moved with it.

Latency and a slow clock look alike. A corrected sensor keeps its former latency, or 0 if it never had a good
scan.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from statistics import median_low

from gcs.model import NS_PER_S, ClockStep, Effect, Notice, NoticeCode, Parameter, Scan

MAX_AGE_S = 5.0
"""Maximum time from measurement to arrival: an agent flies 100 m and more in it."""
MAX_AHEAD_S = 1.0
"""Maximum time from arrival to measurement."""
OFFSET_SCANS = 5
"""Number of consecutive scans with one offset that prove a wrong clock."""
_MIN_OFFSET_NS = 2 * NS_PER_S
_TOLERANCE_NS = NS_PER_S // 2
_MAX_SENSORS = 256
_LAGS_KEPT = 9


@dataclass(slots=True)
class SensorClock:
    """Clock offset and latency of one sensor."""

    offset_ns: int = 0
    """Correction of its measurement times."""
    lags_ns: list[int] = field(default_factory=list)
    """Latencies of the last good scans, from corrected measurement to arrival."""
    refused: list[tuple[int, int]] = field(default_factory=list)
    """Arrival time and uncorrected lag of scans that were refused since the last good one."""
    step_ns: int = 0
    """Step of the wall clock since its last scan."""

    @property
    def usual_lag_ns(self) -> int:
        """Median latency."""
        return median_low(self.lags_ns) if self.lags_ns else 0


@dataclass(slots=True)
class ScanTiming:
    """Clock offsets of all sensors."""

    clocks: dict[str, SensorClock] = field(default_factory=dict)

    def max_lag_ns(self) -> int:
        """Return the longest latency of the last good scans of all sensors; at least 0."""
        return max((lag_ns for clock in self.clocks.values() for lag_ns in (0, *clock.lags_ns)), default=0)

    def step(self, event: ClockStep) -> list[Effect]:
        """Process a step of this machine's wall clock."""
        for clock in self.clocks.values():
            clock.step_ns += event.step_ns
        return [Notice(event.t_ns, NoticeCode.CLOCK_SET, None, {"step_s": event.step_ns / NS_PER_S})]

    def corrected(self, scan: Scan) -> tuple[Scan, str, list[Effect]]:
        """Check and correct the measurement time of a new scan.

        Returns
        -------
        scan : Scan
            Scan with the corrected time.
        refusal : str
            Reason to refuse the scan; empty if there is none.
        effects : list of Effect
            Notices about the sensor's clock.
        """
        clock = self._clock(scan.sensor.name)
        effects = list[Effect]()
        own_lag_ns = scan.t_ns - scan.measured_t_ns
        if clock.step_ns:
            effects += self._follow_step(scan, clock, own_lag_ns)
        lag_ns = own_lag_ns - clock.offset_ns
        if not _is_good(lag_ns):
            effects += self._note_offset(scan, clock, own_lag_ns)
            lag_ns = own_lag_ns - clock.offset_ns
        if _is_good(lag_ns):
            clock.refused.clear()
            clock.lags_ns = [*clock.lags_ns, lag_ns][-_LAGS_KEPT:]
            if clock.offset_ns:
                scan = replace(scan, measured_t_ns=scan.measured_t_ns + clock.offset_ns)
            return scan, "", effects
        when = f"{lag_ns / NS_PER_S:.1f} s ago" if lag_ns > 0 else f"{-lag_ns / NS_PER_S:.1f} s in the future"
        return scan, f"measured {when} by its clock", effects

    def _clock(self, sensor: str) -> SensorClock:
        if sensor not in self.clocks and len(self.clocks) >= _MAX_SENSORS:
            # The number of sensors is bounded; those without a good scan go first.
            bad = (name for name, clock in self.clocks.items() if not clock.lags_ns)
            del self.clocks[next(bad, next(iter(self.clocks)))]
        return self.clocks.setdefault(sensor, SensorClock())

    def _follow_step(self, scan: Scan, clock: SensorClock, own_lag_ns: int) -> list[Effect]:
        """Correct a sensor whose clock moved with this machine's clock."""
        step_ns = clock.step_ns
        clock.step_ns = 0
        if not clock.lags_ns:
            return []
        usual_ns = clock.usual_lag_ns
        lag_ns = own_lag_ns - clock.offset_ns
        if abs(lag_ns + step_ns - usual_ns) >= min(abs(lag_ns - usual_ns), _TOLERANCE_NS):
            return []
        clock.offset_ns -= step_ns
        step: dict[str, Parameter] = {"step_s": step_ns / NS_PER_S}
        return [Notice(scan.t_ns, NoticeCode.SENSOR_CLOCK_STEP, scan.sensor.name, step)]

    def _note_offset(self, scan: Scan, clock: SensorClock, own_lag_ns: int) -> list[Effect]:
        """Note a wrong time; correct the sensor once enough scans have the same offset."""
        clock.refused = [*clock.refused, (scan.t_ns, own_lag_ns)][-OFFSET_SCANS:]
        lags_ns = [lag_ns for _, lag_ns in clock.refused]
        is_proven = len(lags_ns) == OFFSET_SCANS and scan.t_ns - clock.refused[0][0] >= _MIN_OFFSET_NS
        if not is_proven or max(lags_ns) - min(lags_ns) > _TOLERANCE_NS:
            return []
        clock.offset_ns = median_low(lags_ns) - clock.usual_lag_ns
        name = scan.sensor.name
        off_s = clock.offset_ns / NS_PER_S
        if abs(clock.offset_ns) < _TOLERANCE_NS:
            clock.offset_ns = 0
            return [Notice(scan.t_ns, NoticeCode.SENSOR_CLOCK_AGREES, name)]
        side = "behind" if off_s > 0 else "ahead of"
        return [Notice(scan.t_ns, NoticeCode.SENSOR_CLOCK_OFF, name, {"off_s": abs(off_s), "side": side})]


def _is_good(lag_ns: int) -> bool:
    return -MAX_AHEAD_S * NS_PER_S <= lag_ns <= MAX_AGE_S * NS_PER_S
