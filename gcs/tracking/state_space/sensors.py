"""Detections of a scan with a user's sensor model; those that are not finite are skipped."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from gcs.model import BoolArray, FloatArray, Sensor
from gcs.tracking.glmb.scan_detections import scan_measurements
from gcs.tracking.models import measurement_model
from gcs.tracking.models.sensor_geometry import MAX_DETECTION_PROBABILITY
from gcs.tracking.state_space.linearisation import Linearised, linearise
from gcs.tracking.state_space.models import MeasurementModel

_MIN_CLUTTER: Final = 1e-300


class Measured(NamedTuple):
    """What a sensor is expected to measure of R predicted tracks."""

    model: Linearised
    """z_hat (R, k), A (R, k, d), and as `rest` the noise (R, k, k)."""
    S: FloatArray
    """(R, k, k) covariance of the innovation."""
    p_in_view: FloatArray
    """(R,) probability to be in view."""


class ScanModel(NamedTuple):
    """Usable detections of a scan, and their sensor."""

    z: FloatArray
    """(m, k) in the sensor's coordinates."""
    log_clutter: FloatArray
    """(m,) log of the clutter intensity per unit of z, less the log-ratio of what else was measured."""
    p_d: float
    """Detection probability in view."""
    angles: tuple[int, ...]
    """Coordinates of z that are angles."""
    expect: Callable[[FloatArray, FloatArray], Measured]
    """Of means (R, d) and covariances (R, d, d)."""
    usable: BoolArray
    """(all,) True for each given detection that is finite: these m are above."""


def scan_model(
    sensor: Sensor | MeasurementModel, names: tuple[str, ...], z: FloatArray, log_ratio: FloatArray | None
) -> ScanModel:
    """Return the detections of a scan with their model.

    Parameters
    ----------
    names
        Names of the d states.
    z : (m, k) array
        Detections: of a `Sensor` (m, 2) east and north in metres, else in the coordinates of the model.
    log_ratio : (m,) array, optional
        Log-likelihood ratio of what else was measured of each detection, object against clutter.
    """
    if isinstance(sensor, MeasurementModel):
        rows, log_clutter, angles, expect = _own(sensor, z)
    else:
        rows, log_clutter, angles, expect = _planar(sensor, names, z)
    if log_ratio is not None:
        log_clutter = log_clutter - log_ratio
    usable = np.isfinite(rows).all(axis=1) & np.isfinite(log_clutter)
    p_d = min(float(sensor.detection_probability), MAX_DETECTION_PROBABILITY)
    return ScanModel(rows[usable], log_clutter[usable], p_d, angles, expect, usable)


_Parts: TypeAlias = tuple[
    FloatArray, FloatArray, tuple[int, ...], Callable[[FloatArray, FloatArray], Measured]
]


def _own(sensor: MeasurementModel, z: FloatArray) -> _Parts:
    z = np.array(z, np.float64)
    if z.size and (z.ndim != 2 or z.shape[1] != sensor.size):
        raise ValueError(f"expected detections (m, {sensor.size}) of sensor {sensor.name}, got {z.shape}")
    z = z.reshape(-1, sensor.size)
    density = sensor.clutter_density
    clutter = np.broadcast_to(density(z) if callable(density) else density, (len(z),))

    def expect(mean: FloatArray, cov: FloatArray) -> Measured:
        model = linearise(sensor.expected, sensor.jacobian, mean, cov, sensor.angles)
        model = model._replace(rest=model.rest + sensor.noise_cov)
        in_view = np.ones(len(mean)) if sensor.in_view is None else sensor.in_view(mean)
        return _measured(model, cov, np.asarray(in_view, np.float64))

    return z, np.log(np.maximum(clutter, _MIN_CLUTTER)), sensor.angles, expect


def _planar(sensor: Sensor, names: tuple[str, ...], z_m: FloatArray) -> _Parts:
    at = [names.index("x"), names.index("y")]
    kernel_model = measurement_model.sensor_model(sensor)
    found = scan_measurements(sensor, z_m, None)
    log_clutter = np.array(np.broadcast_to(found.log_clutter, (len(found.z),)))

    def expect(mean: FloatArray, cov: FloatArray) -> Measured:
        n, d = mean.shape
        planar_mean = np.zeros((n, 4))
        planar_mean[:, :2] = mean[:, at]
        planar_cov = np.zeros((n, 4, 4))
        planar_cov[:, :2, :2] = cov[:, at][:, :, at]
        linear = measurement_model.linearise(kernel_model, planar_mean, planar_cov)
        A = np.zeros((n, 2, d))
        A[:, :, at] = linear.A
        noise = np.broadcast_to(linear.noise, (n, 2, 2))
        return _measured(Linearised(linear.z_hat, A, noise), cov, linear.p_in_fov)

    return found.z, log_clutter, () if sensor.polar is None else (1,), expect


def _measured(model: Linearised, cov: FloatArray, p_in_view: FloatArray) -> Measured:
    S = model.A @ cov @ model.A.swapaxes(1, 2) + model.rest
    return Measured(model, 0.5 * (S + S.swapaxes(1, 2)), p_in_view)
