"""Parameters of a tracker: model, gate, limits and birth components."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gcs.model import FloatArray
from gcs.tracking.models import constant_velocity
from gcs.tracking.models.survival import SURE


class Limits(NamedTuple):
    """Limits of work and approximation (see `GlmbParams`)."""

    max_hypotheses: int
    """Per cluster."""
    log_prune: float
    """Log of the least weight kept, relative to the best of the cluster."""
    tail_share: float
    """Share of the existence of a singleton label that its least probable tracks may lose."""
    min_existence: float
    """Labels below it are dropped."""
    max_conflict: float
    """Probability of a shared detection above which labels are associated jointly."""
    max_dependence: float
    """Total variation above which labels stay in one cluster."""
    max_enumerated: int
    """Joint options of a hypothesis above which it is Gibbs-sampled."""
    gibbs_sweeps: int
    """Per cluster, shared by its sampled hypotheses in proportion to their weights."""
    gate_chi2: float
    """Squared Mahalanobis distance of the gate."""
    merge_chi2: float
    """Squared Mahalanobis distance below which tracks of one label merge."""


@dataclass(frozen=True, slots=True)
class Birth:
    """A birth component: a Gaussian at the time of the scan, and its birth probability r_B."""

    mean: FloatArray
    """(4,) east_m, north_m, v_east_m_s, v_north_m_s."""
    cov: FloatArray
    """(4, 4), positive definite."""
    probability: float


@dataclass(frozen=True, slots=True)
class GlmbParams:
    """Model and limits of a tracker. The defaults of the limits bound the error; they need no tuning.

    Raises
    ------
    ValueError
        If a value is out of range: names the parameter and the expected range.
    """

    accel_psd_m2_s3: float
    """Power spectral density q of the white-noise acceleration along each axis, in m^2/s^3.

    An object gains a velocity of variance q dt in a time dt. It is `noise_diff_coeff` of Stone Soup's
    `ConstantVelocity`.
    """
    piecewise_accel_std_m_s2: float = 0.0
    """Standard deviation of an acceleration that is constant from scan to scan; it adds to the white noise.

    It is `sigma_v` in the code of Vo and Vo, for data that was simulated so (see `constant_velocity`).
    """
    turn_rate_std_rad_s: float = 0.0
    """Standard deviation of the turn rate (see `coordinated_turn`); 0 for straight motion."""
    turn_time_s: float = 5.0
    """Time constant of a turn."""
    survival_probability_per_s: float = 0.99
    lost_std_m: float = math.inf
    """A track with a larger position standard deviation, along its worst axis, is dropped."""
    max_hypotheses: int = 300
    """Per cluster of interacting labels."""
    gate_chi2: float = 32.2
    """Squared Mahalanobis distance of the gate; 32.2 leaves 1e-7 of the detections outside."""
    prune_weight: float = 1e-4
    """Hypotheses below this share of the best in their cluster are pruned."""
    tail_share: float = 1e-3
    """Share of the existence of a singleton label that its least probable tracks may lose.

    The weight goes to its other tracks, so its existence probability does not change.
    """
    min_existence: float = 1e-5
    """Labels below it are dropped."""
    min_reported_existence: float = 1e-3
    """Labels below it are not in the picture."""
    max_conflict: float = 1e-3
    """Probability of a shared detection above which labels are associated jointly."""
    max_dependence: float = 0.01
    """Total variation from independence above which labels stay in one cluster."""
    merge_chi2: float = 1.0
    """Tracks of one label within this squared Mahalanobis distance merge; 0: never."""
    max_enumerated: int = 100_000
    """Joint options of a hypothesis, above the pruning threshold, that are enumerated; more are sampled."""
    gibbs_sweeps: int = 1000
    """Per cluster and scan, shared by its sampled hypotheses."""

    def __post_init__(self) -> None:
        expected = {
            "accel_psd_m2_s3": (self.accel_psd_m2_s3 >= 0.0, "at least 0"),
            "piecewise_accel_std_m_s2": (self.piecewise_accel_std_m_s2 >= 0.0, "at least 0"),
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

    def process_noise(self, dt_s: float) -> FloatArray:
        """Return Q(dt), (4, 4), for the state [east, north, v_east, v_north]."""
        white = constant_velocity.process_noise(dt_s, self.accel_psd_m2_s3)
        return white + constant_velocity.piecewise_process_noise(dt_s, self.piecewise_accel_std_m_s2)

    def limits(self) -> Limits:
        """Return the limits as kernels use them."""
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


def _stacked(arrays: Sequence[FloatArray]) -> FloatArray:
    """Return arrays of one shape as one array; an empty one if they cannot be stacked."""
    try:
        return np.array(arrays, dtype=np.float64)
    except ValueError:
        return np.empty(0)


def _shape_error(births: Sequence[Birth], d: int) -> ValueError:
    """Return the error of the first birth of another shape than d states."""
    expected = ((d,), (d, d))
    for i, birth in enumerate(births):
        shapes = (np.shape(birth.mean), np.shape(birth.cov))
        if shapes != expected:
            return ValueError(f"births[{i}]: expected mean and cov of shapes {expected}, got {shapes}")
    return ValueError("births: expected mean and cov of numbers")


class BirthComponents(NamedTuple):
    """Birth components as arrays, all float64."""

    mean: FloatArray
    """(n, 4)."""
    cov: FloatArray
    """(n, 4, 4)."""
    log_survival: FloatArray
    """(n,) log r_B."""
    log_death: FloatArray
    """(n,) log(1 - r_B)."""

    @classmethod
    def from_births(cls, births: Sequence[Birth], d: int = 4) -> BirthComponents:
        """Convert births of d states to arrays.

        Raises
        ------
        ValueError
            A birth has another shape.
        """
        n = len(births)
        mean = _stacked([birth.mean for birth in births])
        cov = _stacked([birth.cov for birth in births])
        if n and (mean.shape != (n, d) or cov.shape != (n, d, d)):
            raise _shape_error(births, d)
        probability = np.clip([birth.probability for birth in births], 1.0 - SURE, SURE)
        return cls(mean.reshape(-1, d), cov.reshape(-1, d, d), np.log(probability), np.log1p(-probability))
