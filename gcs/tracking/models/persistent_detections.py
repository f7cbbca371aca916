"""Persistent detections: objects where no birth component lets a track begin.

A detection that no track explains may begin a chain. Later detections near its predicted position add the
log-likelihood ratio of object against clutter to its score (Wald's sequential test; Bar-Shalom & Li,
"Multitarget-Multisensor Tracking", 1995, section 3.2). A miss subtracts from it. A chain with a negative
score ends. The score does not change where no sensor looks.

A chain is persistent from a score of 25 on. By Wald's bound, clutter reaches that less than once in 7e10
chains: far less than once a year. It takes five detections at 20 false detections a scan on 2 km x 2 km.

The chains are those of one sensor: another one that is blind or lies does not end them by its misses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gcs.model import NS_PER_S, BoolArray, FloatArray, IntArray, Sensor
from gcs.tracking.models import constant_velocity, sensor_geometry

_PERSISTENT_SCORE: Final = 25.0
_MAX_SCORE: Final = 35.0
_UNEXPLAINED: Final = 0.5
"""A detection below this probability of being explained belongs to no track."""
_GATE_CHI2: Final = 16.0
_SPEED_STD_M_S: Final = 10.0
_ACCEL_PSD_M2_S3: Final = 0.25
_MAX_DETECTION: Final = 0.98
"""Cap of the detection probability: one miss proves little."""
_MIN_CLUTTER_PER_M2: Final = 1e-9
_MAX_STD_M: Final = 200.0
"""Of a chain's position, where no sensor looks."""
_MAX_CHAINS: Final = 300


@dataclass(slots=True)
class PersistentDetections:
    """Chains of detections of one sensor without a track; n chains."""

    t_ns: int = 0
    """Time of the last scan."""
    mean: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    """(n, 4) east, north, v_east, v_north."""
    cov: FloatArray = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """(n, 4, 4)."""
    score: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(n,) log-likelihood ratio of object against clutter."""
    found: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))
    """(n,) True if the chain is persistent."""

    def __post_init__(self) -> None:
        n = self.score.size
        shapes = (self.mean.shape, self.cov.shape, self.score.shape, self.found.shape)
        if shapes != ((n, 4), (n, 4, 4), (n,), (n,)) or n > _MAX_CHAINS:
            raise ValueError("persistent detections: the chains are not valid")

    @property
    def places_m(self) -> FloatArray:
        """Positions (n, 2) of the persistent chains, east and north."""
        return np.asarray(self.mean[self.found, :2])

    def process_scan(
        self, t_ns: int, z_m: FloatArray, sensor: Sensor, explained: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Process a scan of the sensor.

        Returns positions (n, 2) of the chains that have just become persistent, and (m,) True for each
        detection that belongs to a persistent chain.

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
        z = z_m[unexplained]
        noise = sensor_geometry.noise_m2(sensor, z_m[unexplained])
        clutter = np.maximum(sensor_geometry.clutter_per_m2(sensor, z), _MIN_CLUTTER_PER_M2)
        chain = self._associate(z, noise, clutter, sensor)
        is_used = chain >= 0
        new = ~self.found & (self.score >= _PERSISTENT_SCORE)
        self.found |= new
        new_m = self.mean[new, :2]
        is_persistent = np.zeros(len(z_m), np.bool_)
        is_persistent[unexplained[is_used]] = self.found[chain[is_used]]
        self._keep((self.score >= 0.0) & (self.cov[:, [0, 1], [0, 1]].max(axis=1) <= _MAX_STD_M**2))
        self._begin(z[~is_used], noise[~is_used])
        return new_m, is_persistent

    def _predict(self, t_ns: int) -> None:
        dt_s = (t_ns - self.t_ns) / NS_PER_S if self.score.size else 0.0
        self.t_ns = t_ns
        F = constant_velocity.transition(dt_s)
        Q = constant_velocity.process_noise(dt_s, _ACCEL_PSD_M2_S3)
        self.mean = self.mean @ F.T
        self.cov = F @ self.cov @ F.T + Q

    def _associate(self, z: FloatArray, noise: FloatArray, clutter: FloatArray, sensor: Sensor) -> IntArray:
        """Update each chain with its likeliest detection, unless a chain with a greater score has it.

        Returns the chain of each detection, -1 for none.
        """
        chain_of = np.full(len(z), -1)
        detected = min(sensor.detection_probability, _MAX_DETECTION)
        missed = sensor_geometry.covers(sensor, self.mean[:, :2])
        chain, detection, innovation, S = self._pairs(z, noise)
        if chain.size and detected > 0.0:
            chi2 = np.einsum("pi,pij,pj->p", innovation, np.linalg.inv(S), innovation)
            ratio = math.log(detected / (2.0 * math.pi)) - 0.5 * (chi2 + np.log(np.linalg.det(S)))
            ratio -= np.log(clutter[detection])
            pair = np.flatnonzero(chi2 <= _GATE_CHI2)
            pair = _first_of_each(pair[np.argsort(-ratio[pair], kind="stable")], chain)
            pair = _first_of_each(pair[np.argsort(-self.score[chain[pair]], kind="stable")], detection)
            hit = chain[pair]
            chain_of[detection[pair]] = hit
            missed[hit] = False
            self.score[hit] = np.minimum(self.score[hit] + ratio[pair], _MAX_SCORE)
            K = self.cov[hit, :, :2] @ np.linalg.inv(S[pair])
            self.mean[hit] += (K @ innovation[pair][:, :, None])[:, :, 0]
            self.cov[hit] -= K @ self.cov[hit, :2]
        self.score[missed] += math.log1p(-detected)
        return chain_of

    def _pairs(self, z: FloatArray, noise: FloatArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Return chain, detection, innovation and its covariance of all pairs that may be in a gate."""
        spread_m2 = np.trace(self.cov[:, :2, :2], axis1=1, axis2=2)[:, None]
        innovation = z[None] - self.mean[:, None, :2]
        reach_m2 = _GATE_CHI2 * (spread_m2 + np.trace(noise, axis1=1, axis2=2))
        chain, detection = np.nonzero((innovation**2).sum(axis=2) <= reach_m2)
        return chain, detection, innovation[chain, detection], self.cov[chain, :2, :2] + noise[detection]

    def _keep(self, kept: BoolArray) -> None:
        self.mean = self.mean[kept]
        self.cov = self.cov[kept]
        self.score = self.score[kept]
        self.found = self.found[kept]

    def _begin(self, z: FloatArray, noise: FloatArray) -> None:
        n = min(len(z), _MAX_CHAINS - self.score.size)
        if n <= 0:
            return
        cov = np.zeros((n, 4, 4))
        cov[:, :2, :2] = noise[:n]
        cov[:, [2, 3], [2, 3]] = _SPEED_STD_M_S**2
        self.mean = np.concatenate([self.mean, np.hstack([z[:n], np.zeros((n, 2))])])
        self.cov = np.concatenate([self.cov, cov])
        self.score = np.concatenate([self.score, np.zeros(n)])
        self.found = np.concatenate([self.found, np.zeros(n, np.bool_)])


def _first_of_each(pair: IntArray, of: IntArray) -> IntArray:
    """Return the first pair of each chain, or of each detection."""
    _, first = np.unique(of[pair], return_index=True)
    return pair[np.sort(first)]
