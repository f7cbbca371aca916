"""Position integrity: alarm when reported positions differ from detections (spoofed GPS), a CUSUM test.

Position reports may be spoofed, and the agents' tracker uses them as a sensor (decision 0004). So detections
are checked directly: is there one at the reported position? The log-likelihood ratio of "absent"
(`detection_gate`) is accumulated, bounded per scan and in total (Page's cumulative sum, Biometrika 41, 1954).
An alarm is raised above `ALARM_CUSUM`, and cleared at 0.

Only armed vehicles with fresh reports of usual telemetry are checked, by sensors that cover the reported
position.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from gcs.config.schema import TelemetryTable
from gcs.core.perception.detection_gate import (
    GATE_CHI2,
    absence_log_ratio,
    are_hit,
    clutter_in_gates,
    covers_gates,
    near,
)
from gcs.core.perception.perception_state import IntegrityTest
from gcs.core.perception.report_sensor import at_time
from gcs.core.state import Agent
from gcs.model import (
    NS_PER_S,
    Effect,
    FloatArray,
    Label,
    Notice,
    NoticeCode,
    Parameter,
    Scan,
    Sensor,
    Track,
    VehicleState,
)
from gcs.tracking.models.sensor_geometry import noise_m2

ALARM_CUSUM = 9.0
"""Log-likelihood ratio that raises the alarm: 8000 to 1."""
_MAX_CUSUM = 12.0
_MAX_SCAN_RATIO = 3.0
_MANOEUVRE_M_S2 = 5.0
_PERIOD_NS = NS_PER_S * 4 // 10
"""Minimum time between checks of one vehicle: faster ones are not independent."""
_FORGET_NS = 10 * NS_PER_S


class PositionIntegrityMonitor:
    """CUSUM tests of all vehicles."""

    def __init__(self, agents: Mapping[int, Agent], telemetry: TelemetryTable) -> None:
        self._agents = agents
        self._report_variance_m2 = telemetry.noise_std_m**2
        self._max_age_ns = int(telemetry.max_age_s * NS_PER_S)

    def update(
        self,
        scan: Scan,
        states: Sequence[VehicleState],
        agents: Mapping[Label, Track],
        targets: Iterable[Track],
    ) -> list[Effect]:
        """Process one scan, after the trackers; return alarms and all-clears.

        Parameters
        ----------
        agents, targets
            Confirmed tracks.
        """
        t_ns = scan.measured_t_ns
        effects = list[Effect]()
        fresh = [s for s in states if s.armed and not s.period_s and abs(t_ns - s.t_ns) <= self._max_age_ns]
        positions = np.reshape([at_time(state, t_ns) for state in fresh], (-1, 2))
        S = self._innovation_cov_m2(
            scan.sensor, positions, [(t_ns - state.t_ns) / NS_PER_S for state in fresh]
        )
        is_covered = covers_gates(scan.sensor, positions, S)
        is_hit = are_hit(positions, S, scan.z_m)
        clutter = clutter_in_gates(scan.sensor, positions, S)
        tracks = [*agents.values(), *targets]
        column: dict[Label | None, int] = {label: k for k, label in enumerate(agents)}
        labels = [self._agents[state.system_id].perception.association.label for state in fresh]
        rows, near_tracks = near(positions, S, np.reshape([track.mean[:2] for track in tracks], (-1, 2)))
        others = near_tracks != np.array([column.get(label, -1) for label in labels], np.int64)[rows]
        other_counts: list[int] = np.bincount(rows[others], minlength=len(fresh)).tolist()
        for i in np.flatnonzero(is_covered):
            vehicle = fresh[i].system_id
            test = self._agents[vehicle].perception.integrity
            if test.t_ns is not None and 0 <= t_ns - test.t_ns < _PERIOD_NS:
                continue
            test.t_ns = t_ns
            ratio = absence_log_ratio(scan.sensor, clutter[i], other_counts[i], is_hit=is_hit[i])
            ratio = min(max(ratio, -_MAX_SCAN_RATIO), _MAX_SCAN_RATIO)
            effects += self._add_ratio(scan.t_ns, vehicle, test, ratio, labels[i], positions[i], agents)
        self._forget(t_ns)
        return effects

    def _innovation_cov_m2(
        self, sensor: Sensor, positions: FloatArray, ages_s: Sequence[float]
    ) -> FloatArray:
        """Return covariances (n, 2, 2) of a detection around a reported position, predicted to the scan."""
        manoeuvre_m = 0.5 * _MANOEUVRE_M_S2 * np.square(np.asarray(ages_s, dtype=np.float64))
        variance_m2 = self._report_variance_m2 + np.square(manoeuvre_m)
        return np.asarray(noise_m2(sensor, positions) + variance_m2[:, None, None] * np.eye(2))

    def _add_ratio(
        self,
        t_ns: int,
        vehicle: int,
        test: IntegrityTest,
        ratio: float,
        own: Label | None,
        position: FloatArray,
        agents: Mapping[Label, Track],
    ) -> list[Effect]:
        test.cusum = min(max(test.cusum + ratio, 0.0), _MAX_CUSUM)
        if test.cusum == 0.0:
            test.label = own
        if not test.is_alarmed and test.cusum >= ALARM_CUSUM:
            test.is_alarmed = True
            return [_alarm(t_ns, vehicle, test, position, agents)]
        if test.is_alarmed and test.cusum == 0.0:
            test.is_alarmed = False
            return [Notice(t_ns, NoticeCode.SEEN_THERE, vehicle)]
        return []

    def _forget(self, t_ns: int) -> None:
        """Drop vehicles that were not checked for a while."""
        for agent in self._agents.values():
            checked_t_ns = agent.perception.integrity.t_ns
            if checked_t_ns is not None and t_ns - checked_t_ns > _FORGET_NS:
                agent.perception.integrity = IntegrityTest()


def _alarm(
    t_ns: int, vehicle: int, test: IntegrityTest, position: FloatArray, agents: Mapping[Label, Track]
) -> Notice:
    track = agents.get(test.label) if test.label is not None else None
    away_m = 0.0 if track is None else float(np.hypot(*(track.mean[:2] - position)))
    if track is None or away_m < math.sqrt(GATE_CHI2 * float(np.linalg.eigvalsh(track.cov[:2, :2])[-1])):
        return Notice(t_ns, NoticeCode.NOT_SEEN_THERE, vehicle)
    place: dict[str, Parameter] = {"east_m": track.mean[0], "north_m": track.mean[1]}
    return Notice(t_ns, NoticeCode.SEEN_ELSEWHERE, vehicle, {"distance_m": away_m} | place)
