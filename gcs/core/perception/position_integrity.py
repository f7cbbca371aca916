"""Position integrity: alarm when reported positions differ from detections (spoofed GPS), a CUSUM test.

Position reports may be spoofed, and the agents' tracker uses them as a sensor (decision 0004). So detections
are checked directly: is there one at the reported position? With detection probability p_D, expected clutter
and other confirmed objects within the gate,

    P(hit | absent)  = 1 - exp(-clutter - p_D others)
    P(hit | present) = 1 - (1 - p_D) (1 - P(hit | absent))

The log-likelihood ratio of "absent" is accumulated, bounded per scan and in total (Page's cumulative sum,
Biometrika 41, 1954). An alarm is raised above `ALARM_CUSUM`, and cleared at 0.

Only armed vehicles with fresh reports of usual telemetry are checked, by sensors that cover the reported
position.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gcs.config.schema import TelemetryTable
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
from gcs.tracking.models.sensor_geometry import MAX_DETECTION_PROBABILITY, clutter_per_m2, covers, noise_m2

Indices: TypeAlias = npt.NDArray[np.int64]

ALARM_CUSUM = 9.0
"""Log-likelihood ratio that raises the alarm: 8000 to 1."""
_MAX_CUSUM = 12.0
_MAX_SCAN_RATIO = 3.0
_GATE_CHI2 = 25.0
_MANOEUVRE_M_S2 = 5.0
_PERIOD_NS = NS_PER_S * 4 // 10
"""Minimum time between checks of one vehicle: faster ones are not independent."""
_FORGET_NS = 10 * NS_PER_S
_TINY = 1e-12


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
        is_covered = _covers_gate(scan.sensor, positions, S)
        n = len(positions)
        is_hit = np.bincount(_near(positions, S, scan.z_m)[0], minlength=n).astype(np.bool_).tolist()
        area_m2 = math.pi * _GATE_CHI2 * np.sqrt(np.linalg.det(S))
        clutter = (clutter_per_m2(scan.sensor, positions) * area_m2).tolist()
        tracks = [*agents.values(), *targets]
        column: dict[Label | None, int] = {label: k for k, label in enumerate(agents)}
        labels = [self._agents[state.system_id].perception.association.label for state in fresh]
        rows, near = _near(positions, S, np.reshape([track.mean[:2] for track in tracks], (-1, 2)))
        others = near != np.array([column.get(label, -1) for label in labels], np.int64)[rows]
        other_counts: list[int] = np.bincount(rows[others], minlength=n).tolist()
        for i in np.flatnonzero(is_covered):
            vehicle = fresh[i].system_id
            test = self._agents[vehicle].perception.integrity
            if test.t_ns is not None and 0 <= t_ns - test.t_ns < _PERIOD_NS:
                continue
            test.t_ns = t_ns
            ratio = _log_ratio(scan.sensor, is_hit[i], clutter[i], other_counts[i])
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
    if track is None or away_m < math.sqrt(_GATE_CHI2 * float(np.linalg.eigvalsh(track.cov[:2, :2])[-1])):
        return Notice(t_ns, NoticeCode.NOT_SEEN_THERE, vehicle)
    place: dict[str, Parameter] = {"east_m": track.mean[0], "north_m": track.mean[1]}
    return Notice(t_ns, NoticeCode.SEEN_ELSEWHERE, vehicle, {"distance_m": away_m} | place)


def _log_ratio(sensor: Sensor, is_hit: bool, clutter: float, others: int) -> float:
    """Return the bounded log-likelihood ratio of absence and presence."""
    p_d = min(float(sensor.detection_probability), MAX_DETECTION_PROBABILITY)
    p_absent = -math.expm1(-clutter - p_d * others)
    p_present = 1.0 - (1.0 - p_d) * (1.0 - p_absent)
    ratio = math.log(max(p_absent, _TINY) / max(p_present, _TINY)) if is_hit else -math.log1p(-p_d)
    return min(max(ratio, -_MAX_SCAN_RATIO), _MAX_SCAN_RATIO)


def _covers_gate(sensor: Sensor, positions: FloatArray, S: FloatArray) -> FloatArray:
    """Return a mask of the positions that a sensor covers, with three standard deviations around them."""
    margin_m = 3.0 * np.sqrt(np.linalg.eigvalsh(S)[:, -1]) if len(positions) else np.zeros(0)
    is_covered = np.ones(len(positions), np.bool_)
    for east, north in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        is_covered &= covers(sensor, positions + margin_m[:, None] * np.array([east, north]))
    return np.asarray(is_covered)


def _near(positions: FloatArray, S: FloatArray, points: FloatArray) -> tuple[Indices, Indices]:
    """Return the pairs of positions (n, 2) and points (m, 2) within a gate, as (k,) indices of each."""
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    if not len(positions) or not len(finite):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    reach_m = np.sqrt(_GATE_CHI2 * np.linalg.eigvalsh(S)[:, -1]) * (1.0 + 1e-9)
    found = cKDTree(points[finite]).query_ball_point(positions, reach_m, return_sorted=True)
    rows = np.repeat(np.arange(len(positions)), [len(row) for row in found])
    columns = finite[np.fromiter(chain.from_iterable(found), np.int64, len(rows))]
    x, y = (points[columns] - positions[rows]).T
    s00 = S[rows, 0, 0]
    s01 = S[rows, 0, 1]
    s11 = S[rows, 1, 1]
    d2 = (s11 * x * x - 2.0 * s01 * x * y + s00 * y * y) / (s00 * s11 - s01 * s01)
    return rows[d2 <= _GATE_CHI2], columns[d2 <= _GATE_CHI2]
