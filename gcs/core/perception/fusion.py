"""Fusion: two GLMB filters, for agents and targets, fed with scans of all sensors and with position reports.

Both filters get all detections. For each, objects of the other kind are clutter: the clutter intensity at a
detection is that of the sensor plus that of the other kind's tracks. With a uniform intensity, a lost agent
near its target would live on in the target's detections.

Position reports are a second sensor of agents, used at the time of each scan (`report_sensor`). Each filter
with its births and pictures is a `class_tracker`.

Each sensor announces its own noise, clutter, detection probability and field of view, and where it looks
from (`terrain_sight`); `gcs.tracking.models.sensor_estimation` compares its scans with them. Late and
repeated scans are refused, future ones by `scan_timing`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gcs.config import Config
from gcs.core.perception.class_tracker import ClassTracker
from gcs.core.perception.perception_state import TrackersState
from gcs.core.perception.report_sensor import ReportSensor
from gcs.core.perception.terrain_sight import TerrainSight
from gcs.core.perception.tracking_model import agent_births, target_births
from gcs.core.perception.untracked_detections import UntrackedDetections
from gcs.model import (
    NS_PER_S,
    LaggedPicture,
    Notice,
    NoticeCode,
    Picture,
    Scan,
    Sensor,
    VehicleState,
    read_only,
)
from gcs.tracking.models.sensor_estimation import Finding, SensorEstimation

_MIN_VARIANCE_M2 = 1e-4
"""Minimum variance of a detection: keeps covariances regular."""
_MIN_BEARING_STD_RAD = 1e-5
_MAX_SENSORS = 100
"""Maximum number of sensors whose models are estimated."""


class MultiSensorTracker:
    """Filters of agents and targets.

    Raises
    ------
    ValueError
        If the state is damaged.
    """

    def __init__(self, config: Config, state: TrackersState | None = None) -> None:
        self._config = config
        self.state = TrackersState() if state is None else state
        self._sight = TerrainSight(config)
        self.untracked = UntrackedDetections(config, self.state.untracked)
        self.agents = ClassTracker("agents", config, agent_births(config), self.state.agents)
        self.targets = ClassTracker("targets", config, target_births(config), self.state.targets)
        self._reports = ReportSensor(config.telemetry, self.state, self.agents)

    def refusal(self, scan: Scan) -> str:
        """Return why a scan cannot be processed; empty if it can."""
        last_t_ns = max(self.state.measured_t_ns, self._agents_t_ns)
        if scan.measured_t_ns < last_t_ns:
            behind_s = (last_t_ns - scan.measured_t_ns) / NS_PER_S
            last = "one" if last_t_ns == self.state.measured_t_ns else "position reports used"
            return f"measured {behind_s:.3f} s before the last {last}"
        is_new = scan.measured_t_ns > self.state.measured_t_ns
        if not is_new and scan.sensor.name in self.state.sensors_at_epoch:
            return "came twice"
        return self._sight.refusal(scan.sensor)

    def scan_of_agents(self, scan: Scan) -> Scan:
        """Return a scan as agents' detections: what terrain hides from its sensor is out of its view."""
        return self._sight.scan_of(scan, "agents")

    def scan(self, scan: Scan, states: Sequence[VehicleState]) -> tuple[Picture, Picture]:
        """Process one scan that is not refused; return the pictures of agents and targets."""
        t_ns = scan.measured_t_ns
        state = self.state
        if t_ns > state.measured_t_ns:
            state.measured_t_ns = t_ns
            state.sensors_at_epoch = []
        state.sensors_at_epoch.append(scan.sensor.name)
        estimation = self._estimation(scan.sensor.name)
        sensor = _with_noise(scan.sensor)
        if self._config.tracking.correct_sensors:
            sensor = estimation.corrected(sensor)
        others = (one for one in state.estimations.values() if one is not estimation)
        sensor = estimation.bounded(
            sensor, t_ns, is_shared=any(one.looks_there(sensor, t_ns) for one in others)
        )
        scan = replace(scan, sensor=sensor)
        # Terrain hides agents and targets in different places, and moves slant ranges differently.
        at_agents = self._sight.scan_of(scan, "agents")
        at_targets = self._sight.scan_of(scan, "targets")
        report_births, reports = self._reports.split(t_ns, states, self.agents.births)
        of_targets = self.targets.intensity(t_ns, at_targets.z_m, at_targets.sensor)
        ours = self.agents.update(t_ns, at_agents.z_m, at_agents.sensor, of_targets, report_births)
        for report_sensor, positions in reports:
            self.agents.update_again(t_ns, positions, report_sensor)
        agents = self.agents.extract(scan.t_ns, None if reports else at_agents.sensor)
        of_agents = self.agents.intensity(t_ns, at_agents.z_m, at_agents.sensor)
        theirs = self.targets.update(t_ns, at_targets.z_m, at_targets.sensor, of_agents)
        explained = 1.0 - (1.0 - ours.explained) * (1.0 - theirs.explained)
        self.agents.unknown.add_scan(t_ns, at_agents.z_m, at_agents.sensor, explained)
        persist = self.untracked.add_scan(t_ns, at_targets.z_m, at_targets.sensor, explained)
        self.targets.unknown.add_scan(t_ns, at_targets.z_m, at_targets.sensor, explained, is_sure=persist)
        detected = ours.detected + theirs.detected
        in_view = ours.in_view + theirs.in_view
        estimation.add_scan(float((1.0 - explained).sum()), detected, in_view)
        targets = self.targets.extract(scan.t_ns, at_targets.sensor)
        if len(state.estimations) > 1:
            confirmed = [
                *self.agents.confirmation.tracks.values(),
                *self.targets.confirmation.tracks.values(),
            ]
            state.contradictions.update("agents", at_agents, agents.tracks, confirmed)
            state.contradictions.update("targets", at_targets, targets.tracks, confirmed)
        return agents, targets

    def lagged_pictures(self, t_ns: int) -> list[LaggedPicture]:
        """Return the pictures of some scans ago, after `scan`."""
        return [*self.agents.lagged(t_ns), *self.targets.lagged(t_ns)]

    def is_report_epoch_due(self, t_ns: int) -> bool:
        """Return True if an epoch of position reports alone may follow at `t_ns`."""
        return t_ns > self._agents_t_ns and self._reports.is_due(t_ns)

    def report_epoch(self, t_ns: int, measured_t_ns: int, states: Sequence[VehicleState]) -> list[Picture]:
        """Process the reports since the last epoch as one at `measured_t_ns`; return the picture of agents.

        There is none without such a report.
        """
        used_t_ns = self.state.reports_t_ns
        if all(state.t_ns < used_t_ns for state in states):
            return []
        kept = [state for state in states if state.period_s or state.t_ns >= used_t_ns]
        births, reports = self._reports.split(measured_t_ns, kept, (), alone=True)
        if not reports:
            return []
        (sensor, positions), *others = reports
        self.agents.update_by_reports(measured_t_ns, positions, sensor, births)
        for sensor, positions in others:
            self.agents.update_again(measured_t_ns, positions, sensor)
        return [self.agents.extract(t_ns, None)]

    @property
    def _agents_t_ns(self) -> int:
        """Time of the agents' tracker: of the last scan, or of later reports alone."""
        t_ns = self.state.agents.filter.t_ns
        return -1 if t_ns is None else t_ns

    def notices(self, scan: Scan) -> list[Notice]:
        """Return notices about a processed scan's sensor, other sensors, and untracked detections."""
        findings = self._estimation(scan.sensor.name).findings(scan.sensor)
        notices = [_finding_notice(scan, one) for one in findings]
        pictures = [one.picture for one in (self.agents, self.targets) if one.picture is not None]
        tracks = [(picture.kind, track) for picture in pictures for track in picture.tracks]
        notices += self.state.contradictions.notices(scan.t_ns, tracks)
        return notices + self.untracked.notices(scan.t_ns)

    def _estimation(self, sensor: str) -> SensorEstimation:
        """Return the estimated model of a sensor; the number of sensors is bounded."""
        estimations = self.state.estimations
        estimations[sensor] = found = estimations.pop(sensor, None) or SensorEstimation()
        if len(estimations) > _MAX_SENSORS:
            del estimations[next(iter(estimations))]
        return found


def _with_noise(sensor: Sensor) -> Sensor:
    """Return the sensor with an invertible noise."""
    if sensor.polar is not None:
        range_std_m = max(sensor.polar.range_std_m, math.sqrt(_MIN_VARIANCE_M2))
        bearing_std_rad = max(sensor.polar.bearing_std_rad, _MIN_BEARING_STD_RAD)
        return replace(
            sensor, polar=replace(sensor.polar, range_std_m=range_std_m, bearing_std_rad=bearing_std_rad)
        )
    if np.linalg.eigvalsh(sensor.noise_cov_m2)[0] >= _MIN_VARIANCE_M2:
        return sensor
    return replace(sensor, noise_cov_m2=read_only(sensor.noise_cov_m2 + np.eye(2) * _MIN_VARIANCE_M2))


_FINDING_CODES: Final = {
    ("clutter", True): NoticeCode.CLUTTER_WRONG,
    ("clutter", False): NoticeCode.CLUTTER_RIGHT,
    ("detection", True): NoticeCode.DETECTION_WRONG,
    ("detection", False): NoticeCode.DETECTION_RIGHT,
}


def _finding_notice(scan: Scan, finding: Finding) -> Notice:
    """Return the notice that a sensor's announced values contradict its scans, or no longer do."""
    code = _FINDING_CODES[finding.quantity, finding.is_contradiction]
    values = {"estimated": finding.estimated, "announced": finding.announced}
    return Notice(scan.t_ns, code, scan.sensor.name, values)
