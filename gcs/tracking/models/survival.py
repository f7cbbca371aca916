"""Survival: the probability that an object exists still at the next scan.

An object survives an interval dt with probability p_S(dt) = p_S^dt, where p_S is that of one second. A lost
track, whose position is not known to within `lost_std_m`, dies almost surely: it would gate every detection
around and never be confirmed.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

SURE = 1.0 - 1e-9
"""Largest probability in the model: a certain model could not be corrected."""


class Survival(NamedTuple):
    """Log-probabilities of survival and death between two scans."""

    log_survival: float
    """log p_S(dt)."""
    log_death: float
    """log(1 - p_S(dt))."""
    log_survival_lost: float
    """Of a track whose position variance exceeds `max_variance_m2`."""
    log_death_lost: float
    max_variance_m2: float
    """Along the worse axis."""


def survival_probability(per_s: float, dt_s: float) -> float:
    """Return p_S(dt), at least 1e-9."""
    return float(max(min(per_s, 1.0) ** dt_s, 1.0 - SURE))


@lru_cache(maxsize=64)
def survival_terms(probability: float, lost_std_m: float) -> Survival:
    """Return the terms of a survival probability p_S(dt)."""
    survive = np.array([probability, 1.0 - SURE])
    log_survival = np.log(survive)
    log_death = np.log1p(-survive, out=np.full(2, -np.inf), where=survive < 1.0)
    return Survival(log_survival[0], log_death[0], log_survival[1], log_death[1], lost_std_m * lost_std_m)
