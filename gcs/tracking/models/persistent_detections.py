"""Detections that persist although no track takes them: objects where none may be born.

Each detection that no track explains may begin a chain, and each later one near where the chain should be
then adds to its score: the log-likelihood ratio of "one object" against "clutter" (Wald's sequential test;
Bar-Shalom & Li, "Multitarget-Multisensor Tracking", 1995, section 3.2). A missed detection takes from it, and
a chain whose score falls below its beginning ends. Places that nobody looks at keep their score.

A chain is persistent when its score reaches 25: by Wald's bound clutter gets there less than once in 7e10
chains, which is far less than once a year. At 20 false detections a scan on 2 km x 2 km that takes five
detections.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from gcs.model import NS_PER_S, FloatArray, Sensor
from gcs.tracking.models import constant_velocity, sensors

Ints = npt.NDArray[np.intp]
Flags = npt.NDArray[np.bool_]

_PERSISTENT_SCORE: Final = 25.0
_MAX_SCORE: Final = 35.0
_UNEXPLAINED: Final = 0.5
"""A detection that some track made less probably than this belongs to none."""
_GATE_CHI2: Final = 16.0
_SPEED_STD_M_S: Final = 10.0
_ACCEL_STD_M_S2: Final = 0.5
_MAX_DETECTION: Final = 0.98
"""Of a sensor that calls itself perfect: one miss proves little."""
_MIN_CLUTTER_PER_M2: Final = 1e-9
_MAX_STD_M: Final = 200.0
"""Of a chain's position, where nobody looks."""
_MAX_CHAINS: Final = 300


class PersistentDetections:
    """Chains of detections without a track, over the scans of all sensors."""

    def __init__(self) -> None:
        self._t_ns = 0
        self._mean = np.zeros((0, 4))
        self._cov = np.zeros((0, 4, 4))
        self._score = np.zeros(0)
        self._found = np.zeros(0, np.bool_)

    @property
    def places_m(self) -> FloatArray:
        """East and north (n, 2) of the chains that are persistent."""
        return np.asarray(self._mean[self._found, :2])

    def process_scan(self, t_ns: int, z_m: FloatArray, sensor: Sensor, explained: FloatArray) -> FloatArray:
        """Take a scan; return east and north (n, 2) of the chains that have just become persistent.

        Parameters
        ----------
        t_ns : int
            When it was measured; never before the last one.
        z_m : array
            (m, 2) detections, east and north.
        sensor : Sensor
        explained : array
            (m,) probability that some track made each detection.
        """
        self._predict(t_ns)
        unexplained = np.flatnonzero(explained < _UNEXPLAINED)
        unexplained = np.sort(unexplained[np.argsort(explained[unexplained], kind="stable")[:_MAX_CHAINS]])
        z, noise = z_m[unexplained], sensors.noise_m2(sensor, z_m[unexplained])
        clutter = np.maximum(sensors.clutter_per_m2(sensor, z), _MIN_CLUTTER_PER_M2)
        is_assigned = self._associate(z, noise, clutter, sensor)
        self._keep((self._score >= 0.0) & (self._cov[:, [0, 1], [0, 1]].max(axis=1) <= _MAX_STD_M**2))
        self._begin(z[~is_assigned], noise[~is_assigned])
        new = ~self._found & (self._score >= _PERSISTENT_SCORE)
        self._found |= new
        return np.asarray(self._mean[new, :2])

    def _predict(self, t_ns: int) -> None:
        dt_s = (t_ns - self._t_ns) / NS_PER_S if self._score.size else 0.0
        self._t_ns = t_ns
        F, Q = constant_velocity.transition(dt_s), constant_velocity.process_noise(dt_s, _ACCEL_STD_M_S2)
        self._mean = self._mean @ F.T
        self._cov = F @ self._cov @ F.T + Q

    def _associate(self, z: FloatArray, noise: FloatArray, clutter: FloatArray, sensor: Sensor) -> Flags:
        """Give each chain the detection that speaks most for it, unless one with a greater score takes it.

        Returns which detections were given.
        """
        is_assigned = np.zeros(len(z), np.bool_)
        detected = min(sensor.detection_probability, _MAX_DETECTION)
        missed = sensors.covers(sensor, self._mean[:, :2])
        chain, detection, innovation, S = self._pairs(z, noise)
        if chain.size and detected > 0.0:
            chi2 = np.einsum("pi,pij,pj->p", innovation, np.linalg.inv(S), innovation)
            ratio = math.log(detected / (2.0 * math.pi)) - 0.5 * (chi2 + np.log(np.linalg.det(S)))
            ratio -= np.log(clutter[detection])
            pair = np.flatnonzero(chi2 <= _GATE_CHI2)
            pair = _first_of_each(pair[np.argsort(-ratio[pair], kind="stable")], chain)
            pair = _first_of_each(pair[np.argsort(-self._score[chain[pair]], kind="stable")], detection)
            hit = chain[pair]
            is_assigned[detection[pair]], missed[hit] = True, False
            self._score[hit] = np.minimum(self._score[hit] + ratio[pair], _MAX_SCORE)
            K = self._cov[hit, :, :2] @ np.linalg.inv(S[pair])
            self._mean[hit] += (K @ innovation[pair][:, :, None])[:, :, 0]
            self._cov[hit] -= K @ self._cov[hit, :2]
        self._score[missed] += math.log1p(-detected)
        return is_assigned

    def _pairs(self, z: FloatArray, noise: FloatArray) -> tuple[Ints, Ints, FloatArray, FloatArray]:
        """Return chain, detection, innovation and its covariance of all pairs that may be near each other."""
        spread_m2 = np.trace(self._cov[:, :2, :2], axis1=1, axis2=2)[:, None]
        innovation = z[None] - self._mean[:, None, :2]
        reach_m2 = _GATE_CHI2 * (spread_m2 + np.trace(noise, axis1=1, axis2=2))
        chain, detection = np.nonzero((innovation**2).sum(axis=2) <= reach_m2)
        return chain, detection, innovation[chain, detection], self._cov[chain, :2, :2] + noise[detection]

    def _keep(self, kept: Flags) -> None:
        self._mean, self._cov = self._mean[kept], self._cov[kept]
        self._score, self._found = self._score[kept], self._found[kept]

    def _begin(self, z: FloatArray, noise: FloatArray) -> None:
        n = min(len(z), _MAX_CHAINS - self._score.size)
        if n <= 0:
            return
        cov = np.zeros((n, 4, 4))
        cov[:, :2, :2] = noise[:n]
        cov[:, [2, 3], [2, 3]] = _SPEED_STD_M_S**2
        self._mean = np.concatenate([self._mean, np.hstack([z[:n], np.zeros((n, 2))])])
        self._cov = np.concatenate([self._cov, cov])
        self._score = np.concatenate([self._score, np.zeros(n)])
        self._found = np.concatenate([self._found, np.zeros(n, np.bool_)])


def _first_of_each(pair: Ints, of: Ints) -> Ints:
    """Return the pairs that come first of those with their chain, or with their detection."""
    _, first = np.unique(of[pair], return_index=True)
    return pair[np.sort(first)]
