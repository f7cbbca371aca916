"""Adaptive birth with a user's models, at detections that no track explains."""

from __future__ import annotations

import numpy as np

from gcs.model import NS_PER_S, FloatArray, Sensor, read_only
from gcs.tracking.glmb.params import Birth
from gcs.tracking.models import sensor_geometry
from gcs.tracking.models.adaptive_birth import (
    add_scan_time,
    birth_probabilities,
    unexplained_weight,
)
from gcs.tracking.state_space.models import MeasurementModel, SwitchingMotion
from gcs.tracking.state_space.recursion import predict_states

_PLANAR = {"x", "y", "vx", "vy"}


class StateSpaceBirth:
    """Birth components at unexplained detections (see `AdaptiveBirth`)."""

    def __init__(
        self, motion: SwitchingMotion, per_s: float, speed_std_m_s: float, max_probability: float
    ) -> None:
        self._motion = motion
        self._per_s = per_s
        self._speed_std_m_s = speed_std_m_s
        self._max_probability = max_probability
        self._last_scan_t_ns: dict[str, int] = {}
        self._t_ns = 0
        self._births: list[Birth] = []

    def births(self, t_ns: int) -> tuple[Birth, ...]:
        """Remove and return the birth components for a scan measured at `t_ns`."""
        births = self._births
        self._births = []
        dt_s = (t_ns - self._t_ns) / NS_PER_S
        if dt_s < 0.0 or not births:
            return ()
        if dt_s == 0.0:
            return tuple(births)
        mean = np.array([birth.mean for birth in births])
        cov = np.array([birth.cov for birth in births])
        weight = self._motion.stationary_modes()
        moved = [predict_states(self._motion, i, mean, cov, dt_s) for i in range(weight.size)]
        centre = np.tensordot(weight, np.array([one.value for one in moved]), 1)
        spread = np.zeros_like(cov)
        for share, one in zip(weight, moved, strict=True):
            off = one.value - centre
            spread += share * (one.rest + off[:, :, None] * off[:, None, :])
        return tuple(
            Birth(read_only(x), read_only(P), birth.probability)
            for x, P, birth in zip(centre, spread, births, strict=True)
        )

    def add_scan(
        self,
        t_ns: int,
        z: FloatArray,
        sensor: Sensor | MeasurementModel,
        explained: FloatArray,
        log_ratio: FloatArray | None = None,
    ) -> None:
        """Add a processed scan of detections (m, k) (see `AdaptiveBirth.add_scan`)."""
        elapsed_s = add_scan_time(self._last_scan_t_ns, t_ns, sensor.name)
        unexplained = unexplained_weight(explained, log_ratio)
        if self._per_s <= 0.0 or not unexplained.any():
            return
        expected = self._per_s * elapsed_s / len(self._last_scan_t_ns)
        rows, probability = birth_probabilities(unexplained, expected, self._max_probability)
        self._t_ns = t_ns
        self._births = [
            Birth(*self._state(sensor, z[row]), float(share))
            for row, share in zip(rows.tolist(), probability.tolist(), strict=True)
        ]

    def _state(self, sensor: Sensor | MeasurementModel, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        names = self._motion.names
        d = len(names)
        if isinstance(sensor, MeasurementModel):
            if sensor.birth is None:
                raise ValueError(f"birth of sensor {sensor.name}: expected a function, for births anywhere")
            mean, cov = (read_only(part) for part in sensor.birth(z))
            if mean.shape != (d,) or cov.shape != (d, d):
                raise ValueError(
                    f"birth of sensor {sensor.name}: expected the shapes {(d,)} and {(d, d)}, "
                    f"got {mean.shape} and {cov.shape}"
                )
            return mean, cov
        if set(names) != _PLANAR:
            raise ValueError(f"births_per_s: a sensor of the plane has births of x, y, vx, vy; got {names}")
        at = [names.index("x"), names.index("y")]
        mean = np.zeros(d)
        mean[at] = z
        cov = np.eye(d) * self._speed_std_m_s**2
        cov[np.ix_(at, at)] = sensor_geometry.noise_m2(sensor, z[None])[0]
        return mean, cov
