"""Trackers' motion model, parameters, birth probabilities and birth components, from the mission file."""

from __future__ import annotations

import math

import numpy as np

from gcs.config import Config
from gcs.config.schema import TrackingTable
from gcs.model import read_only
from gcs.tracking.glmb.filter import Birth, GlmbParams

BIRTH_PROBABILITY = 0.03
"""Birth probability of a component at each scan, until its first object is confirmed."""
BIRTH_AGAIN_PROBABILITY = 1e-4
"""Birth probability from then on."""
_AGENT_STD_M = 10.0
_AGENT_SPEED_STD_M_S = 10.0
"""Standard deviations of an agent's start."""
_TURN_TIME_S = 10.0
"""Duration of a turn, where turns are modelled."""


def glmb_params(tracking: TrackingTable, accel_psd_m2_s3: float, turn_rate_std_deg_s: float) -> GlmbParams:
    """Return the parameters of a filter for objects with this motion."""
    return GlmbParams(
        accel_psd_m2_s3=accel_psd_m2_s3,
        turn_rate_std_rad_s=math.radians(turn_rate_std_deg_s),
        turn_time_s=_TURN_TIME_S,
        max_hypotheses=tracking.max_hypotheses,
        gate_chi2=tracking.gate_chi2,
        lost_std_m=tracking.lost_std_m,
    )


def agent_births(config: Config) -> list[Birth]:
    """Return the birth components of agents: their starts."""
    return [
        birth((agent.east_m, agent.north_m, 0.0, 0.0), _AGENT_STD_M, _AGENT_SPEED_STD_M_S)
        for agent in config.agents
    ]


def target_births(config: Config) -> list[Birth]:
    """Return the declared birth components of targets."""
    return [
        birth((row.east_m, row.north_m, row.v_east_m_s, row.v_north_m_s), row.std_m, row.speed_std_m_s)
        for row in config.births
    ]


def birth(
    mean: tuple[float, float, float, float],
    std_m: float,
    speed_std_m_s: float,
    probability: float = BIRTH_PROBABILITY,
) -> Birth:
    """Return a Gaussian birth component."""
    cov = np.diag([std_m**2, std_m**2, speed_std_m_s**2, speed_std_m_s**2])
    return Birth(read_only(mean), read_only(cov), probability)
