"""Position reports as a sensor of agents: noise, clutter, detection probability; births where they report.

Reports are used at the time of each scan. A vehicle that reports away from all tracks and birth components
gets a birth there. While no sensor publishes, epochs of new reports alone update the agents' tracker. Silence
is no evidence of a loss in them.

A high-latency report (`gcs.mavlink.fleet.high_latency`) is used once, with its own noise. While a vehicle is
heard by such reports alone, silence is no evidence of a loss: they come every few seconds or minutes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gcs.config.schema import TelemetryTable
from gcs.core.perception.class_tracker import ClassTracker
from gcs.core.perception.mahalanobis import squared_distances
from gcs.core.perception.perception_state import TrackersState
from gcs.core.perception.tracking_model import birth
from gcs.model import NS_PER_S, FloatArray, Sensor, VehicleState, read_only
from gcs.tracking.glmb.filter import Birth

_NEAR_STD = 5.0
"""Gate, in standard deviations, between a report and a track or birth component."""
_REPORT_CLUTTER_PER_M2 = 1e-6
"""Clutter density of position reports."""
_REPORTS_ALONE_DETECTION = 0.01
"""Detection probability of reports without a sensor: a silent vehicle keeps its track."""
_HIGH_LATENCY_DETECTION = 1e-3
"""The same while a vehicle is heard by high-latency reports alone: minutes without one say nothing."""
_HIGH_LATENCY_CLUTTER_PER_M2 = 1e-9


class ReportSensor:
    """Position reports of all vehicles, for the tracker of agents."""

    def __init__(self, telemetry: TelemetryTable, state: TrackersState, agents: ClassTracker) -> None:
        self._telemetry = telemetry
        self._state = state
        self._agents = agents

    def is_due(self, t_ns: int) -> bool:
        """Return True if a report period has passed since reports were used."""
        period_ns = NS_PER_S / self._telemetry.rate_hz
        used_t_ns = self._state.reports_t_ns
        return used_t_ns < 0 or t_ns - used_t_ns >= 0.9 * period_ns

    def split(
        self,
        t_ns: int,
        states: Sequence[VehicleState],
        components: Sequence[Birth],
        *,
        alone: bool = False,
    ) -> tuple[list[Birth], list[tuple[Sensor, FloatArray]]]:
        """Return births of vehicles that report away from tracks and components, and the other positions.

        The positions are those of usual telemetry, with their sensor, then each high-latency report. There
        are none until a report period has passed: a report is used once. `alone` means that no sensor
        publishes.
        """
        if not self.is_due(t_ns):
            return [], []
        self._state.reports_t_ns = t_ns
        telemetry = self._telemetry
        usual = [s for s in states if not s.period_s and abs(t_ns - s.t_ns) <= telemetry.max_age_s * NS_PER_S]
        is_slow = any(state.period_s for state in states)
        detection = _REPORTS_ALONE_DETECTION if alone else telemetry.detection_probability
        sensor = _report_sensor(
            telemetry.noise_std_m, _HIGH_LATENCY_DETECTION if is_slow else detection, _REPORT_CLUTTER_PER_M2
        )
        births, positions = self._known_reports(t_ns, usual, components, telemetry.noise_std_m)
        reports = [(sensor, positions)]
        for state in self._new_slow_reports(t_ns, states):
            more, positions = self._known_reports(t_ns, [state], components, state.std_m)
            births += more
            sensor = _report_sensor(state.std_m, _HIGH_LATENCY_DETECTION, _HIGH_LATENCY_CLUTTER_PER_M2)
            reports.append((sensor, positions))
        return births, reports

    def _new_slow_reports(self, t_ns: int, states: Sequence[VehicleState]) -> list[VehicleState]:
        """Return the high-latency reports that were not used yet, and note them as used."""
        used = self._state.slow_reports_t_ns
        new = [
            state
            for state in states
            if state.period_s
            and abs(t_ns - state.t_ns) <= state.period_s * NS_PER_S
            and state.t_ns > used.get(state.system_id, -1)
        ]
        used.update({state.system_id: state.t_ns for state in new})
        return new

    def _known_reports(
        self, t_ns: int, states: Sequence[VehicleState], components: Sequence[Birth], std_m: float
    ) -> tuple[list[Birth], FloatArray]:
        """Return births of vehicles that report away from tracks and components, and the other positions."""
        positions = np.reshape([at_time(state, t_ns) for state in states], (-1, 2))
        is_known = self._are_known(positions, t_ns, components, std_m)
        births = [_report_birth(states[i], positions[i], std_m) for i in np.flatnonzero(~is_known).tolist()]
        return births, positions[is_known]

    def _are_known(
        self, positions: FloatArray, t_ns: int, components: Sequence[Birth], std_m: float
    ) -> npt.NDArray[np.bool_]:
        """Return a mask of the reports near a track or one of the birth components."""
        means, covs, _ = self._agents.expected(t_ns)
        means = np.concatenate([means, np.reshape([one.mean[:2] for one in components], (-1, 2))])
        covs = np.concatenate([covs, np.reshape([one.cov[:2, :2] for one in components], (-1, 2, 2))])
        S = covs + np.eye(2) * std_m**2
        return np.asarray((squared_distances(positions, means, S) <= _NEAR_STD**2).any(axis=1))


def _report_sensor(std_m: float, detection_probability: float, clutter_per_m2: float) -> Sensor:
    """Return position reports as a sensor that covers everything."""
    infinite = (-math.inf, -math.inf, math.inf, math.inf)
    cov_m2 = read_only(np.eye(2) * std_m**2)
    return Sensor("telemetry", detection_probability, clutter_per_m2, cov_m2, infinite)


def _report_birth(state: VehicleState, position: FloatArray, std_m: float) -> Birth:
    """Return the birth of a vehicle where it reports."""
    mean = (float(position[0]), float(position[1]), *velocity_m_s(state))
    return birth(mean, 2.0 * std_m, 2.0)


def at_time(state: VehicleState, t_ns: int) -> tuple[float, float]:
    """Return east and north of a vehicle at `t_ns`, from its report and reported velocity."""
    dt_s = (t_ns - state.t_ns) / NS_PER_S
    v_east, v_north = velocity_m_s(state)
    return state.east_m + v_east * dt_s, state.north_m + v_north * dt_s


def velocity_m_s(state: VehicleState) -> tuple[float, float]:
    """Return the reported east and north velocity."""
    return (
        state.ground_speed_m_s * math.sin(state.course_rad),
        state.ground_speed_m_s * math.cos(state.course_rad),
    )
