"""Persistent detections: objects where no birth component lets a track begin.

A detection that no track explains may begin a chain. Later detections near its predicted position add the
log-likelihood ratio of object against clutter to its score (Wald's sequential test; Bar-Shalom & Li,
"Multitarget-Multisensor Tracking", 1995, section 3.2). A miss subtracts from it. A chain with a negative
score ends. The score does not change where no sensor looks.

A chain is persistent from a score of 25 on. By Wald's bound, clutter reaches that less than once in 7e10
chains: far less than once a year. It takes five detections at 20 false detections a scan on 2 km x 2 km.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gcs.model import NS_PER_S, BoolArray, FloatArray, IntArray, Sensor
from gcs.tracking.models import constant_velocity, sensors

_PERSISTENT_SCORE: Final = 25.0
_MAX_SCORE: Final = 35.0
_UNEXPLAINED: Final = 0.5
"""A detection below this probability of being explained belongs to no track."""
_GATE_CHI2: Final = 16.0
_SPEED_STD_M_S: Final = 10.0
_ACCEL_STD_M_S2: Final = 0.5
_MAX_DETECTION: Final = 0.98
"""Cap of the detection probability: one miss proves little."""
_MIN_CLUTTER_PER_M2: Final = 1e-9
_MAX_STD_M: Final = 200.0
"""Of a chain's position, where no sensor looks."""
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
        """Positions (n, 2) of the persistent chains, east and north."""
        return np.asarray(self._mean[self._found, :2])

    def process_scan(self, t_ns: int, z_m: FloatArray, sensor: Sensor, explained: FloatArray) -> FloatArray:
        """Process a scan; return positions (n, 2) of the chains that have just become persistent.

        Parameters
        ----------
        t_ns : int
            Time of measurement, not before that of the last scan.
        z_m : array
            (m, 2) detections, east and north.
        sensor : Sensor
            Sensor of the scan.
        explained : array
            (m,) probability that a track made each detection.
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

    def _associate(self, z: FloatArray, noise: FloatArray, clutter: FloatArray, sensor: Sensor) -> BoolArray:
        """Update each chain with its likeliest detection, unless a chain with a greater score has it.

        Returns True for each detection that was used.
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

    def _pairs(self, z: FloatArray, noise: FloatArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Return chain, detection, innovation and its covariance of all pairs that may be in a gate."""
        spread_m2 = np.trace(self._cov[:, :2, :2], axis1=1, axis2=2)[:, None]
        innovation = z[None] - self._mean[:, None, :2]
        reach_m2 = _GATE_CHI2 * (spread_m2 + np.trace(noise, axis1=1, axis2=2))
        chain, detection = np.nonzero((innovation**2).sum(axis=2) <= reach_m2)
        return chain, detection, innovation[chain, detection], self._cov[chain, :2, :2] + noise[detection]

    def _keep(self, kept: BoolArray) -> None:
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


def _first_of_each(pair: IntArray, of: IntArray) -> IntArray:
    """Return the first pair of each chain, or of each detection."""
    _, first = np.unique(of[pair], return_index=True)
    return pair[np.sort(first)]
