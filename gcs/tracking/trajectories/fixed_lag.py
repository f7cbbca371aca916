"""Fixed-lag estimates while the tracker runs: at each scan the best estimate of L scans before.

The tracks of the estimate are followed back L scans along their association histories. Each starts there with
its Gaussian as of then, is filtered forward with its detections, and a Rauch-Tung-Striebel pass goes back
(`rts` has the equations). An object that was confirmed within the lag is there from its first detection on,
and clutter that was taken for an object is gone. Only the last scans are kept, and all tracks are computed at
once, so memory and time per scan are bounded.

Scans of one epoch, such as of several sensors, count once.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from gcs.model import FloatArray, IntArray, Sensor
from gcs.tracking.glmb.hypotheses import Clusters
from gcs.tracking.glmb.kalman import Interval
from gcs.tracking.glmb.marginals import map_tracks
from gcs.tracking.glmb.recursion import UpdateResult
from gcs.tracking.models import constant_velocity, coordinated_turn, measurement_model
from gcs.tracking.models.coordinated_turn import TurnModel
from gcs.tracking.models.measurement_model import SensorModel
from gcs.tracking.models.sensor_geometry import sensor_coordinates
from gcs.tracking.state_space.linearisation import Linearised, wrap
from gcs.tracking.state_space.recursion import update_states


class LagEstimates(NamedTuple):
    """Estimates of an earlier scan; n objects."""

    t_ns: int
    """Time of that scan."""
    label: IntArray
    """(n, 2) scan of birth, index of the birth in that scan."""
    mean: FloatArray
    """(n, 4)."""
    cov: FloatArray
    """(n, 4, 4)."""


class _Kept(NamedTuple):
    """A processed scan."""

    t_ns: int
    sensor: Sensor
    model: SensorModel
    interval: Interval
    result: UpdateResult


class _State(NamedTuple):
    """Gaussians of n tracks, with turn rates (n, 6), or (n, 0) without turns."""

    mean: FloatArray
    cov: FloatArray
    turn: FloatArray

    def joint(self) -> tuple[FloatArray, FloatArray]:
        """Return means (n, d) and covariances (n, d, d); the turn rate is a fifth state."""
        if not self.turn.shape[1]:
            return self.mean, self.cov
        n = len(self.mean)
        cov = np.empty((n, 5, 5))
        cov[:, :4, :4] = self.cov
        cov[:, 4, :4] = cov[:, :4, 4] = self.turn[:, 2:]
        cov[:, 4, 4] = self.turn[:, 1]
        return np.column_stack([self.mean, self.turn[:, 0]]), cov


class FixedLag:
    """The last scans of a tracker, and the estimates of `lag` epochs before the last one.

    Parameters
    ----------
    lag : int
        Lag in epochs, at least 1.
    turns : TurnModel, optional
        Turn model of the objects; without it they fly straight.
    """

    def __init__(self, lag: int, turns: TurnModel | None = None) -> None:
        self._lag = lag
        self._turns = turns
        self._kept: deque[_Kept] = deque()
        map_tracks(Clusters.example())  # compiled, or loaded, now and not at the first estimate

    def add_scan(
        self, t_ns: int, sensor: Sensor, model: SensorModel, interval: Interval, result: UpdateResult
    ) -> None:
        """Add a processed scan; forget those before the lag."""
        self._kept.append(_Kept(t_ns, sensor, model, interval, result))
        times = sorted({one.t_ns for one in self._kept})
        while len(times) > self._lag + 1 and self._kept[0].t_ns < times[-1 - self._lag]:
            self._kept.popleft()

    def estimates(self) -> LagEstimates | None:
        """Return the estimates; None before there are enough scans."""
        if len({one.t_ns for one in self._kept}) <= self._lag:
            return None
        first = max(i for i, one in enumerate(self._kept) if one.t_ns == self._kept[0].t_ns)
        kept = [one for i, one in enumerate(self._kept) if i >= first]
        tracks = self._histories(kept)
        start = kept[0].result.posterior
        turn = np.empty((tracks[0].size, 0)) if self._turns is None else start.turn[tracks[0]]
        state = _State(start.mean[tracks[0]], start.cov[tracks[0]], turn)
        mean, cov = self._smooth(state, kept[1:], tracks[1:])
        last = kept[-1].result.posterior
        label = last.labels[last.track_label[tracks[-1]]]
        order = np.lexsort(label.T[::-1])
        return LagEstimates(kept[0].t_ns, label[order], mean[order, :4], cov[order, :4, :4])

    @staticmethod
    def _histories(kept: list[_Kept]) -> list[IntArray]:
        """Return the track of each estimated object after each scan, if it is as old as the first scan."""
        tracks = [map_tracks(kept[-1].result.posterior.clusters)]
        for before, after in zip(kept[-2::-1], kept[:0:-1], strict=True):
            parent = after.result.parent[tracks[0]]
            is_old = parent < before.result.posterior.track_label.size
            tracks = [parent[is_old], *(one[is_old] for one in tracks)]
        return tracks

    def _smooth(
        self, state: _State, kept: list[_Kept], tracks: list[IntArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Filter forward from the first scan and back to it; return its means and covariances."""
        passes = []
        for one, track in zip(kept, tracks, strict=True):
            filtered = state.joint()
            state, F = self._predict(state, one.interval)
            passes.append((filtered, state.joint(), F))
            state = self._update(state, one, one.result.meas[track])
        mean, cov = state.joint()
        for (before, P), (predicted, P_predicted), F in reversed(passes):
            G = np.linalg.solve(P_predicted, F @ P).swapaxes(1, 2)
            mean = before + (G @ (mean - predicted)[:, :, None])[:, :, 0]
            cov = P + G @ (cov - P_predicted) @ G.swapaxes(1, 2)
        return mean, cov

    def _predict(self, state: _State, interval: Interval) -> tuple[_State, FloatArray]:
        """Return the prediction, and its Jacobian (n, d, d) or (d, d)."""
        dt_s = interval.dt_s
        turns = self._turns
        if dt_s == 0.0:
            return state, np.eye(4 if turns is None else 5)
        if turns is None:
            F = constant_velocity.transition(dt_s)
            return state._replace(mean=state.mean @ F.T, cov=F @ state.cov @ F.T + interval.Q), F
        moved = _State(
            *coordinated_turn.predict(*state, interval.Q, dt_s, turns.rate_std_rad_s, turns.time_s)
        )
        return moved, coordinated_turn.jacobians(
            state.joint()[0], np.full(len(state.mean), dt_s), turns.time_s
        )

    def _update(self, state: _State, kept: _Kept, meas: IntArray) -> _State:
        """Return the update of the tracks that have a detection."""
        z = sensor_coordinates(kept.sensor, kept.result.position_m)
        at = np.flatnonzero(meas >= 0)
        if not at.size:
            return state
        n = len(state.mean)
        linear = measurement_model.linearise(kept.model, state.mean, state.cov)
        A = np.zeros((n, 2, 4))
        A[:, :, :2] = linear.A
        noise = np.broadcast_to(linear.noise, (n, 2, 2))
        angles = () if kept.sensor.polar is None else (1,)
        innovation = wrap(z[meas[at]] - linear.z_hat[at], angles)
        measured = Linearised(linear.z_hat[at], A[at], noise[at])
        mean = state.mean.copy()
        cov = state.cov.copy()
        mean[at], cov[at] = update_states(state.mean[at], state.cov[at], measured, innovation)
        turn = state.turn
        if self._turns is not None:
            turn = coordinated_turn.update(
                state.cov, turn, np.arange(n), np.ascontiguousarray(meas), np.ascontiguousarray(z), linear
            )
        return _State(mean, cov, turn)
