"""The two GLMB filters and what they are given: every scan, births at known places, and agents' own reports.

Both filters get all detections of a sensor, as in the paper: the other kind's objects are clutter to each.
We say how much: the clutter intensity at a detection is the sensor's plus that of the other kind's tracks
there. With a uniform intensity an agent that dies beside its target lives on in the target's detections,
and an agent that loiters at a place of birth looks like a target born there. MAVLink position reports are a
second sensor of the agents, used at the moment of each scan: detections without clutter to speak of, seen
only where a vehicle reports. A vehicle that reports where no track and no place of birth is gets a birth
there, so that an agent lost by mistake comes back.

A place gives birth with `birth_probability` each scan until an object of it is believed, and with
`birth_again_probability` from then on: one object is expected of each, and clutter near a place that has
given its own must not look like another.

Where `tracking.<kind>.anywhere` gives a rate, objects are also born at detections that neither filter
explains (see `tracking.births`).

Scans come from outside, of any number of sensors, each with its own word on noise, clutter, detection and
field of view; `tracking.calibration` holds the stream against that word. One that is late, repeated or ahead
of its time is refused (`MultiSensorTracker.refusal`): worked in, it would count as one more scan of what is
known already, and a single time stamp hours ahead would outlive every track. A sensor that announces no noise
at all is not believed to the last millimetre.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gcs.config import Config
from gcs.config.tables import KindTracking
from gcs.core.perception.confirmation import TrackConfirmation
from gcs.core.perception.untracked_detections import Untracked
from gcs.model import NS_PER_S, FloatArray, Kind, Label, Picture, Scan, Sensor, Track, VehicleState, read_only
from gcs.tracking.glmb.filter import Birth, DetectionSummary, Glmb, GlmbParams
from gcs.tracking.models.adaptive_birth import AdaptiveBirth
from gcs.tracking.models.clutter import intensity_per_m2
from gcs.tracking.models.constant_velocity import process_noise, transition
from gcs.tracking.models.sensor_estimation import Finding, SensorEstimation
from gcs.tracking.models.sensors import clutter_per_m2, covers, noise_m2

_NEAR_STD = 5.0
"""A report within this many standard deviations of a track or a place of birth is taken for that object."""
_MAX_AHEAD_S = 1.0
"""A scan that says it was measured longer after its arrival than clocks may differ is refused."""
_LEAST_VARIANCE_M2 = 1e-4
"""Of a detection: without any, covariances become singular."""
_LEAST_BEARING_STD_RAD = 1e-5
_MOST_SENSORS = 100
"""Whose word is held against their stream."""


class ClassTracker:
    """One filter with its places of birth and what is believed of its tracks."""

    def __init__(
        self, kind: Kind, config: Config, table: KindTracking, places: list[Birth], seed: int
    ) -> None:
        tracking, accel_std_m_s2 = config.tracking, math.sqrt(table.accel_psd_m2_s3)
        params = GlmbParams(
            survival_probability_per_s=tracking.survival_probability_per_s,
            accel_std_m_s2=accel_std_m_s2,
            turn_rate_std_rad_s=math.radians(table.turn_rate_std_deg_s),
            turn_time_s=table.turn_time_s,
            max_hypotheses=tracking.max_hypotheses,
            gate_chi2=tracking.gate_chi2,
            lost_std_m=tracking.lost_std_m,
        )
        self.confirmation = TrackConfirmation(tracking.lost_existence)
        self.kind = kind
        self.picture: Picture | None = None
        self.places = places
        self._born_t_ns = -1
        self._accel_std_m_s2 = accel_std_m_s2
        self._turn_rate_std_rad_s = math.radians(table.turn_rate_std_deg_s)
        self._again_probability = table.birth_again_probability
        self._filter = Glmb(kind, params, seed, summarise_detections=True)
        anywhere = table.anywhere
        self.unknown = AdaptiveBirth(
            anywhere.per_s, anywhere.speed_std_m_s, anywhere.max_probability, accel_std_m_s2
        )

    def update(
        self, t_ns: int, z_m: FloatArray, sensor: Sensor, others: FloatArray, births: Sequence[Birth] = ()
    ) -> DetectionSummary:
        """Work one scan, with births at the known places and at those given.

        `others` (m,) is the intensity of the other kind's detections at each detection, per m2: clutter to
        this kind. Returns what this kind's tracks make of the detections.
        """
        clutter = clutter_per_m2(sensor, z_m) + others
        places = self._places_now(t_ns, sensor)
        self._filter.update(t_ns, z_m, sensor, [*places, *births, *self.unknown.births(t_ns)], clutter)
        assert self._filter.detection_summary is not None
        return self._filter.detection_summary

    def _places_now(self, t_ns: int, sensor: Sensor) -> list[Birth]:
        """Places give birth once a moment, and where somebody looks: else what is never missed would add up.

        Reports come from everywhere, so agents are looked at everywhere. The other places keep their numbers.
        """
        means = np.reshape([place.mean[:2] for place in self.places], (-1, 2))
        looked_at = covers(sensor, means) | (self.kind == "agents")
        looked_at &= t_ns > self._born_t_ns
        self._born_t_ns = t_ns
        return [
            place if is_open else replace(place, probability=0.0)
            for place, is_open in zip(self.places, looked_at, strict=True)
        ]

    def update_again(self, t_ns: int, z_m: FloatArray, sensor: Sensor) -> None:
        """Work another sensor's scan of the same moment: nothing is born in between."""
        self._filter.update(t_ns, z_m, sensor)

    def expected(self, t_ns: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the tracks of the last picture, moved on to `t_ns`.

        Positions (n, 2), their covariances (n, 2, 2), existence probabilities (n,).
        """
        tracks = () if self.picture is None else self.picture.tracks
        dt_s = 0.0 if self.picture is None else max(0.0, (t_ns - self.picture.scan_t_ns) / NS_PER_S)
        F, Q = transition(dt_s), process_noise(dt_s, self._accel_std_m_s2)
        means = np.reshape([track.mean for track in tracks], (-1, 4)) @ F.T
        covs = F @ np.reshape([track.cov for track in tracks], (-1, 4, 4)) @ F.T + Q
        # The picture does not say who is turning: a turn's offset from straight ahead adds to the spread.
        offset_m = 0.5 * dt_s**2 * self._turn_rate_std_rad_s * np.hypot(means[:, 2], means[:, 3])
        covs[:, [0, 1], [0, 1]] += np.square(offset_m)[:, None]
        existence = np.array([track.existence for track in tracks])
        return np.ascontiguousarray(means[:, :2]), np.ascontiguousarray(covs[:, :2, :2]), existence

    def intensity(self, t_ns: int, z_m: FloatArray, sensor: Sensor) -> FloatArray:
        """Intensity of detections of this kind's objects at each of `z_m` (m, 2), per m2."""
        means, covs, existence = self.expected(t_ns)
        places, noise = np.array(z_m, order="C"), np.array(noise_m2(sensor, z_m), order="C")
        seen = intensity_per_m2(means, covs, existence, places, noise)
        return np.asarray(sensor.detection_probability * seen)

    def look(self, t_ns: int, sensor: Sensor | None) -> Picture:
        """Return the picture, and follow what it says about confirmation and places.

        `sensor` is the only one that looked; None when everything was looked at, as reports come from
        everywhere.
        """
        self.picture = self._filter.picture(t_ns)
        self.confirmation.update(self.picture, sensor)
        for _, index in self.confirmation.tracks:
            if index < len(self.places):
                self.places[index] = replace(self.places[index], probability=self._again_probability)
        return self.picture


class MultiSensorTracker:
    """Agents' and targets' filters, updated scan by scan.

    Parameters
    ----------
    config : Config
        Gives the models, the agents' starts and the targets' places of birth.
    """

    def __init__(self, config: Config) -> None:
        tracking = config.tracking
        self._telemetry = config.telemetry
        starts = [
            _birth(
                (agent.east_m, agent.north_m, 0.0, 0.0),
                tracking.agent_birth_std_m,
                tracking.agent_birth_speed_std_m_s,
                tracking.agents.birth_probability,
            )
            for agent in config.agents
        ]
        places = [
            _birth(
                (birth.east_m, birth.north_m, birth.v_east_m_s, birth.v_north_m_s),
                birth.std_m,
                birth.speed_std_m_s,
                tracking.targets.birth_probability,
            )
            for birth in config.births
        ]
        self._target_table = tracking.targets
        self._report_birth_probability = tracking.agents.birth_probability
        self._measured_t_ns = -1
        self._sensors_then: set[str] = set()
        self._reports_t_ns = -1
        self._calibrations: dict[str, SensorEstimation] = {}
        self._corrects = tracking.correct_sensors
        self.findings: list[Finding] = []
        """News of the last scan about whether its sensor is what it says."""
        self.untracked = Untracked(config)
        self.agents = ClassTracker("agents", config, tracking.agents, starts, tracking.seed)
        self.targets = ClassTracker("targets", config, tracking.targets, places, tracking.seed + 1)

    def expect(self, targets: Sequence[Track], age_s: float) -> dict[int, Label]:
        """Expect targets where they were believed to be `age_s` ago, before anything was seen.

        Returns the label that each had by the second part of the label that it will have.
        """
        table, tracker = self._target_table, self.targets
        gave_birth = {index for _, index in (track.label for track in targets)}
        tracker.places = [
            replace(place, probability=table.birth_again_probability) if index in gave_birth else place
            for index, place in enumerate(tracker.places)
        ]
        first = len(tracker.places)
        tracker.places += [
            Birth(track.mean, track.cov, table.birth_probability) for track in self.moved_on(targets, age_s)
        ]
        return {first + number: track.label for number, track in enumerate(targets)}

    def moved_on(self, targets: Sequence[Track], age_s: float) -> tuple[Track, ...]:
        """Return targets as they should be `age_s` later, unseen."""
        F, Q = transition(age_s), process_noise(age_s, math.sqrt(self._target_table.accel_psd_m2_s3))
        return tuple(
            replace(track, mean=read_only(F @ track.mean), cov=read_only(F @ track.cov @ F.T + Q))
            for track in targets
        )

    def refusal(self, scan: Scan) -> str:
        """Say why a scan cannot be worked in; empty when it can."""
        ahead_s = (scan.measured_t_ns - scan.t_ns) / NS_PER_S
        if ahead_s > _MAX_AHEAD_S:
            return f"measured {ahead_s:.1f} s after it arrived"
        if scan.measured_t_ns < self._measured_t_ns:
            behind_s = (self._measured_t_ns - scan.measured_t_ns) / NS_PER_S
            return f"measured {behind_s:.3f} s before the last one"
        if scan.measured_t_ns == self._measured_t_ns and scan.sensor.name in self._sensors_then:
            return "came twice"
        return ""

    def scan(self, scan: Scan, states: Sequence[VehicleState]) -> tuple[Picture, Picture]:
        """Work one scan that is not refused into both filters; return the pictures of agents and targets."""
        t_ns = scan.measured_t_ns
        if t_ns > self._measured_t_ns:
            self._measured_t_ns, self._sensors_then = t_ns, set()
        self._sensors_then.add(scan.sensor.name)
        calibration = self._calibration(scan.sensor.name)
        sensor = _with_noise(scan.sensor)
        if self._corrects:
            sensor = calibration.corrected(sensor)
        newcomers, reports = self._reports(t_ns, states)
        of_targets = self.targets.intensity(t_ns, scan.z_m, sensor)
        ours = self.agents.update(t_ns, scan.z_m, sensor, of_targets, newcomers)
        if reports is not None:
            self.agents.update_again(t_ns, reports, self._telemetry_sensor())
        agents = self.agents.look(scan.t_ns, sensor if reports is None else None)
        of_agents = self.agents.intensity(t_ns, scan.z_m, sensor)
        theirs = self.targets.update(t_ns, scan.z_m, sensor, of_agents)
        explained = 1.0 - (1.0 - ours.explained) * (1.0 - theirs.explained)
        for kind in (self.agents, self.targets):
            kind.unknown.add_scan(t_ns, scan.z_m, sensor, explained)
        self.untracked.take(t_ns, scan.z_m, sensor, explained)
        detected, in_view = ours.detected + theirs.detected, ours.in_view + theirs.in_view
        calibration.add_scan(float((1.0 - explained).sum()), detected, in_view)
        self.findings = calibration.findings(scan.sensor)
        return agents, self.targets.look(scan.t_ns, sensor)

    def _calibration(self, sensor: str) -> SensorEstimation:
        """Return what is known of a sensor; a stream of invented names does not fill the memory."""
        known = self._calibrations.pop(sensor, None) or SensorEstimation()
        self._calibrations[sensor] = known
        if len(self._calibrations) > _MOST_SENSORS:
            del self._calibrations[next(iter(self._calibrations))]
        return known

    def _reports(self, t_ns: int, states: Sequence[VehicleState]) -> tuple[list[Birth], FloatArray | None]:
        """Births of vehicles that report from where nobody is known, and where the others say they are.

        None in place of those when it is too soon for new reports: with several sensors, a report that was
        used a moment ago is no second measurement.
        """
        period_ns = NS_PER_S / self._telemetry.rate_hz
        if self._reports_t_ns >= 0 and t_ns - self._reports_t_ns < 0.9 * period_ns:
            return [], None
        self._reports_t_ns = t_ns
        fresh = [s for s in states if abs(t_ns - s.t_ns) <= self._telemetry.max_age_s * NS_PER_S]
        places = np.reshape([at_time(state, t_ns) for state in fresh], (-1, 2))
        known = self._are_known(places, t_ns)
        newcomers = [self._report_birth(fresh[i], places[i]) for i in np.flatnonzero(~known)]
        return newcomers, places[known]

    def _telemetry_sensor(self) -> Sensor:
        t = self._telemetry
        infinite = (-math.inf, -math.inf, math.inf, math.inf)
        return Sensor(
            "telemetry",
            t.detection_probability,
            t.clutter_density_per_m2,
            read_only(np.eye(2) * t.noise_std_m**2),
            infinite,
        )

    def _report_birth(self, state: VehicleState, place: FloatArray) -> Birth:
        std_m = 2.0 * self._telemetry.noise_std_m
        mean = (float(place[0]), float(place[1]), *velocity_m_s(state))
        return _birth(mean, std_m, 2.0, self._report_birth_probability)

    def _are_known(self, places: FloatArray, t_ns: int) -> npt.NDArray[np.bool_]:
        """Whether each report falls onto a track or a place of birth: then it needs no birth of its own."""
        means, covs, _ = self.agents.expected(t_ns)
        births = self.agents.places
        means = np.concatenate([means, [birth.mean[:2] for birth in births]])
        covs = np.concatenate([covs, [birth.cov[:2, :2] for birth in births]])
        S = covs + np.eye(2) * self._telemetry.noise_std_m**2
        return np.asarray((squared_distances(places, means, S) <= _NEAR_STD**2).any(axis=1))


def at_time(state: VehicleState, t_ns: int) -> tuple[float, float]:
    """East and north of a vehicle at `t_ns`, from its last report and its reported velocity."""
    dt_s = (t_ns - state.t_ns) / NS_PER_S
    v_east, v_north = velocity_m_s(state)
    return state.east_m + v_east * dt_s, state.north_m + v_north * dt_s


def velocity_m_s(state: VehicleState) -> tuple[float, float]:
    """East and north velocity that a vehicle reports."""
    return (
        state.ground_speed_m_s * math.sin(state.course_rad),
        state.ground_speed_m_s * math.cos(state.course_rad),
    )


def squared_distances(places: FloatArray, means: FloatArray, S: FloatArray) -> FloatArray:
    """Squared Mahalanobis distances (m, n) of places (m, 2) from means (n, 2) under S (n, 2, 2)."""
    x, y = places[:, :1] - means[:, 0], places[:, 1:] - means[:, 1]
    s00, s01, s11 = S[:, 0, 0], S[:, 0, 1], S[:, 1, 1]
    with np.errstate(invalid="ignore", over="ignore"):  # NaN for what is nowhere: near to nothing
        return np.asarray((s11 * x * x - 2.0 * s01 * x * y + s00 * y * y) / (s00 * s11 - s01 * s01))


def _with_noise(sensor: Sensor) -> Sensor:
    """Return the sensor with a noise that can be inverted."""
    if sensor.polar is not None:
        range_std_m = max(sensor.polar.range_std_m, math.sqrt(_LEAST_VARIANCE_M2))
        bearing_std_rad = max(sensor.polar.bearing_std_rad, _LEAST_BEARING_STD_RAD)
        return replace(
            sensor, polar=replace(sensor.polar, range_std_m=range_std_m, bearing_std_rad=bearing_std_rad)
        )
    if np.linalg.eigvalsh(sensor.noise_cov_m2)[0] >= _LEAST_VARIANCE_M2:
        return sensor
    return replace(sensor, noise_cov_m2=read_only(sensor.noise_cov_m2 + np.eye(2) * _LEAST_VARIANCE_M2))


def _birth(
    mean: tuple[float, float, float, float], std_m: float, speed_std_m_s: float, probability: float
) -> Birth:
    cov = np.diag([std_m**2, std_m**2, speed_std_m_s**2, speed_std_m_s**2])
    return Birth(read_only(mean), read_only(cov), probability)
