"""Worlds that follow the filter's own model to the letter, of any size and density, drawn from a seed.

Objects live on with p_S, move by white acceleration, are detected with p_D and Gaussian noise; clutter is
Poisson and uniform; new objects appear at known places, each with its probability. So whatever a filter gets
wrong here is its own doing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb.filter import Birth, GlmbParams
from gcs.tracking.models import constant_velocity

P_S, P_D, ACCEL_PSD, NOISE_VAR = 0.99, 0.98, 1.0, 10.0
BIRTH_COV = np.diag([100.0, 100.0, 100.0, 100.0])
KNOWN_COV = np.diag([5.0, 5.0, 2.0, 2.0])
"""About that of an object which has been tracked for some time."""
EVERYWHERE = (-math.inf, -math.inf, math.inf, math.inf)


@dataclass(frozen=True)
class Scan:
    """What the sensor saw, who may have appeared, and who was there."""

    t_ns: int
    z_m: np.ndarray
    births: Sequence[Birth]
    truth: np.ndarray
    """(n, 4)."""


@dataclass
class World:
    """`objects` on average, one on each `cell_m` x `cell_m`, with as many clutter points as `clutter`."""

    objects: int
    clutter: int
    cell_m: float
    seed: int = 7
    side_m: float = field(init=False)

    def __post_init__(self) -> None:
        self.side_m = self.cell_m * math.sqrt(self.objects)

    @property
    def sensor(self) -> Sensor:
        return Sensor("world", P_D, self.clutter / self.side_m**2, np.eye(2) * NOISE_VAR, EVERYWHERE)

    @property
    def params(self) -> GlmbParams:
        return GlmbParams(accel_psd_m2_s3=ACCEL_PSD, survival_probability_per_s=P_S)

    def scans(self, count: int) -> Iterator[Scan]:
        """Begin with all objects about known, as in flight; places of birth make up for the deaths."""
        rng = np.random.default_rng(self.seed)
        F, Q = constant_velocity.transition(1.0), constant_velocity.process_noise(1.0, ACCEL_PSD)
        n_places = max(1, self.objects // 10)
        places = rng.uniform(0.0, self.side_m, (n_places, 2))
        again = tuple(_birth(p, self.objects * (1.0 - P_S) / n_places) for p in places)
        births = []
        for place in rng.uniform(0.0, self.side_m, (round(self.objects / 0.99), 2)):
            velocity = rng.normal(0.0, 10.0, 2)
            births.append(Birth(np.array([*place, *velocity]), KNOWN_COV, 0.99))
        state = np.empty((0, 4))
        for k in range(count):
            state = state[rng.random(len(state)) < P_S] @ F.T
            state = state + rng.multivariate_normal(np.zeros(4), Q, len(state))
            born = [rng.multivariate_normal(b.mean, b.cov) for b in births if rng.random() < b.probability]
            state = np.vstack([state, *(b[None] for b in born)])
            seen = state[rng.random(len(state)) < P_D, :2]
            noise = rng.normal(0.0, math.sqrt(NOISE_VAR), seen.shape)
            clutter = rng.uniform(0.0, self.side_m, (rng.poisson(self.clutter), 2))
            yield Scan(k * NS_PER_S, rng.permutation(np.vstack([seen + noise, clutter])), births, state)
            births = again


def _birth(place: np.ndarray, probability: float) -> Birth:
    return Birth(np.array([*place, 0.0, 0.0]), BIRTH_COV, probability)
