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

Scans come from outside. One that is late, repeated or ahead of its time is refused (`Trackers.refusal`):
worked in, it would count as one more scan of what is known already, and a single time stamp hours ahead
would outlive every track. A sensor that announces no noise at all is not believed to the last millimetre.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gcs.command.beliefs import Beliefs
from gcs.config import Config, KindTracking
from gcs.model import NS_PER_S, FloatArray, Kind, Picture, Scan, Sensor, VehicleState, read_only
from gcs.tracking.glmb import Birth, Glmb, GlmbParams
from gcs.tracking.motion import process_noise, transition

_NEAR_STD = 5.0
"""A report within this many standard deviations of a track or a place of birth is taken for that object."""
_MAX_AHEAD_S = 1.0
"""A scan that says it was measured longer after its arrival than clocks may differ is refused."""
_LEAST_VARIANCE_M2 = 1e-4
"""Of a detection: without any, covariances become singular."""


class KindTracker:
    """One filter with its places of birth and what is believed of its tracks."""

    def __init__(
        self, kind: Kind, config: Config, table: KindTracking, places: list[Birth], seed: int
    ) -> None:
        tracking = config.tracking
        params = GlmbParams(
            survival_probability_per_s=tracking.survival_probability_per_s,
            accel_std_m_s2=table.accel_std_m_s2,
            max_hypotheses=tracking.max_hypotheses,
            gate_chi2=tracking.gate_chi2,
        )
        self.beliefs = Beliefs(tracking.dead_existence)
        self.picture: Picture | None = None
        self.places = places
        self._accel_std_m_s2 = table.accel_std_m_s2
        self._again_probability = table.birth_again_probability
        self._filter = Glmb(kind, params, seed)

    def update(
        self, t_ns: int, z_m: FloatArray, sensor: Sensor, others: FloatArray, births: Sequence[Birth] = ()
    ) -> None:
        """Work one scan, with births at the known places and at those given.

        `others` (m,) is the intensity of the other kind's detections at each detection, per m2: clutter to
        this kind.
        """
        clutter = sensor.clutter_density_per_m2 + others
        self._filter.update(t_ns, z_m, sensor, [*self.places, *births], clutter)

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
        return means[:, :2], covs[:, :2, :2], np.array([track.existence for track in tracks])

    def intensity(self, t_ns: int, z_m: FloatArray, sensor: Sensor) -> FloatArray:
        """Intensity of detections of this kind's objects at each of `z_m` (m, 2), per m2."""
        means, covs, existence = self.expected(t_ns)
        S = covs + sensor.noise_cov_m2
        d2 = squared_distances(z_m, means, S)
        density = np.exp(-0.5 * d2) / (2.0 * np.pi * np.sqrt(np.linalg.det(S)))
        return np.asarray(density @ existence) * sensor.detection_probability

    def look(self, t_ns: int) -> Picture:
        """Return the picture, and follow what it says about beliefs and places."""
        self.picture = self._filter.picture(t_ns)
        self.beliefs.update(self.picture)
        for _, index in self.beliefs.tracks:
            if index < len(self.places):
                self.places[index] = replace(self.places[index], probability=self._again_probability)
        return self.picture


class Trackers:
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
        self._report_birth_probability = tracking.agents.birth_probability
        self._measured_t_ns = -1
        self._sensors_then: set[str] = set()
        self.agents = KindTracker("agents", config, tracking.agents, starts, tracking.seed)
        self.targets = KindTracker("targets", config, tracking.targets, places, tracking.seed + 1)

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
        scan = replace(scan, sensor=_with_noise(scan.sensor))
        fresh = [s for s in states if abs(t_ns - s.t_ns) <= self._telemetry.max_age_s * NS_PER_S]
        places = np.reshape([at_time(state, t_ns) for state in fresh], (-1, 2))
        known = self._are_known(places, t_ns)
        newcomers = [self._report_birth(fresh[i], places[i]) for i in np.flatnonzero(~known)]
        of_targets = self.targets.intensity(t_ns, scan.z_m, scan.sensor)
        self.agents.update(t_ns, scan.z_m, scan.sensor, of_targets, newcomers)
        self.agents.update_again(t_ns, places[known], self._telemetry_sensor())
        agents = self.agents.look(scan.t_ns)
        of_agents = self.agents.intensity(t_ns, scan.z_m, scan.sensor)
        self.targets.update(t_ns, scan.z_m, scan.sensor, of_agents)
        return agents, self.targets.look(scan.t_ns)

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
    offset = places[:, None, :] - means[None, :, :]
    return np.asarray(np.einsum("mni,nij,mnj->mn", offset, np.linalg.inv(S), offset))


def _with_noise(sensor: Sensor) -> Sensor:
    """Return the sensor with a noise that can be inverted."""
    if np.linalg.eigvalsh(sensor.noise_cov_m2)[0] >= _LEAST_VARIANCE_M2:
        return sensor
    return replace(sensor, noise_cov_m2=read_only(sensor.noise_cov_m2 + np.eye(2) * _LEAST_VARIANCE_M2))


def _birth(
    mean: tuple[float, float, float, float], std_m: float, speed_std_m_s: float, probability: float
) -> Birth:
    cov = np.diag([std_m**2, std_m**2, speed_std_m_s**2, speed_std_m_s**2])
    return Birth(read_only(mean), read_only(cov), probability)
