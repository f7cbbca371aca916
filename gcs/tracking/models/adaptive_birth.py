"""Adaptive birth: birth components at detections that no track explains.

A track explains each detection z of a scan with probability r_U(z). At the next scan each detection gives
birth with probability (Reuter, Vo, Vo & Dietmayer, "The Labeled Multi-Bernoulli Filter", IEEE TSP 62, 2014,
IV-C)

    r_B(z) = min(r_max, (1 - r_U(z)) / sum over z' of (1 - r_U(z')) x lambda_B)

So lambda_B objects are expected in all, however much clutter there is. The position covariance is that of the
sensor at z. The velocity has mean zero. Both are predicted to the next scan.

The birth rate is per second: lambda_B is the rate times the time since the sensor's last scan, divided by the
number of sensors. Two sensors do not double the births.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gcs.model import NS_PER_S, BoolArray, FloatArray, IntArray, Sensor, read_only
from gcs.tracking.glmb.params import Birth
from gcs.tracking.models import constant_velocity, sensor_geometry

_FIRST_INTERVAL_S = 1.0
"""Interval assumed before a sensor's first scan."""
_SENSOR_TIMEOUT_S = 60.0
"""A sensor without a scan for so long no longer counts."""
_MIN_PROBABILITY = 1e-7
_MAX_LOG_RATIO = 50.0
_MAX_BIRTHS = 2000
"""Per scan, the least explained detections first: bounds the work of a hostile scan."""


class Unexplained(NamedTuple):
    """Unexplained detections of the last scan; n detections."""

    t_ns: int
    positions_m: FloatArray
    """(n, 2) east, north."""
    noise_m2: FloatArray
    """(n, 2, 2)."""
    probability: FloatArray
    """(n,) birth probability."""


@dataclass(slots=True)
class AdaptiveBirthState:
    """What adaptive births remember of the scans."""

    last_scan_t_ns: dict[str, int] = field(default_factory=dict)
    """Time of each sensor's last scan."""
    unexplained: Unexplained | None = None

    def __post_init__(self) -> None:
        if self.unexplained is None:
            return
        _, positions, noise, probability = self.unexplained
        n = probability.size
        is_valid = (positions.shape, noise.shape, probability.shape) == ((n, 2), (n, 2, 2), (n,))
        if not is_valid or not all(np.isfinite(values).all() for values in self.unexplained):
            raise ValueError("adaptive birth: the unexplained detections are not valid")


class AdaptiveBirth:
    """Birth components at unexplained detections.

    Parameters
    ----------
    per_s : float
        Expected births per second in the field of view of all sensors. 0: none.
    speed_std_m_s : float
        Standard deviation of the velocity of a birth, along each axis.
    max_probability : float
        Largest probability of a single birth.
    process_noise : callable
        Q(dt) of the motion until the next scan, (4, 4) (see `GlmbParams.process_noise`).
    state : AdaptiveBirthState, optional
        State to continue from; it is updated in place.
    """

    def __init__(
        self,
        per_s: float,
        speed_std_m_s: float,
        max_probability: float,
        process_noise: Callable[[float], FloatArray],
        state: AdaptiveBirthState | None = None,
    ) -> None:
        self._per_s = per_s
        self._speed_std_m_s = speed_std_m_s
        self._max_probability = max_probability
        self._process_noise = process_noise
        self._state = AdaptiveBirthState() if state is None else state

    def births(self, t_ns: int) -> list[Birth]:
        """Remove and return the birth components for a scan measured at `t_ns`."""
        last = self._state.unexplained
        self._state.unexplained = None
        if last is None or t_ns < last.t_ns:
            return []
        dt_s = (t_ns - last.t_ns) / NS_PER_S
        speed = np.diag([0.0, 0.0, 1.0, 1.0]) * self._speed_std_m_s**2
        F = constant_velocity.transition(dt_s)
        Q = self._process_noise(dt_s)
        found = []
        for position, noise, probability in zip(
            last.positions_m, last.noise_m2, last.probability, strict=True
        ):
            cov = speed.copy()
            cov[:2, :2] = noise
            mean = np.array([*position, 0.0, 0.0])
            found.append(Birth(read_only(mean), read_only(F @ cov @ F.T + Q), float(probability)))
        return found

    def add_scan(
        self,
        t_ns: int,
        z_m: FloatArray,
        sensor: Sensor,
        explained: FloatArray,
        log_ratio: FloatArray | None = None,
        is_sure: BoolArray | None = None,
    ) -> None:
        """Add a processed scan: detections (m, 2) and the probability that tracks explain each (m,).

        `log_ratio` (m,) is the log-likelihood ratio of what else was measured of each, object against
        clutter. Those of `is_sure` (m,) give birth with the greatest probability.
        """
        elapsed_s = add_scan_time(self._state.last_scan_t_ns, t_ns, sensor.name)
        unexplained = unexplained_weight(explained, log_ratio)
        if self._per_s <= 0.0 or not unexplained.any():
            return
        expected = self._per_s * elapsed_s / len(self._state.last_scan_t_ns)
        rows, probability = birth_probabilities(unexplained, expected, self._max_probability, is_sure)
        self._state.unexplained = Unexplained(
            t_ns, z_m[rows], sensor_geometry.noise_m2(sensor, z_m[rows]), probability
        )


def add_scan_time(last_scan_t_ns: dict[str, int], t_ns: int, sensor: str) -> float:
    """Record the time of a sensor's scan, and return the time in seconds since its last one."""
    before = last_scan_t_ns.get(sensor)
    last_scan_t_ns[sensor] = t_ns
    horizon = t_ns - int(_SENSOR_TIMEOUT_S * NS_PER_S)
    for name in [name for name, at in last_scan_t_ns.items() if at < horizon]:
        del last_scan_t_ns[name]
    return _FIRST_INTERVAL_S if before is None else (t_ns - before) / NS_PER_S


def unexplained_weight(explained: FloatArray, log_ratio: FloatArray | None) -> FloatArray:
    """Return the weight (m,) of each detection as a birth: 1 - r_U, times its likelihood ratio."""
    weight = np.clip(1.0 - explained, 0.0, 1.0)
    if log_ratio is None:
        return weight
    return np.asarray(weight * np.exp(np.clip(np.nan_to_num(log_ratio), -_MAX_LOG_RATIO, _MAX_LOG_RATIO)))


def birth_probabilities(
    unexplained: FloatArray, expected: float, max_probability: float, is_sure: BoolArray | None = None
) -> tuple[IntArray, FloatArray]:
    """Return the detections that give birth (n,) and their birth probabilities (n,).

    Parameters
    ----------
    unexplained : (m,) array
        Weight of each detection (`unexplained_weight`), not all 0.
    expected : float
        lambda_B, the expected number of births.
    max_probability : float
        Largest probability of a single birth.
    is_sure : (m,) array, optional
        True for a detection with that probability.
    """
    probability = np.minimum(unexplained / unexplained.sum() * expected, max_probability)
    if is_sure is not None:
        probability[is_sure] = max_probability
    rows = np.argsort(-probability, kind="stable")[:_MAX_BIRTHS]
    rows = np.sort(rows[probability[rows] >= _MIN_PROBABILITY])
    return rows, probability[rows]
