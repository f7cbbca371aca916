"""Contradictions of sensors: one detects an object scan after scan, another one has it in view and misses it.

For each track, each sensor with the track in view has the log-likelihood ratio of its misses since it last
detected it, and each other sensor that of its scans since the first of these misses (`detection_gate`). Two
sensors contradict each other if both ratios pass `CERTAIN_LOG_RATIO`: one of them announces a detection
probability or a clutter density that is wrong, or reports what is not so. Nothing here says which.

A track that one sensor misses for certain, and at most one other sensor detects meanwhile, is seen by one
sensor alone. An agent that does not report, either, is then lost (`arrival_and_loss`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field

import numpy as np

from gcs.core.perception.detection_gate import (
    absence_log_ratio,
    are_hit,
    clutter_in_gates,
    covers_gates,
    near,
)
from gcs.model import NS_PER_S, Kind, Label, Notice, NoticeCode, Parameter, Scan, Track
from gcs.tracking.models.sensor_geometry import noise_m2

CERTAIN_LOG_RATIO = math.log(1e8)
"""At 1e6 to 1, honest sensors would contradict each other every few hours of 100 tracks."""
_MAX_LOG_RATIO = 2.0 * CERTAIN_LOG_RATIO
_MAX_SENSORS = 100
"""Number of sensors that are compared for one track."""
_FORGET_NS = 10 * NS_PER_S
"""Time without a contradiction, or without the track in view, after which it is over."""


@dataclass(slots=True)
class Misses:
    """Misses of one track by one sensor that had it in view, since it last detected the track."""

    t_ns: int
    """Time of the last one."""
    log_ratio: float = 0.0
    """Log-likelihood ratio of absence and presence, by these misses."""
    seen: dict[str, float] = field(default_factory=dict)
    """That of presence and absence by each other sensor's scans meanwhile, where it is above 0."""

    @property
    def are_certain(self) -> bool:
        """True if they are too many for chance."""
        return self.log_ratio >= CERTAIN_LOG_RATIO


@dataclass(slots=True)
class Contradiction:
    """Two sensors that contradict each other."""

    missed_by: str
    seen_by: str
    t_ns: int
    """Last time at which they did."""


@dataclass(slots=True)
class SensorContradictions:
    """Contradictions of all pairs of sensors."""

    misses: dict[Kind, dict[Label, dict[str, Misses]]] = field(default_factory=dict)
    """By label and sensor."""
    raised: list[Contradiction] = field(default_factory=list)
    """Those with an alarm."""

    def update(self, kind: Kind, scan: Scan, tracks: Sequence[Track], confirmed: Sequence[Track]) -> None:
        """Process a scan after its tracker, with all tracks of a kind and the confirmed ones of both."""
        before = self.misses.get(kind, {})
        self.misses[kind] = after = dict[Label, dict[str, Misses]]()
        t_ns = scan.measured_t_ns
        positions = np.reshape([track.mean[:2] for track in tracks], (-1, 2))
        S = np.reshape([track.cov[:2, :2] for track in tracks], (-1, 2, 2)) + noise_m2(scan.sensor, positions)
        is_covered = covers_gates(scan.sensor, positions, S).tolist()
        is_hit = are_hit(positions, S, scan.z_m)
        clutter = clutter_in_gates(scan.sensor, positions, S)
        rows, _ = near(positions, S, np.reshape([one.mean[:2] for one in confirmed], (-1, 2)))
        n_near = np.bincount(rows, minlength=len(tracks)).tolist()
        own = {id(track) for track in confirmed}
        for i, track in enumerate(tracks):
            found = before.get(track.label, {})
            if is_covered[i]:
                others = n_near[i] - (id(track) in own)
                ratio = absence_log_ratio(scan.sensor, clutter[i], others, is_hit=is_hit[i])
                _add_scan(found, scan.sensor.name, t_ns, ratio, is_hit=is_hit[i])
            found = {name: one for name, one in found.items() if t_ns - one.t_ns <= _FORGET_NS}
            if found:
                after[track.label] = found

    def seen_by_one(self, kind: Kind) -> AbstractSet[Label]:
        """Return the tracks that a sensor misses for certain and at most one other detects meanwhile."""
        return {
            label
            for label, by_sensor in self.misses.get(kind, {}).items()
            if any(one.are_certain and len(one.seen) <= 1 for one in by_sensor.values())
        }

    def notices(self, t_ns: int, tracks: Sequence[tuple[Kind, Track]]) -> list[Notice]:
        """Return alarms about new pairs of sensors, and all-clears; `tracks` are those of the last scan."""
        notices = []
        for kind, track in tracks:
            for sensor, misses in self.misses.get(kind, {}).get(track.label, {}).items():
                for other, log_ratio in misses.seen.items():
                    if not misses.are_certain or log_ratio < CERTAIN_LOG_RATIO:
                        continue
                    known = [one for one in self.raised if (one.missed_by, one.seen_by) == (sensor, other)]
                    if known:
                        known[0].t_ns = t_ns
                        continue
                    self.raised.append(Contradiction(sensor, other, t_ns))
                    place: dict[str, Parameter] = {"east_m": track.mean[0], "north_m": track.mean[1]}
                    found: dict[str, Parameter] = {"other": other, "kind": kind.removesuffix("s")}
                    notices.append(Notice(t_ns, NoticeCode.SENSORS_CONTRADICT, sensor, found | place))
        for one in [one for one in self.raised if t_ns - one.t_ns > _FORGET_NS]:
            self.raised.remove(one)
            notices.append(Notice(t_ns, NoticeCode.SENSORS_AGREE, one.missed_by, {"other": one.seen_by}))
        return notices


def _add_scan(found: dict[str, Misses], sensor: str, t_ns: int, ratio: float, *, is_hit: bool) -> None:
    """Add what a scan of a sensor tells of a track, as a log-likelihood ratio of absence and presence."""
    if is_hit:
        found.pop(sensor, None)
    elif sensor in found or len(found) < _MAX_SENSORS:
        own = found.setdefault(sensor, Misses(t_ns))
        own.t_ns = t_ns
        own.log_ratio = min(own.log_ratio + ratio, _MAX_LOG_RATIO)
    for name, misses in found.items():
        if name == sensor:
            continue
        seen = min(misses.seen.get(sensor, 0.0) - ratio, _MAX_LOG_RATIO)
        if seen > 0.0 and (sensor in misses.seen or len(misses.seen) < _MAX_SENSORS):
            misses.seen[sensor] = seen
        else:
            misses.seen.pop(sensor, None)
