"""Kalman filter over a known association history, and Rauch-Tung-Striebel smoothers.

Filter: x_k|k-1 = F x, P_k|k-1 = F P F' + Q, then for a detection the gain K = P H' (H P H' + R)^-1 and the
Joseph form. Smoother (Rauch, Tung & Striebel 1965), with the gain G_k = P_k|k F' P_k+1|k^-1:

    x_k|n = x_k|k + G_k (x_k+1|n - x_k+1|k),    P_k|n = P_k|k + G_k (P_k+1|n - P_k+1|k) G_k'

The state is [east, north, v_east, v_north], and the turn rate as a
fifth element with a turn model. That filter is `coordinated_turn`, and its smoother linearises around the
filtered states. Sensors are linearised around each state (`models.measurement_model`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from gcs.jit import ZERO, Call, kernel, leaf
from gcs.model import FloatArray, IntArray, Sensor
from gcs.tracking.glmb.kalman import predict_track, update_track
from gcs.tracking.models import coordinated_turn, measurement_model
from gcs.tracking.models.coordinated_turn import TurnModel
from gcs.tracking.models.measurement_model import SensorModel, linearise
from gcs.tracking.models.sensor_geometry import sensor_coordinates


class FilterStep(NamedTuple):
    """One scan of an object's history."""

    dt_s: float
    """Time since the scan before."""
    F: FloatArray
    """(4, 4) transition from the last scan, at constant velocity."""
    Q: FloatArray
    """(4, 4) process noise since the last scan."""
    sensor: Sensor
    """Sensor of the scan."""
    z_m: FloatArray | None
    """(2,) detection, east and north; None for a miss."""


class FilterResult(NamedTuple):
    """Result of the filter over n scans; d is 4, or 5 with a turn model."""

    mean: FloatArray
    """(n, d)."""
    cov: FloatArray
    """(n, d, d)."""
    predicted_mean: FloatArray
    """(n, d) before the detection of each scan."""
    predicted_cov: FloatArray
    """(n, d, d)."""
    F: FloatArray
    """(n - 1, d, d) Jacobian of each state but the first by the one before."""


@leaf
def _store(
    mean: FloatArray, cov: FloatArray, turn: FloatArray, at: int, k: int, means: FloatArray, covs: FloatArray
) -> None:
    """Write a state, with its turn rate if there is a fifth element."""
    for i in range(4):
        means[at, k, i] = mean[0, i]
        for j in range(4):
            covs[at, k, i, j] = cov[0, i, j]
    if means.shape[2] == 5:
        means[at, k, 4] = turn[0, 0]
        covs[at, k, 4, 4] = turn[0, 1]
        for i in range(4):
            covs[at, k, i, 4] = covs[at, k, 4, i] = turn[0, 2 + i]


@kernel
def filter_path(
    mean: FloatArray,
    cov: FloatArray,
    dt_s: FloatArray,
    Q: FloatArray,
    z: FloatArray,
    sensor_index: IntArray,
    sensors: Any,
    turns: TurnModel,
) -> tuple[FloatArray, FloatArray]:
    """Return the states before and after each of n scans: means (2, n, d), covariances (2, n, d, d).

    `dt_s` (n,) is the time since the last scan, `Q` (n, 4, 4) its process noise, and `z` (n, 2) the
    measurement of the sensor `sensor_index` (n,), NaN for a miss. `sensors` is a `SensorModel` of arrays,
    one row per sensor.
    """
    n = dt_s.size
    has_turns = turns.rate_std_rad_s > 0.0
    one = np.zeros(1, np.int64)
    d = 5 if has_turns else 4
    means = np.empty((2, n, d))
    covs = np.empty((2, n, d, d))
    x = mean.reshape(1, 4).copy()
    P = cov.reshape(1, 4, 4).copy()
    w = np.zeros((1, 6))
    w[0, 1] = turns.rate_std_rad_s * turns.rate_std_rad_s
    for k in range(n):
        if k > 0 and dt_s[k] > 0.0:
            if has_turns:
                x, P, w = coordinated_turn.predict(x, P, w, Q[k], dt_s[k], turns.rate_std_rad_s, turns.time_s)
            else:
                before_x = x
                before_P = P
                x = np.empty((1, 4))
                P = np.empty((1, 4, 4))
                predict_track(before_x, before_P, ZERO, dt_s[k], Q[k], x, P)
        _store(x, P, w, ZERO, k, means, covs)
        if not np.isnan(z[k, 0]):
            s = sensor_index[k]
            sensor = SensorModel(
                sensors.is_polar[s], sensors.noise[s], sensors.fov[s], sensors.position_m[s],
                sensors.centre_rad[s], sensors.p_d[s], sensors.in_sight[s], sensors.sight_m[s],
            )  # fmt: skip
            meas_model = linearise(sensor, x, P)
            before_x = x
            before_P = P
            x = np.empty((1, 4))
            P = np.empty((1, 4, 4))
            update_track(before_x, before_P, ZERO, ZERO, z[k : k + 1], meas_model, x, P, ZERO)
            if has_turns:
                w = coordinated_turn.update(before_P, w, one, one, z[k : k + 1], meas_model)
        _store(x, P, w, ZERO + 1, k, means, covs)
    return means, covs


def warm_up_calls() -> list[Call]:
    """Return one call of every kernel, with the types of `run_filter`."""
    sensor = measurement_model.sensor_model(Sensor("", 0.9, 1e-6, np.eye(2), (0.0, 0.0, 1.0, 1.0)))
    sensors = SensorModel._make(np.array([field]) for field in sensor)
    zeros = np.zeros(1, np.int64)
    z = np.zeros((1, 2))
    Q = np.eye(4).reshape(1, 4, 4)
    return [(filter_path, np.zeros(4), np.eye(4), np.ones(1), Q, z, zeros, sensors, TurnModel(0.0, 1.0))]


def run_filter(
    mean: FloatArray, cov: FloatArray, steps: Sequence[FilterStep], turns: TurnModel | None = None
) -> FilterResult:
    """Filter from a prior (4,), (4, 4) at the time of the first scan, whose F and Q do not apply."""
    sensors = {id(step.sensor): step.sensor for step in steps}
    sensor_index = {identity: i for i, identity in enumerate(sensors)}
    # What terrain hides does not matter to a path whose measurements are known.
    models = [measurement_model.sensor_model(replace(sensor, visibility=None)) for sensor in sensors.values()]
    dt_s = np.array([step.dt_s for step in steps])
    z = np.full((len(steps), 2), np.nan)
    for k, step in enumerate(steps):
        if step.z_m is not None:
            z[k] = sensor_coordinates(step.sensor, step.z_m[None])[0]
    means, covs = filter_path(
        np.array(mean, dtype=np.float64),
        np.array(cov, dtype=np.float64, order="C"),
        dt_s,
        np.array([step.Q for step in steps]),
        z,
        np.array([sensor_index[id(step.sensor)] for step in steps]),
        SensorModel._make(map(np.array, zip(*models, strict=True))),
        turns or TurnModel(0.0, 1.0),
    )
    if turns is None:
        F = np.reshape([step.F for step in steps[1:]], (-1, 4, 4))
    else:
        F = coordinated_turn.jacobians(means[1, :-1], dt_s[1:], turns.time_s)
    return FilterResult(means[1], covs[1], means[0], covs[0], F)


def smooth_states(run: FilterResult) -> tuple[FloatArray, FloatArray]:
    """Return means (n, d) and covariances (n, d, d) given all scans."""
    n = len(run.mean)
    mean = run.mean.copy()
    cov = run.cov.copy()
    if n < 2:
        return mean, cov
    G = np.swapaxes(np.linalg.solve(run.predicted_cov[1:], run.F @ run.cov[:-1]), 1, 2)
    for k in range(n - 2, -1, -1):
        mean[k] += G[k] @ (mean[k + 1] - run.predicted_mean[k + 1])
        cov[k] += G[k] @ (cov[k + 1] - run.predicted_cov[k + 1]) @ G[k].T
    return mean, cov
