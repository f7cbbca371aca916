"""What a tracker is told: its model and limits, and where objects may appear."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, get_args

import numpy as np

from gcs.model import FloatArray
from gcs.tracking.glmb.hypotheses import Limits
from gcs.tracking.models import constant_velocity

SURE = 1.0 - 1e-9
"""Probabilities are held below it: a model that is certain cannot be corrected."""


@dataclass(frozen=True, slots=True)
class Birth:
    """Where an object may appear at a scan: a Gaussian at the time of the scan, and how probable it is."""

    mean: FloatArray
    """(4,) east_m, north_m, v_east_m_s, v_north_m_s."""
    cov: FloatArray
    """(4, 4)."""
    probability: float


@dataclass(frozen=True, slots=True)
class GlmbParams:
    """Model and limits of a tracker. The limits' defaults bound the error; they are not there to be tuned.

    Raises
    ------
    ValueError
        When a number is none of its kind; which, and what was expected.
    """

    accel_std_m_s2: float
    """Velocity gained in a second, standard deviation (see `motion`)."""
    acceleration: constant_velocity.Acceleration = "white"
    """Which of the two models of `motion`."""
    turn_rate_std_rad_s: float = 0.0
    """Standard deviation of the rate at which objects turn (see `turning`); 0: they fly straight."""
    turn_time_s: float = 5.0
    """How long a turn lasts."""
    survival_probability_per_s: float = 0.99
    lost_std_m: float = math.inf
    """A track whose position is known worse than this, along its worst axis, is given up."""
    max_hypotheses: int = 300
    """Of one group of interacting labels."""
    gate_chi2: float = 32.2
    """Squared Mahalanobis distance of the gate: 2 degrees of freedom, 1e-7 of the detections outside."""
    prune_weight: float = 1e-4
    """Hypotheses below this share of their group's best are dropped."""
    tail_share: float = 1e-3
    """Of a label that competes with nobody, the least probable histories that together hold less than this
    share of its existence are dropped; it exists as probably as before."""
    min_existence: float = 1e-5
    """Labels below it are forgotten."""
    min_reported_existence: float = 1e-3
    """Labels below it are not in the picture."""
    max_conflict: float = 1e-3
    """Labels that would take the same detection less probably than this are associated apart."""
    max_dependence: float = 0.01
    """Labels closer to independence than this total variation are tracked apart."""
    merge_chi2: float = 1.0
    """Tracks of one label closer than this squared Mahalanobis distance become one; 0: never."""
    max_enumerated: int = 100_000
    """Most joint options of a hypothesis, of those that are not hopeless, whose children are enumerated;
    beyond, they are sampled."""
    gibbs_sweeps: int = 1000
    """Per group and scan, shared by its sampled hypotheses."""

    def __post_init__(self) -> None:
        expected = {
            "accel_std_m_s2": (self.accel_std_m_s2 >= 0.0, "at least 0"),
            "acceleration": (
                self.acceleration in get_args(constant_velocity.Acceleration),
                "white or piecewise",
            ),
            "turn_rate_std_rad_s": (self.turn_rate_std_rad_s >= 0.0, "at least 0"),
            "turn_time_s": (self.turn_time_s > 0.0, "above 0"),
            "survival_probability_per_s": (0.0 <= self.survival_probability_per_s <= 1.0, "0 to 1"),
            "lost_std_m": (self.lost_std_m > 0.0, "above 0"),
            "max_hypotheses": (self.max_hypotheses >= 1, "at least 1"),
            "gate_chi2": (self.gate_chi2 > 0.0, "above 0"),
            "prune_weight": (0.0 < self.prune_weight <= 1.0, "above 0, at most 1"),
            "merge_chi2": (self.merge_chi2 >= 0.0, "at least 0"),
        }
        for name, (is_met, what) in expected.items():
            if not is_met:
                raise ValueError(f"{name}: expected {what}, got {getattr(self, name)!r}")

    def limits(self) -> Limits:
        """Return the limits as the kernels take them."""
        return Limits(
            int(self.max_hypotheses),
            math.log(self.prune_weight),
            float(self.tail_share),
            float(self.min_existence),
            float(self.max_conflict),
            float(self.max_dependence),
            int(self.max_enumerated),
            int(self.gibbs_sweeps),
            float(self.gate_chi2),
            float(self.merge_chi2),
        )


class BirthComponents(NamedTuple):
    """Births as arrays."""

    mean: FloatArray
    """(n, 4)."""
    cov: FloatArray
    """(n, 4, 4)."""
    log_survival: FloatArray
    """(n,) of the probability to appear."""
    log_death: FloatArray
    """(n,) of the probability not to."""

    @classmethod
    def from_births(cls, births: Sequence[Birth]) -> BirthComponents:
        """Convert."""
        probability = np.clip([birth.probability for birth in births], 1.0 - SURE, SURE)
        return cls(
            np.array([birth.mean for birth in births], dtype=np.float64).reshape(-1, 4),
            np.array([birth.cov for birth in births], dtype=np.float64).reshape(-1, 4, 4),
            np.log(probability),
            np.log1p(-probability),
        )
