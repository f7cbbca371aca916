"""Two GLMB filters, for agents and targets, fed with scans of all sensors and with position reports.

Both filters get all detections. For each, objects of the other kind are clutter: the clutter intensity at a
detection is that of the sensor plus that of the other kind's tracks. With a uniform intensity, a lost agent
near its target would live on in the target's detections.

Position reports are a second sensor of agents, used at the time of each scan. A vehicle that reports away
from all tracks and birth components gets a birth there. While no sensor publishes, epochs of new reports
alone update the agents' tracker. Silence is no evidence of a loss in them.

A birth component has `BIRTH_PROBABILITY` until its object is confirmed, then `BIRTH_AGAIN_PROBABILITY`. With
a rate in `tracking.<kind>.anywhere`, objects are also born at detections that no track explains
(`gcs.tracking.models.adaptive_birth`).

A high-latency report (`gcs.mavlink.fleet.high_latency`) is used once, with its own noise. While a vehicle is
heard by such reports alone, silence is no evidence of a loss: they come every few seconds or minutes.

Each sensor announces its own noise, clutter, detection probability and field of view, and where it looks
from (`terrain_sight`);
`gcs.tracking.models.sensor_estimation` compares its scans with them. Late, repeated and future scans are
refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from gcs.config import Config
from gcs.core.perception.perception_state import TrackersState, TrackerState
from gcs.core.perception.terrain_sight import TerrainSight
from gcs.core.perception.track_lifecycle import TrackConfirmation
from gcs.core.perception.tracking_model import (
    BIRTH_AGAIN_PROBABILITY,
    agent_births,
    birth,
    glmb_params,
    target_births,
)
from gcs.core.perception.untracked_detections import UntrackedDetections
from gcs.model import (
    NS_PER_S,
    FloatArray,
    Kind,
    LaggedPicture,
    Notice,
    NoticeCode,
    Picture,
    Scan,
    Sensor,
    Track,
    VehicleState,
    read_only,
)
from gcs.tracking.glmb.filter import Birth, DetectionSummary, Glmb
from gcs.tracking.models.adaptive_birth import AdaptiveBirth
from gcs.tracking.models.clutter import intensity_per_m2
from gcs.tracking.models.constant_velocity import transition
from gcs.tracking.models.sensor_estimation import Finding, SensorEstimation
from gcs.tracking.models.sensor_geometry import clutter_per_m2, covers, noise_m2

_NEAR_STD = 5.0
"""Gate, in standard deviations, between a report and a track or birth component."""
_REPORT_CLUTTER_PER_M2 = 1e-6
"""Clutter density of position reports."""
_REPORTS_ALONE_DETECTION = 0.01
"""Detection probability of reports without a sensor: a silent vehicle keeps its track."""
_HIGH_LATENCY_DETECTION = 1e-3
"""The same while a vehicle is heard by high-latency reports alone: minutes without one say nothing."""
_HIGH_LATENCY_CLUTTER_PER_M2 = 1e-9
_MAX_AHEAD_S = 1.0
"""Maximum time from arrival to measurement: clocks may differ this much."""
_MIN_VARIANCE_M2 = 1e-4
"""Minimum variance of a detection: keeps covariances regular."""
_MIN_BEARING_STD_RAD = 1e-5
_MAX_SENSORS = 100
"""Maximum number of sensors whose models are estimated."""


class ClassTracker:
    """One filter with its birth components and confirmed tracks.

    Raises
    ------
    ValueError
        If the state is damaged.
    """

    def __init__(self, kind: Kind, config: Config, births: Sequence[Birth], state: TrackerState) -> None:
        tracking = config.tracking
        table = tracking.agents if kind == "agents" else tracking.targets
        params = glmb_params(tracking, table.accel_psd_m2_s3, table.turn_rate_std_deg_s)
        self.kind = kind
        self.births = births
        self._state = state
        self._components_again = [replace(one, probability=BIRTH_AGAIN_PROBABILITY) for one in births]
        self._components_closed = [replace(one, probability=0.0) for one in births]
        state.is_born = state.is_born or [False] * len(births)
        if len(state.is_born) != len(births):
            raise ValueError("tracker state: is_born is not valid")
        self._process_noise = params.process_noise
        self._turn_rate_std_rad_s = math.radians(table.turn_rate_std_deg_s)
        lag = tracking.lag_scans
        self._filter = Glmb(kind, params, 0, summarise_detections=True, lag=lag, state=state.filter)
        scan_t_ns = state.filter.t_ns
        self.picture = None if scan_t_ns is None else self._filter.picture(scan_t_ns)
        tracks = () if self.picture is None else self.picture.tracks
        self.confirmation = TrackConfirmation(tracking.lost_existence, state.confirmation, tracks)
        anywhere = table.anywhere
        self.unknown = AdaptiveBirth(
            anywhere.per_s,
            anywhere.speed_std_m_s,
            anywhere.max_probability,
            self._process_noise,
            state.adaptive_birth,
        )

    def update(
        self, t_ns: int, z_m: FloatArray, sensor: Sensor, others: FloatArray, births: Sequence[Birth] = ()
    ) -> DetectionSummary:
        """Process one scan, with births in addition to the birth components.

        `others` (m,) is the intensity of the other kind's objects at each detection, per m2.
        """
        clutter = clutter_per_m2(sensor, z_m) + others
        components = self._components(t_ns, sensor)
        self._filter.update(t_ns, z_m, sensor, [*components, *births, *self.unknown.births(t_ns)], clutter)
        assert self._filter.detection_summary is not None
        return self._filter.detection_summary

    def _components(self, t_ns: int, sensor: Sensor) -> list[Birth]:
        """Return the birth components of a scan: once per epoch, where the sensor covers them.

        Without coverage unmissed births would add up. Position reports cover agents everywhere. The other
        components get probability 0, so that labels keep their indices.
        """
        means = np.reshape([birth.mean[:2] for birth in self.births], (-1, 2))
        is_open = covers(sensor, means) | (self.kind == "agents")
        is_open &= t_ns > self._state.born_t_ns
        self._state.born_t_ns = t_ns
        return [
            (again if is_born else first) if is_open_now else closed
            for first, again, closed, is_born, is_open_now in zip(
                self.births,
                self._components_again,
                self._components_closed,
                self._state.is_born,
                is_open.tolist(),
                strict=True,
            )
        ]

    def update_by_reports(self, t_ns: int, z_m: FloatArray, sensor: Sensor, births: Sequence[Birth]) -> None:
        """Process an epoch of position reports alone, with births at reports only.

        No miss would end the objects of the other components.
        """
        self._filter.update(t_ns, z_m, sensor, [*self._components_closed, *births])

    def update_again(self, t_ns: int, z_m: FloatArray, sensor: Sensor) -> None:
        """Process another sensor's scan of the same epoch, without births."""
        self._filter.update(t_ns, z_m, sensor)

    def expected(self, t_ns: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the tracks of the last picture, predicted to `t_ns`.

        Positions (n, 2), their covariances (n, 2, 2), existence probabilities (n,).
        """
        tracks = () if self.picture is None else self.picture.tracks
        dt_s = 0.0 if self.picture is None else max(0.0, (t_ns - self.picture.scan_t_ns) / NS_PER_S)
        F = transition(dt_s)
        Q = self._process_noise(dt_s)
        means = np.reshape([track.mean for track in tracks], (-1, 4)) @ F.T
        covs = F @ np.reshape([track.cov for track in tracks], (-1, 4, 4)) @ F.T + Q
        # The picture has no turn rates: the offset of a turn adds to the covariance.
        offset_m = 0.5 * dt_s**2 * self._turn_rate_std_rad_s * np.hypot(means[:, 2], means[:, 3])
        covs[:, [0, 1], [0, 1]] += np.square(offset_m)[:, None]
        existence = np.array([track.existence for track in tracks])
        return np.ascontiguousarray(means[:, :2]), np.ascontiguousarray(covs[:, :2, :2]), existence

    def intensity(self, t_ns: int, z_m: FloatArray, sensor: Sensor) -> FloatArray:
        """Return the intensity of this kind's detections at each of `z_m` (m, 2), per m2."""
        means, covs, existence = self.expected(t_ns)
        points = np.array(z_m, order="C")
        noise = np.array(noise_m2(sensor, z_m), order="C")
        intensity = intensity_per_m2(means, covs, existence, points, noise)
        return np.asarray(sensor.detection_probability * intensity)

    def extract(self, t_ns: int, sensor: Sensor | None) -> Picture:
        """Return the picture after a scan; update confirmation and birth probabilities.

        `sensor` is the sensor of the scan; None: position reports came too, which cover everything.
        """
        self.picture = self._filter.picture(t_ns)
        self.confirmation.update(self.picture, sensor)
        for _, index in self.confirmation.tracks:
            if index < len(self.births):
                self._state.is_born[index] = True
        return self.picture

    def lagged(self, t_ns: int) -> list[LaggedPicture]:
        """Return the picture of some scans ago, after `extract`; none before there are enough scans."""
        found = self._filter.lag_estimates()
        if found is None or self.picture is None:
            return []
        existence = {track.label: track.existence for track in self.picture.tracks}
        tracks = tuple(
            Track((born, index), read_only(mean), read_only(cov), existence[born, index], estimated=True)
            for (born, index), mean, cov in zip(found.label.tolist(), found.mean, found.cov, strict=True)
        )
        return [LaggedPicture(t_ns, found.t_ns, self.kind, tracks)]


class MultiSensorTracker:
    """Filters of agents and targets.

    Raises
    ------
    ValueError
        If the state is damaged.
    """

    def __init__(self, config: Config, state: TrackersState | None = None) -> None:
        self._config = config
        self._telemetry = config.telemetry
        self.state = TrackersState() if state is None else state
        self._sight = TerrainSight(config)
        self.untracked = UntrackedDetections(config, self.state.untracked)
        self.agents = ClassTracker("agents", config, agent_births(config), self.state.agents)
        self.targets = ClassTracker("targets", config, target_births(config), self.state.targets)

    def refusal(self, scan: Scan) -> str:
        """Return why a scan cannot be processed; empty if it can."""
        ahead_s = (scan.measured_t_ns - scan.t_ns) / NS_PER_S
        if ahead_s > _MAX_AHEAD_S:
            return f"measured {ahead_s:.1f} s after it arrived"
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
        sensor = estimation.bounded(sensor, t_ns)
        scan = replace(scan, sensor=sensor)
        # Terrain hides agents and targets in different places, and moves slant ranges differently.
        at_agents = self._sight.scan_of(scan, "agents")
        at_targets = self._sight.scan_of(scan, "targets")
        report_births, reports = self._reports(t_ns, states, self.agents.births)
        of_targets = self.targets.intensity(t_ns, at_targets.z_m, at_targets.sensor)
        ours = self.agents.update(t_ns, at_agents.z_m, at_agents.sensor, of_targets, report_births)
        for report_sensor, positions in reports:
            self.agents.update_again(t_ns, positions, report_sensor)
        agents = self.agents.extract(scan.t_ns, None if reports else at_agents.sensor)
        of_agents = self.agents.intensity(t_ns, at_agents.z_m, at_agents.sensor)
        theirs = self.targets.update(t_ns, at_targets.z_m, at_targets.sensor, of_agents)
        explained = 1.0 - (1.0 - ours.explained) * (1.0 - theirs.explained)
        for kind, seen in ((self.agents, at_agents), (self.targets, at_targets)):
            kind.unknown.add_scan(t_ns, seen.z_m, seen.sensor, explained)
        self.untracked.add_scan(t_ns, at_targets.z_m, at_targets.sensor, explained)
        detected = ours.detected + theirs.detected
        in_view = ours.in_view + theirs.in_view
        estimation.add_scan(float((1.0 - explained).sum()), detected, in_view)
        return agents, self.targets.extract(scan.t_ns, at_targets.sensor)

    def lagged_pictures(self, t_ns: int) -> list[LaggedPicture]:
        """Return the pictures of some scans ago, after `scan`."""
        return [*self.agents.lagged(t_ns), *self.targets.lagged(t_ns)]

    def is_report_epoch_due(self, t_ns: int) -> bool:
        """Return True if an epoch of position reports alone may follow at `t_ns`."""
        return t_ns > self._agents_t_ns and self._are_reports_due(t_ns)

    def report_epoch(self, t_ns: int, measured_t_ns: int, states: Sequence[VehicleState]) -> list[Picture]:
        """Process the reports since the last epoch as one at `measured_t_ns`; return the picture of agents.

        There is none without such a report.
        """
        used_t_ns = self.state.reports_t_ns
        if all(state.t_ns < used_t_ns for state in states):
            return []
        kept = [state for state in states if state.period_s or state.t_ns >= used_t_ns]
        births, reports = self._reports(measured_t_ns, kept, (), alone=True)
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
        """Return notices about the model of a processed scan's sensor, and about untracked detections."""
        findings = self._estimation(scan.sensor.name).findings(scan.sensor)
        notices = [_finding_notice(scan, one) for one in findings]
        return notices + self.untracked.notices(scan.t_ns)

    def _estimation(self, sensor: str) -> SensorEstimation:
        """Return the estimated model of a sensor; the number of sensors is bounded."""
        estimations = self.state.estimations
        estimations[sensor] = found = estimations.pop(sensor, None) or SensorEstimation()
        if len(estimations) > _MAX_SENSORS:
            del estimations[next(iter(estimations))]
        return found

    def _are_reports_due(self, t_ns: int) -> bool:
        period_ns = NS_PER_S / self._telemetry.rate_hz
        used_t_ns = self.state.reports_t_ns
        return used_t_ns < 0 or t_ns - used_t_ns >= 0.9 * period_ns

    def _reports(
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
        if not self._are_reports_due(t_ns):
            return [], []
        self.state.reports_t_ns = t_ns
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
        used = self.state.slow_reports_t_ns
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
        means, covs, _ = self.agents.expected(t_ns)
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


def squared_distances(points: FloatArray, means: FloatArray, S: FloatArray) -> FloatArray:
    """Return squared Mahalanobis distances (m, n) of points (m, 2) from means (n, 2) under S (n, 2, 2)."""
    x = points[:, :1] - means[:, 0]
    y = points[:, 1:] - means[:, 1]
    s00 = S[:, 0, 0]
    s01 = S[:, 0, 1]
    s11 = S[:, 1, 1]
    with np.errstate(invalid="ignore", over="ignore"):  # NaN positions are near nothing
        return np.asarray((s11 * x * x - 2.0 * s01 * x * y + s00 * y * y) / (s00 * s11 - s01 * s01))


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
