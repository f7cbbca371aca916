"""The two GLMB filters and what they are given: every scan, births at known places, and agents' own reports.

Both filters get all detections of a sensor, as in the paper: the other kind's objects are clutter to each,
since births are at known places. MAVLink position reports are a second sensor of the agents, used at the
moment of each scan: detections without clutter to speak of, seen only where a vehicle reports. A vehicle
that reports where no track and no place of birth is gets a birth there, so that an agent lost by mistake
comes back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gcs.config import Config
from gcs.model import NS_PER_S, FloatArray, Picture, Scan, Sensor, VehicleState, read_only
from gcs.tracking.glmb import Birth, Glmb, GlmbParams

_NEAR_STD = 5.0
"""A report within this many standard deviations of a track or a place of birth is taken for that object."""


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
        self._field = (0.0, 0.0, config.map.width_m, config.map.height_m)
        self._agent_births = [
            _birth(
                (agent.east_m, agent.north_m, 0.0, 0.0),
                tracking.agent_birth_std_m,
                tracking.agent_birth_speed_std_m_s,
                tracking.agents.birth_probability,
            )
            for agent in config.agents
        ]
        self._target_births = [
            _birth(
                (birth.east_m, birth.north_m, birth.v_east_m_s, birth.v_north_m_s),
                birth.std_m,
                birth.speed_std_m_s,
                tracking.targets.birth_probability,
            )
            for birth in config.births
        ]
        self._agents = Glmb("agents", _params(config, tracking.agents.accel_std_m_s2), tracking.seed)
        self._targets = Glmb("targets", _params(config, tracking.targets.accel_std_m_s2), tracking.seed + 1)
        self.agents: Picture | None = None
        self.targets: Picture | None = None

    def scan(self, scan: Scan, states: Sequence[VehicleState]) -> tuple[Picture, Picture]:
        """Work one scan into both filters; return the pictures of agents and of targets."""
        t_ns = scan.measured_t_ns
        reports = [
            (state, at_time(state, t_ns))
            for state in states
            if abs(t_ns - state.t_ns) <= self._telemetry.max_age_s * NS_PER_S
        ]
        newcomers = [r for r in reports if self._is_unknown_place(r[1])]
        births = [*self._agent_births, *(self._report_birth(*r) for r in newcomers)]
        self._agents.update(t_ns, scan.z_m, scan.sensor, births)
        seen = np.array([place for state, place in reports if (state, place) not in newcomers])
        self._agents.update(t_ns, seen.reshape(-1, 2), self._telemetry_sensor())
        self._targets.update(t_ns, scan.z_m, scan.sensor, self._target_births)
        self.agents = self._agents.picture(scan.t_ns)
        self.targets = self._targets.picture(scan.t_ns)
        return self.agents, self.targets

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

    def _report_birth(self, state: VehicleState, place: tuple[float, float]) -> Birth:
        velocity = velocity_m_s(state)
        return _birth(
            (*place, *velocity), 2.0 * self._telemetry.noise_std_m, 2.0, self._agent_births[0].probability
        )

    def _is_unknown_place(self, place: tuple[float, float]) -> bool:
        known: list[tuple[FloatArray, FloatArray]] = [(b.mean, b.cov) for b in self._agent_births]
        if self.agents is not None:
            known += [(track.mean, track.cov) for track in self.agents.tracks]
        noise = np.eye(2) * self._telemetry.noise_std_m**2
        return all(distance2(place, mean, cov, noise) > _NEAR_STD**2 for mean, cov in known)


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


def _params(config: Config, accel_std_m_s2: float) -> GlmbParams:
    tracking = config.tracking
    return GlmbParams(
        survival_probability_per_s=tracking.survival_probability_per_s,
        accel_std_m_s2=accel_std_m_s2,
        max_hypotheses=tracking.max_hypotheses,
        gate_chi2=tracking.gate_chi2,
    )
