"""Whether vehicles are where they report to be: their reports against what sensors see there.

A spoofed or captured receiver says what its spoofer wants, and the agents' tracker takes reports for a sensor
(decision 0004). So the detections themselves are asked, before any tracker: was there one where the vehicle
says that it is? Each scan of a sensor that looks there is evidence. With detection probability p_D, expected
clutter and other believed objects within the gate,

    P(hit | it is not there) = 1 - exp(-clutter - p_D others)
    P(hit | it is there)     = 1 - (1 - p_D) (1 - P(hit | it is not there))

and the logarithm of the ratio adds up, bounded for each scan (a sensor's word on itself may be wrong) and in
total (Page's cumulative sum, Biometrika 41, 1954): an alarm above `DOUBT`, an all-clear when it is back at 0.
A hit where clutter is dense, or where another object is, says little, as it should.

Only vehicles that are armed and report freshly are asked for: sensors do not see what stands on the ground,
and silence has its own alarm. Without sensors that look there, nothing is known and nothing is said.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gcs.config.tables import TelemetryTable
from gcs.core.perception.fusion import at_time
from gcs.model import NS_PER_S, Effect, FloatArray, Label, Notice, Scan, Sensor, Track, VehicleState
from gcs.tracking.models.sensors import MAX_DETECTION_PROBABILITY, clutter_per_m2, covers, noise_m2

Indices: TypeAlias = npt.NDArray[np.int64]

DOUBT = 9.0
"""Logarithm of the ratio that raises the alarm: 8000 to 1."""
_MOST = 12.0
_MOST_OF_A_SCAN = 3.0
_GATE_CHI2 = 25.0
_MANOEUVRE_M_S2 = 5.0
_PERIOD_NS = NS_PER_S * 4 // 10
"""Looks at one vehicle that follow each other faster are not independent."""
_FORGET_NS = 10 * NS_PER_S
_TINY = 1e-12
_NOBODY: Label = (-1, -1)


@dataclass(slots=True)
class _Case:
    """What speaks against one vehicle's reports."""

    doubt: float = 0.0
    alarmed: bool = False
    t_ns: int = -_FORGET_NS
    """When it was last looked for."""
    label: Label | None = None
    """Its track while its reports were true."""


class PositionIntegrityMonitor:
    """All vehicles' reports against the scans.

    Parameters
    ----------
    telemetry : TelemetryTable
        How exact reports are, and for how long they are fresh.
    """

    def __init__(self, telemetry: TelemetryTable) -> None:
        self._report_variance_m2 = telemetry.noise_std_m**2
        self._max_age_ns = int(telemetry.max_age_s * NS_PER_S)
        self._cases: dict[int, _Case] = {}

    def doubted(self) -> frozenset[int]:
        """Vehicles that are not where they report to be."""
        return frozenset(vehicle for vehicle, case in self._cases.items() if case.alarmed)

    def take(
        self,
        scan: Scan,
        states: Sequence[VehicleState],
        labels: Mapping[int, Label],
        agents: Mapping[Label, Track],
        targets: Iterable[Track],
    ) -> list[Effect]:
        """Take one scan, after the trackers; return alarms and all-clears.

        Parameters
        ----------
        labels
            Label of each vehicle's track.
        agents, targets
            What is believed.
        """
        t_ns, effects = scan.measured_t_ns, list[Effect]()
        fresh = [s for s in states if s.armed and abs(t_ns - s.t_ns) <= self._max_age_ns]
        places = np.reshape([at_time(state, t_ns) for state in fresh], (-1, 2))
        S = self._spread_m2(scan.sensor, places, [(t_ns - state.t_ns) / NS_PER_S for state in fresh])
        looked_at = _looks_at(scan.sensor, places, S)
        n = len(places)
        is_hit = np.bincount(_near(places, S, scan.z_m)[0], minlength=n).astype(np.bool_).tolist()
        area_m2 = math.pi * _GATE_CHI2 * np.sqrt(np.linalg.det(S))
        clutter = (clutter_per_m2(scan.sensor, places) * area_m2).tolist()
        tracks = [*agents.values(), *targets]
        column = {label: k for k, label in enumerate(agents)}
        rows, near = _near(places, S, np.reshape([track.mean[:2] for track in tracks], (-1, 2)))
        others = (
            near
            != np.array([column.get(labels.get(s.system_id, _NOBODY), -1) for s in fresh], np.int64)[rows]
        )
        crowds: list[int] = np.bincount(rows[others], minlength=n).tolist()
        for i in np.flatnonzero(looked_at):
            vehicle = fresh[i].system_id
            case = self._cases.setdefault(vehicle, _Case())
            if 0 <= t_ns - case.t_ns < _PERIOD_NS:
                continue
            case.t_ns = t_ns
            own = labels.get(vehicle)
            doubt = _evidence(scan.sensor, is_hit[i], clutter[i], crowds[i])
            effects += self._weigh(scan.t_ns, vehicle, case, doubt, own, places[i], agents)
        self._forget(t_ns)
        return effects

    def _spread_m2(self, sensor: Sensor, places: FloatArray, ages_s: Sequence[float]) -> FloatArray:
        """Covariances (n, 2, 2) of a detection around a vehicle's reported place, moved on."""
        turned_m = 0.5 * _MANOEUVRE_M_S2 * np.square(np.asarray(ages_s, dtype=np.float64))
        variance_m2 = self._report_variance_m2 + np.square(turned_m)
        return np.asarray(noise_m2(sensor, places) + variance_m2[:, None, None] * np.eye(2))

    def _weigh(
        self,
        t_ns: int,
        vehicle: int,
        case: _Case,
        doubt: float,
        own: Label | None,
        place: FloatArray,
        agents: Mapping[Label, Track],
    ) -> list[Effect]:
        case.doubt = min(max(case.doubt + doubt, 0.0), _MOST)
        if case.doubt == 0.0:
            case.label = own
        if not case.alarmed and case.doubt >= DOUBT:
            case.alarmed = True
            return [Notice(t_ns, "alarm", self._accusation(case, place, agents), vehicle)]
        if case.alarmed and case.doubt == 0.0:
            case.alarmed = False
            return [Notice(t_ns, "info", "is seen where it reports to be again", vehicle)]
        return []

    def _accusation(self, case: _Case, place: FloatArray, agents: Mapping[Label, Track]) -> str:
        seen = agents.get(case.label) if case.label is not None else None
        away_m = 0.0 if seen is None else float(np.hypot(*(seen.mean[:2] - place)))
        if seen is None or away_m < math.sqrt(_GATE_CHI2 * float(np.linalg.eigvalsh(seen.cov[:2, :2])[-1])):
            return "is not seen where it reports to be: its position, or what speaks for it, may be false"
        east_m, north_m = (round(float(x)) for x in seen.mean[:2])
        return (
            f"is seen {away_m:.0f} m from where it reports to be, at {east_m} m east, {north_m} m north: "
            "its position is false"
        )

    def _forget(self, t_ns: int) -> None:
        """Drop who was not looked for in a while: silent, or where nobody looks."""
        for vehicle, case in list(self._cases.items()):
            if t_ns - case.t_ns > _FORGET_NS:
                del self._cases[vehicle]


def _evidence(sensor: Sensor, hit: bool, clutter: float, crowd: int) -> float:
    """How much a look speaks against a vehicle's being there."""
    p_d = min(float(sensor.detection_probability), MAX_DETECTION_PROBABILITY)
    p_else = -math.expm1(-clutter - p_d * crowd)
    p_there = 1.0 - (1.0 - p_d) * (1.0 - p_else)
    doubt = math.log(max(p_else, _TINY) / max(p_there, _TINY)) if hit else -math.log1p(-p_d)
    return min(max(doubt, -_MOST_OF_A_SCAN), _MOST_OF_A_SCAN)


def _looks_at(sensor: Sensor, places: FloatArray, S: FloatArray) -> FloatArray:
    """Whether a sensor sees all that is within three standard deviations of each place."""
    margin_m = 3.0 * np.sqrt(np.linalg.eigvalsh(S)[:, -1]) if len(places) else np.zeros(0)
    seen = np.ones(len(places), np.bool_)
    for east, north in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        seen &= covers(sensor, places + margin_m[:, None] * np.array([east, north]))
    return np.asarray(seen)


def _near(places: FloatArray, S: FloatArray, points: FloatArray) -> tuple[Indices, Indices]:
    """Which points (m, 2) are within the gates of which places (n, 2): (k,) places and (k,) points.

    A tree finds what is within the longest axis of each gate, so that not all pairs are looked at.
    """
    somewhere = np.flatnonzero(np.isfinite(points).all(axis=1))
    if not len(places) or not len(somewhere):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    reach_m = np.sqrt(_GATE_CHI2 * np.linalg.eigvalsh(S)[:, -1]) * (1.0 + 1e-9)
    found = cKDTree(points[somewhere]).query_ball_point(places, reach_m, return_sorted=True)
    rows = np.repeat(np.arange(len(places)), [len(row) for row in found])
    columns = somewhere[np.fromiter(chain.from_iterable(found), np.int64, len(rows))]
    x, y = (points[columns] - places[rows]).T
    s00, s01, s11 = S[rows, 0, 0], S[rows, 0, 1], S[rows, 1, 1]
    d2 = (s11 * x * x - 2.0 * s01 * x * y + s00 * y * y) / (s00 * s11 - s01 * s01)
    return rows[d2 <= _GATE_CHI2], columns[d2 <= _GATE_CHI2]
