"""Baseline trackers to compare the GLMB filter with, on filterpy's Kalman filter and RTS smoother.

- `NearestNeighbourTracker`: global nearest neighbour, the plainest tracker of several objects in clutter.
- `TrueAssociationTracker`: a Kalman filter for each true object, fed with its own detections. No tracker
  with this motion model can do better, except by chance.

Objects move straight at nearly constant velocity, also where the GLMB filter models turns. Detections are
positions on the map with the sensor's covariance there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from filterpy.kalman import KalmanFilter
from scipy.optimize import linear_sum_assignment

from gcs.model import NS_PER_S, FloatArray, IntArray, Label, Sensor
from gcs.tracking.glmb.params import Birth, GlmbParams
from gcs.tracking.models import constant_velocity
from gcs.tracking.models.sensor_geometry import covers, noise_m2

_GATE_CHI2: Final = 4.0**2
"""Squared Mahalanobis distance up to which a detection may belong to a track."""
_OUTSIDE_GATE: Final = 1e6
_CONFIRM_HITS = 2
"""A track is confirmed by so many detections in `_CONFIRM_SCANS`, else it ends."""
_CONFIRM_SCANS = 3
_MAX_MISSES: Final = 3
"""A confirmed track ends after so many scans in a row without a detection."""


class BaselinePath(NamedTuple):
    """States of one track, from its first to its last detection."""

    label: Label
    scan: IntArray
    """(n,) scan numbers of the tracker."""
    mean: FloatArray
    """(n, 4) east_m, north_m, v_east_m_s, v_north_m_s."""


class _Motion(NamedTuple):
    F: FloatArray
    Q: FloatArray


class _Track:
    """Kalman filter of one object, and all its steps."""

    def __init__(self, label: Label, mean: FloatArray, cov: FloatArray) -> None:
        self.label = label
        self.is_confirmed = False
        self.filter = KalmanFilter(4, 2)
        self.filter.x = mean.copy()
        self.filter.P = cov.copy()
        self.filter.H = np.eye(2, 4)
        self._scans: list[int] = []
        self._means: list[FloatArray] = []
        self._covs: list[FloatArray] = []
        self._motions: list[_Motion] = []
        self._is_hit: list[bool] = []
        """Of the scans that could have detected the object."""
        self._n_until_hit = 0
        """Steps up to the last detection."""

    @property
    def has_ended(self) -> bool:
        """True if the last scans do not confirm or continue the track."""
        if not self.is_confirmed:
            return len(self._is_hit) >= _CONFIRM_SCANS
        return not any(self._is_hit[-_MAX_MISSES:])

    def add_step(self, scan: int, motion: _Motion, *, is_hit: bool, is_visible: bool = True) -> None:
        """Record the state after a scan; `is_visible` is True if the sensor covers the object."""
        self._scans.append(scan)
        self._means.append(self.filter.x.copy())
        self._covs.append(self.filter.P.copy())
        self._motions.append(motion)
        if is_hit:
            self._n_until_hit = len(self._scans)
        if is_hit or is_visible:
            self._is_hit.append(is_hit)
        self.is_confirmed |= sum(self._is_hit[-_CONFIRM_SCANS:]) >= _CONFIRM_HITS

    def path(self, *, smooth: bool, lag_scans: int | None) -> BaselinePath:
        """Return the states up to the last detection; see `_Baseline.paths`."""
        n = self._n_until_hit
        means = np.array(self._means[:n])
        covs = np.array(self._covs[:n])
        motions = self._motions[:n]

        def smoothed(first: int, end: int) -> FloatArray:
            F, Q = zip(*motions[first:end], strict=True)
            return np.asarray(self.filter.rts_smoother(means[first:end], covs[first:end], F, Q)[0])

        if smooth and lag_scans is None:
            means = smoothed(0, n)
        elif smooth and lag_scans is not None:
            means = np.array([smoothed(k, min(n, k + lag_scans + 1))[0] for k in range(n)])
        return BaselinePath(self.label, np.array(self._scans[:n]), means)


class _Baseline:
    """Common part of the baselines: prediction of all tracks, and the start of new ones.

    Parameters
    ----------
    params : GlmbParams
        Only the process noise is used.
    unknown_speed_std_m_s : float, optional
        Standard deviation of the velocity of objects that appear anywhere; None: only at birth components.
    """

    def __init__(self, params: GlmbParams, unknown_speed_std_m_s: float | None = None) -> None:
        self.scans = 0
        self._params = params
        self._unknown_speed_std_m_s = unknown_speed_std_m_s
        self._t_ns = 0
        self._tracks: list[_Track] = []
        self._ended: list[_Track] = []

    def paths(self, *, smooth: bool = False, lag_scans: int | None = None) -> list[BaselinePath]:
        """Return the path of each confirmed track.

        Parameters
        ----------
        smooth
            True for a Rauch-Tung-Striebel pass; False for the filtered states.
        lag_scans
            Scans of the track that the smoother looks ahead; None: all.
        """
        tracks = [track for track in (*self._ended, *self._tracks) if track.is_confirmed]
        return [track.path(smooth=smooth, lag_scans=lag_scans) for track in tracks]

    def _predict(self, t_ns: int) -> _Motion:
        dt_s = (t_ns - self._t_ns) / NS_PER_S if self.scans else 0.0
        motion = _Motion(
            constant_velocity.transition(dt_s),
            self._params.process_noise(dt_s),
        )
        for track in self._tracks:
            track.filter.predict(F=motion.F, Q=motion.Q)
        self._t_ns = t_ns
        self.scans = self.scans + 1
        return motion

    def _start(self, label: Label, z_m: FloatArray, R: FloatArray, births: Sequence[Birth]) -> _Track | None:
        """Return a track that starts at a detection, None where no object can appear."""
        distances = [_distance_chi2(birth.mean, birth.cov, z_m[None], R[None])[0] for birth in births]
        if births and min(distances) <= _GATE_CHI2:
            birth = births[int(np.argmin(distances))]
            track = _Track(label, birth.mean, birth.cov)
            track.filter.update(z_m, R=R)
            return track
        if self._unknown_speed_std_m_s is None:
            return None
        cov = np.eye(4) * self._unknown_speed_std_m_s**2
        cov[:2, :2] = R
        return _Track(label, np.array([*z_m, 0.0, 0.0]), cov)


class NearestNeighbourTracker(_Baseline):
    """Global nearest neighbour: each track gets at most one detection within 4 sigma.

    The assignment has the least sum of squared Mahalanobis distances. A detection without a track starts one
    within 4 sigma of a birth component, or anywhere. Two detections in three scans confirm a track. It ends
    after three scans in a row without a detection.
    """

    def update(self, t_ns: int, z_m: FloatArray, sensor: Sensor, births: Sequence[Birth]) -> None:
        """Process a scan of detections (m, 2). Late scans and detections that are not finite are left out."""
        if t_ns < self._t_ns:
            return
        z_m = z_m[np.isfinite(z_m).all(axis=1)]
        R = noise_m2(sensor, z_m)
        motion = self._predict(t_ns)
        scan = self.scans - 1
        pairs = self._assign(z_m, R)
        for i, track in enumerate(self._tracks):
            if i in pairs:
                track.filter.update(z_m[pairs[i]], R=R[pairs[i]])
            is_visible = bool(covers(sensor, track.filter.x[None, :2])[0])
            track.add_step(scan, motion, is_hit=i in pairs, is_visible=is_visible)
        self._ended += [track for track in self._tracks if track.has_ended]
        self._tracks = [track for track in self._tracks if not track.has_ended]
        for j in sorted(set(range(len(z_m))) - set(pairs.values())):
            started = self._start((scan, j), z_m[j], R[j], births)
            if started is not None:
                started.add_step(scan, motion, is_hit=True)
                self._tracks.append(started)

    def estimates(self) -> dict[Label, FloatArray]:
        """Return the state (4,) of each confirmed track, by label."""
        return {track.label: track.filter.x.copy() for track in self._tracks if track.is_confirmed}

    def _assign(self, z_m: FloatArray, R: FloatArray) -> dict[int, int]:
        """Return the detection of each track that gets one."""
        cost = np.full((len(self._tracks), len(z_m)), _OUTSIDE_GATE)
        for row, track in zip(cost, self._tracks, strict=True):
            distances = _distance_chi2(track.filter.x, track.filter.P, z_m, R)
            row[distances <= _GATE_CHI2] = distances[distances <= _GATE_CHI2]
        rows, columns = linear_sum_assignment(cost)
        return {
            i: j for i, j in zip(rows.tolist(), columns.tolist(), strict=True) if cost[i, j] < _OUTSIDE_GATE
        }


class TrueAssociationTracker(_Baseline):
    """A Kalman filter for each true object, fed with its own detections only.

    A track exists from the first to the last detection of its object.
    """

    def update(
        self, t_ns: int, z_m: FloatArray, sensor: Sensor, births: Sequence[Birth], origin: FloatArray
    ) -> None:
        """Process a scan of detections (m, 2); `origin` (m,) numbers their true objects, 0 for clutter."""
        if t_ns < self._t_ns:
            return
        is_own = np.isfinite(z_m).all(axis=1) & np.isfinite(origin) & (origin > 0)
        R = noise_m2(sensor, z_m)
        motion = self._predict(t_ns)
        scan = self.scans - 1
        row_of = {int(origin[i]): int(i) for i in np.flatnonzero(is_own)}
        for track in self._tracks:
            row = row_of.pop(track.label[1], None)
            if row is not None:
                track.filter.update(z_m[row], R=R[row])
            track.add_step(scan, motion, is_hit=row is not None)
        for number, row in row_of.items():
            started = self._start((0, number), z_m[row], R[row], births)
            if started is not None:
                started.add_step(scan, motion, is_hit=True)
                started.is_confirmed = True
                self._tracks.append(started)


def _distance_chi2(mean: FloatArray, cov: FloatArray, z_m: FloatArray, R: FloatArray) -> FloatArray:
    """Return the squared Mahalanobis distances (m,) of detections from a state."""
    offset = z_m - mean[:2]
    return np.asarray((offset * np.linalg.solve(cov[:2, :2] + R, offset[..., None])[..., 0]).sum(axis=1))
