"""The two GLMB filters and what they are given: every scan, births at known places, and agents' own reports.

Both filters get all detections of a sensor, as in the paper: the other kind's objects are clutter to each,
since births are at known places. MAVLink position reports are a second sensor of the agents, used at the
moment of each scan: detections without clutter to speak of, seen only where a vehicle reports. A vehicle
that reports where no track and no place of birth is gets a birth there, so that an agent lost by mistake
comes back.

A place gives birth with `birth_probability` each scan until an object of it is believed, and with
`birth_again_probability` from then on: one object is expected of each, and clutter near a place that has
given its own must not look like another.
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
        self.beliefs = Beliefs(tracking.confirm_existence, tracking.dead_existence)
        self.picture: Picture | None = None
        self.places = places
        self._accel_std_m_s2 = table.accel_std_m_s2
        self._again_probability = table.birth_again_probability
        self._filter = Glmb(kind, params, seed)

    def update(self, t_ns: int, z_m: FloatArray, sensor: Sensor, births: Sequence[Birth] = ()) -> None:
        """Work one scan, with births at the known places and at those given."""
        self._filter.update(t_ns, z_m, sensor, [*self.places, *births])

    def update_again(self, t_ns: int, z_m: FloatArray, sensor: Sensor) -> None:
        """Work another sensor's scan of the same moment: nothing is born in between."""
        self._filter.update(t_ns, z_m, sensor)

    def expected(self, t_ns: int) -> tuple[FloatArray, FloatArray]:
        """Return where something of this kind is or may appear at `t_ns`.

        Positions (n, 2) and their covariances (n, 2, 2): of the places of birth, and of every track of the last
        picture moved on to that time.
        """
        means = [birth.mean for birth in self.places]
        covs = [birth.cov for birth in self.places]
        if self.picture is not None:
            dt_s = max(0.0, (t_ns - self.picture.scan_t_ns) / NS_PER_S)
            F, Q = transition(dt_s), process_noise(dt_s, self._accel_std_m_s2)
            means += [F @ track.mean for track in self.picture.tracks]
            covs += [F @ track.cov @ F.T + Q for track in self.picture.tracks]
        return np.reshape(means, (-1, 4))[:, :2], np.reshape(covs, (-1, 4, 4))[:, :2, :2]

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
        self.agents = KindTracker("agents", config, tracking.agents, starts, tracking.seed)
        self.targets = KindTracker("targets", config, tracking.targets, places, tracking.seed + 1)

    def scan(self, scan: Scan, states: Sequence[VehicleState]) -> tuple[Picture, Picture]:
        """Work one scan into both filters; return the pictures of agents and of targets."""
        t_ns = scan.measured_t_ns
        fresh = [s for s in states if abs(t_ns - s.t_ns) <= self._telemetry.max_age_s * NS_PER_S]
        places = np.reshape([at_time(state, t_ns) for state in fresh], (-1, 2))
        known = self._are_known(places, t_ns)
        newcomers = [self._report_birth(fresh[i], places[i]) for i in np.flatnonzero(~known)]
        self.agents.update(t_ns, scan.z_m, scan.sensor, newcomers)
        self.agents.update_again(t_ns, places[known], self._telemetry_sensor())
        self.targets.update(t_ns, scan.z_m, scan.sensor)
        return self.agents.look(scan.t_ns), self.targets.look(scan.t_ns)

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
        means, covs = self.agents.expected(t_ns)
        precision = np.linalg.inv(covs + np.eye(2) * self._telemetry.noise_std_m**2)
        offset = places[:, None, :] - means[None, :, :]
        d2 = np.einsum("sni,nij,snj->sn", offset, precision, offset)
        return np.asarray((d2 <= _NEAR_STD**2).any(axis=1))


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


def distance2(
    place: tuple[float, float], mean: FloatArray, cov: FloatArray, noise_cov_m2: FloatArray
) -> float:
    """Squared Mahalanobis distance of a place from a track's position."""
    s = cov[:2, :2] + noise_cov_m2
    de, dn = place[0] - float(mean[0]), place[1] - float(mean[1])
    a, b, d = float(s[0, 0]), float(s[0, 1]), float(s[1, 1])
    return (d * de * de - 2.0 * b * de * dn + a * dn * dn) / (a * d - b * b)


def _birth(
    mean: tuple[float, float, float, float], std_m: float, speed_std_m_s: float, probability: float
) -> Birth:
    cov = np.diag([std_m**2, std_m**2, speed_std_m_s**2, speed_std_m_s**2])
    return Birth(read_only(mean), read_only(cov), probability)
