"""Watchdog of sensors: no scan processed, or no vehicle associated with a track.

The timeout of a sensor counts from its last processed scan. Refused scans do not reset it. Sensors with a
processed scan keep their place. A few others have one, so that refused scans under ever new names neither
replace a sensor nor raise an alarm each.
"""

from __future__ import annotations

from collections.abc import Collection, Container
from dataclasses import dataclass, field

from gcs.model import NS_PER_S, Effect, Notice, NoticeCode, Parameter, SensorRecord
from gcs.model.rounding import rounded
from gcs.model.status import SensorState

BLIND_AFTER_NS = 5 * NS_PER_S
"""Timeout of a sensor; `_PERIODS` periods if that is longer."""
UNASSOCIATED_AFTER_NS = 10 * NS_PER_S
_PERIODS = 3
_LATE_AFTER_NS = NS_PER_S
"""Time without a processed scan after which a sensor is late; `_LATE_PERIODS` periods if that is longer."""
_LATE_PERIODS = 2
_MAX_SENSORS = 256
_MAX_REFUSED_SENSORS = 16
"""Number of sensors without a processed scan."""
_MIN_REFUSED = 3
"""Refused scans that make a sensor of a name without a processed scan."""
_KEEP_REFUSED_NS = 60 * NS_PER_S
"""Time without a refused scan after which such a sensor gives its place to another."""


@dataclass(slots=True)
class WatchedSensor:
    """State of one sensor."""

    first_t_ns: int
    processed_t_ns: int | None = None
    period_ns: int = 0
    """Longest recent time between two processed scans."""
    refused: int = 0
    """Number of scans refused since the last processed one."""
    reason: str = ""
    refused_t_ns: int = 0
    """Time of the last refused scan."""
    was_processed: bool = False
    """True after the first processed scan."""
    alarmed: bool = False

    @property
    def is_sensor(self) -> bool:
        """True with a processed scan, or several refused ones; else it may be an invented name."""
        return self.was_processed or self.refused >= _MIN_REFUSED

    @property
    def since_t_ns(self) -> int:
        """Time of the last processed scan; before the first, that of the sensor's first scan."""
        return self.first_t_ns if self.processed_t_ns is None else self.processed_t_ns

    def state(self, t_ns: int) -> SensorState:
        """Return whether scans come in time, for displays."""
        if self.alarmed:
            return "silent"
        limit_ns = max(_LATE_AFTER_NS, _LATE_PERIODS * self.period_ns)
        return "late" if t_ns - self.since_t_ns > limit_ns else ""


@dataclass(slots=True)
class SensorWatchdog:
    """Raises one alarm per silent sensor, and one if there is none at all, each with an all-clear."""

    start_t_ns: int | None = None
    """Time of the first tick."""
    scan_t_ns: int | None = None
    """Arrival time of the last processed scan; None before the first."""
    sensors: dict[str, WatchedSensor] = field(default_factory=dict)
    has_no_sensor: bool = False
    """True while the alarm that there is no sensor is raised."""
    is_unassociated: bool = False
    """True while the alarm that no vehicle is associated with a track is raised."""
    unassociated_t_ns: int | None = None
    """Time since which no reporting vehicle is associated with a track."""

    @property
    def is_blind(self) -> bool:
        """True while no sensor has its scans processed, and the alarms about that are raised."""
        watched = [one for one in self.sensors.values() if one.is_sensor]
        return self.has_no_sensor or (bool(watched) and all(one.alarmed for one in watched))

    def begin_again(self, t_ns: int) -> None:
        """Wait for all sensors as at the start of the service."""
        self.start_t_ns = t_ns
        for entry in self.sensors.values():
            entry.first_t_ns = t_ns
            entry.processed_t_ns = None

    def processed(self, sensor: str, t_ns: int) -> list[Effect]:
        """Note a processed scan; return the all-clear after an alarm."""
        effects: list[Effect] = []
        entry = self._place(sensor, t_ns)
        entry.was_processed = True
        if entry.processed_t_ns is not None and not entry.alarmed:
            entry.period_ns = max(t_ns - entry.processed_t_ns, entry.period_ns - entry.period_ns // 8)
        if entry.alarmed:
            since_ns = t_ns - (entry.processed_t_ns or entry.first_t_ns)
            silence: dict[str, Parameter] = {"silence_s": since_ns / NS_PER_S}
            effects.append(Notice(t_ns, NoticeCode.SENSOR_AGAIN, sensor, silence))
        elif self.has_no_sensor:
            since_ns = t_ns - (self.scan_t_ns or self.start_t_ns or t_ns)
            effects.append(Notice(t_ns, NoticeCode.SCANS_AGAIN, None, {"silence_s": since_ns / NS_PER_S}))
        entry.processed_t_ns = t_ns
        entry.refused = 0
        entry.alarmed = False
        entry.reason = ""
        self.scan_t_ns = t_ns
        self.has_no_sensor = False
        return effects

    def refused(self, sensor: str, t_ns: int, reason: str) -> None:
        """Note a refused scan."""
        entry = self._refused_place(sensor, t_ns)
        if entry is not None:
            entry.refused += 1
            entry.reason = reason
            entry.refused_t_ns = t_ns

    def records(self, t_ns: int) -> tuple[SensorRecord, ...]:
        """Return the age of each sensor's last processed scan, and whether its scans come in time."""
        return tuple(
            SensorRecord(
                name,
                None if one.processed_t_ns is None else rounded((t_ns - one.processed_t_ns) / NS_PER_S),
                one.refused,
                one.state(t_ns),
            )
            for name, one in self.sensors.items()
        )

    def poll(self, t_ns: int) -> list[Effect]:
        """Return the alarms that are due."""
        if self.start_t_ns is None:
            self.start_t_ns = t_ns
        effects: list[Effect] = []
        for name, entry in self.sensors.items():
            limit_ns = max(BLIND_AFTER_NS, _PERIODS * entry.period_ns)
            if entry.is_sensor and not entry.alarmed and t_ns - entry.since_t_ns >= limit_ns:
                entry.alarmed = True
                effects.append(_alarm(t_ns, name, entry, (t_ns - entry.since_t_ns) / NS_PER_S))
        since_t_ns = self.start_t_ns if self.scan_t_ns is None else self.scan_t_ns
        is_any = any(one.is_sensor for one in self.sensors.values())
        if not is_any and not self.has_no_sensor and t_ns - since_t_ns >= BLIND_AFTER_NS:
            self.has_no_sensor = True
            since_s = (t_ns - since_t_ns) / NS_PER_S
            effects.append(Notice(t_ns, NoticeCode.NO_SENSOR, None, {"silence_s": since_s}))
        return effects

    def associated(self, t_ns: int, reporting: Collection[int], associated: Container[int]) -> list[Effect]:
        """Return an alarm, or its all-clear, if no reporting vehicle is associated with a track."""
        is_lost = bool(reporting) and not any(vehicle in associated for vehicle in reporting)
        was_alarmed = self.is_unassociated
        since_t_ns = self.unassociated_t_ns
        if not is_lost:
            self.unassociated_t_ns = None
            self.is_unassociated = False
            return [Notice(t_ns, NoticeCode.ASSOCIATED_AGAIN)] if was_alarmed else []
        if since_t_ns is None:
            self.unassociated_t_ns = t_ns
        elif not was_alarmed and t_ns - since_t_ns >= UNASSOCIATED_AFTER_NS:
            self.is_unassociated = True
            since_s = (t_ns - since_t_ns) / NS_PER_S
            return [Notice(t_ns, NoticeCode.NO_ASSOCIATION, None, {"silence_s": since_s})]
        return []

    def _place(self, sensor: str, t_ns: int) -> WatchedSensor:
        """Return the place of a sensor with a processed scan.

        On a full list it replaces one without a processed scan, else the newest.
        """
        if sensor not in self.sensors and len(self.sensors) >= _MAX_SENSORS:
            others = (name for name, one in self.sensors.items() if not one.was_processed)
            del self.sensors[next(others, list(self.sensors)[-1])]
        return self.sensors.setdefault(sensor, WatchedSensor(t_ns))

    def _refused_place(self, sensor: str, t_ns: int) -> WatchedSensor | None:
        """Return the place of a sensor with a refused scan; None if all are taken."""
        if sensor in self.sensors:
            return self.sensors[sensor]
        others = {name: one for name, one in self.sensors.items() if not one.was_processed}
        if len(others) >= _MAX_REFUSED_SENSORS:
            idle = (name for name, one in others.items() if t_ns - one.refused_t_ns >= _KEEP_REFUSED_NS)
            replaced = next(idle, None)
            if replaced is None:
                return None
            del self.sensors[replaced]
        if len(self.sensors) >= _MAX_SENSORS:
            return None
        return self.sensors.setdefault(sensor, WatchedSensor(t_ns, refused_t_ns=t_ns))


def _alarm(t_ns: int, name: str, entry: WatchedSensor, since_s: float) -> Notice:
    silence: dict[str, Parameter] = {"silence_s": since_s}
    if not entry.refused:
        return Notice(t_ns, NoticeCode.SENSOR_SILENT, name, silence)
    refused: dict[str, Parameter] = {"count": entry.refused, "reason": entry.reason}
    return Notice(t_ns, NoticeCode.SCANS_REFUSED, name, silence | refused)
