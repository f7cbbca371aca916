"""Linearised measurement models: what a sensor measures of a predicted track, and if it is in view.

Every update uses the sensor as linear around each predicted track, with position p:

    z = z_hat + A (p - p_hat) + e,    e ~ N(0, noise)

For a position sensor this is exact with A = I. For range and bearing it is the unscented transform (Julier
& Uhlmann 2004) of the position at five points: z_hat is their mean, A = C' P^-1 their regression on the
position, and the rest adds to the noise. That is the unscented Kalman filter in terms of S = A P A' + noise
and K = P A' S^-1. Velocities are not measured, so an unscented transform of the whole state with kappa = 3
- n gives the same.

The field of view is a box or a sector. The probability that a track is inside is an integral over its
Gaussian, along each coordinate by itself. So a track at the edge is missed in part, and a track with a wide
Gaussian is missed where the sensor looks.

Terrain hides a part of the field of view (`gcs.model.Visibility`). The probability that a track is in sight
is the mean of the table over the Gaussian, by the Gauss-Hermite rule of three points an axis. While the mean
is out of sight, only `_HIDDEN_WEIGHT` of it counts: what is in sight of the Gaussian was missed before, and
a Gaussian cannot lose a part of itself. Otherwise many misses of a hidden track would end it.

=====================  ==================  =======  ========================================
LinearisedMeasurement  shape               dtype    meaning (n tracks)
=====================  ==================  =======  ========================================
z_hat                  (n, 2)              float64  expected measurement
A                      (n or 1, 2, 2)      float64  Jacobian by the position
noise                  (n or 1, 2, 2)      float64  covariance of the rest
p_in_fov               (n,)                float64  probability to be in the field of view
p_d                    float                        detection probability in there
has_bearing            bool                         True if the second coordinate is an angle
=====================  ==================  =======  ========================================
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.jit import called, inlined, kernel, leaf
from gcs.tracking.models.sensor_geometry import MAX_DETECTION_PROBABILITY, field_bounds_m

if TYPE_CHECKING:
    from gcs.model import Float32Array, FloatArray, Sensor

_TWO_PI = 2.0 * math.pi
_HIDDEN_WEIGHT = 0.05
_NO_TABLE: Float32Array = np.zeros((0, 0), np.float32)


class SensorModel(NamedTuple):
    """Sensor as kernels use it, all float64."""

    is_polar: bool
    """True if it measures range and bearing."""
    noise: FloatArray
    """(1, 2, 2) covariance of a measurement."""
    fov: FloatArray
    """(2, 2) bounds of each coordinate; of a bearing, relative to the centre."""
    position_m: FloatArray
    """(2,) position of a range/bearing sensor."""
    centre_rad: float
    """Bearing of the centre of its sector."""
    p_d: float
    """Detection probability in the field of view."""
    in_sight: Float32Array
    """(bearings, ranges) float32, share of an object's heights that terrain does not hide; empty: all."""
    sight_m: FloatArray
    """(3,) east and north of the sensor, and the distance of neighbouring ranges."""


class LinearisedMeasurement(NamedTuple):
    """Linearised measurement model of n predicted tracks (see the table above)."""

    z_hat: FloatArray
    A: FloatArray
    noise: FloatArray
    p_in_fov: FloatArray
    p_d: float
    has_bearing: bool


@inlined
def wrap_angle(angle_rad: float) -> float:
    """Return the same angle in [-pi, pi]."""
    return angle_rad - _TWO_PI * np.rint(angle_rad / _TWO_PI)


@inlined
def _probability_between(centre: float, std: float, low: float, high: float) -> float:
    """Return the probability of a Gaussian between two bounds."""
    if low <= centre - 6.0 * std and centre + 6.0 * std <= high:
        return 1.0
    scale = math.sqrt(2.0) * max(std, 1e-12)
    return 0.5 * (math.erf((high - centre) / scale) - math.erf((low - centre) / scale))


@leaf
def _fill_positions(
    mean: FloatArray, cov: FloatArray, fov: FloatArray, z_hat: FloatArray, p_in_fov: FloatArray
) -> None:
    everywhere = True
    for i in range(2):
        everywhere &= fov[i, 0] == -np.inf and fov[i, 1] == np.inf
    for t in range(p_in_fov.size):
        z_hat[t, 0] = mean[t, 0]
        z_hat[t, 1] = mean[t, 1]
        p_in_fov[t] = 1.0
        if not everywhere:
            for i in range(2):
                p_in_fov[t] *= _probability_between(mean[t, i], math.sqrt(cov[t, i, i]), fov[i, 0], fov[i, 1])


@called
def _position(mean: FloatArray, cov: FloatArray, fov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return expected measurements of a position sensor, and the probability to be in `fov`."""
    z_hat = np.empty((mean.shape[0], 2))
    p_in_fov = np.empty(mean.shape[0])
    _fill_positions(mean, cov, fov, z_hat, p_in_fov)
    return z_hat, p_in_fov


@called
def _range_bearing(
    mean: FloatArray, cov: FloatArray, place: FloatArray, R: FloatArray, fov: FloatArray, centre_rad: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the unscented model of each track; `fov` bounds range and relative bearing."""
    n = mean.shape[0]
    z_hat = np.empty((n, 2))
    A = np.empty((n, 2, 2))
    noise = np.empty((n, 2, 2))
    p_in_fov = np.empty(n)
    dp = np.zeros((5, 2))
    dz = np.zeros((5, 2))
    for t in range(n):
        x = mean[t, 0] - place[0]
        y = mean[t, 1] - place[1]
        r0 = math.hypot(x, y)
        b0 = math.atan2(x, y)
        l00 = math.sqrt(3.0 * max(cov[t, 0, 0], 1e-12))
        l10 = 3.0 * cov[t, 1, 0] / l00
        l11 = math.sqrt(max(3.0 * cov[t, 1, 1] - l10 * l10, 1e-12))
        dp[1, 0] = l00
        dp[1, 1] = l10
        dp[2, 1] = l11
        dp[3, 0] = -l00
        dp[3, 1] = -l10
        dp[4, 1] = -l11
        m0 = 0.0
        m1 = 0.0
        for i in range(1, 5):
            px = x + dp[i, 0]
            py = y + dp[i, 1]
            dz[i, 0] = math.hypot(px, py) - r0
            dz[i, 1] = wrap_angle(math.atan2(px, py) - b0)
            m0 += dz[i, 0] / 6.0
            m1 += dz[i, 1] / 6.0
        # Regression on the position through the factor: A L = C' L'^-1, column by column.
        c00 = (dz[1, 0] - dz[3, 0]) / 2.0
        c01 = (dz[2, 0] - dz[4, 0]) / 2.0
        c10 = (dz[1, 1] - dz[3, 1]) / 2.0
        c11 = (dz[2, 1] - dz[4, 1]) / 2.0
        A[t, 0, 1] = c01 / l11
        A[t, 1, 1] = c11 / l11
        A[t, 0, 0] = (c00 - A[t, 0, 1] * l10) / l00
        A[t, 1, 0] = (c10 - A[t, 1, 1] * l10) / l00
        s00 = 0.0
        s01 = 0.0
        s11 = 0.0
        for i in range(5):
            u = 1.0 / 3.0 if i == 0 else 1.0 / 6.0
            s00 += u * (dz[i, 0] - m0) ** 2
            s01 += u * (dz[i, 0] - m0) * (dz[i, 1] - m1)
            s11 += u * (dz[i, 1] - m1) ** 2
        noise[t, 0, 0] = R[0, 0, 0] + max(s00 - (c00 * c00 + c01 * c01) / 3.0, 0.0)
        noise[t, 1, 1] = R[0, 1, 1] + max(s11 - (c10 * c10 + c11 * c11) / 3.0, 0.0)
        noise[t, 0, 1] = noise[t, 1, 0] = R[0, 0, 1] + s01 - (c00 * c10 + c01 * c11) / 3.0
        z_hat[t, 0] = r0 + m0
        z_hat[t, 1] = wrap_angle(b0 + m1)
        p_in_fov[t] = _probability_between(z_hat[t, 0], math.sqrt(s00), fov[0, 0], fov[0, 1])
        if fov[1, 1] < math.pi:
            p_in_fov[t] *= _probability_between(
                wrap_angle(z_hat[t, 1] - centre_rad), math.sqrt(s11), fov[1, 0], fov[1, 1]
            )
    return z_hat, A, noise, p_in_fov


@leaf
def _hide_by_terrain(
    mean: FloatArray, cov: FloatArray, in_sight: Float32Array, sight_m: FloatArray, p_in_fov: FloatArray
) -> None:
    """Multiply the probabilities to be in the field of view by those to be in sight."""
    n_bearings, n_ranges = in_sight.shape
    for t in range(p_in_fov.size):
        l00 = math.sqrt(3.0 * max(cov[t, 0, 0], 1e-12))
        l10 = 3.0 * cov[t, 1, 0] / l00
        l11 = math.sqrt(max(3.0 * cov[t, 1, 1] - l10 * l10, 1e-12))
        total = 0.0
        at_mean = 0.0
        for i in range(-1, 2):
            for j in range(-1, 2):
                x = mean[t, 0] + i * l00 - sight_m[0]
                y = mean[t, 1] + i * l10 + j * l11 - sight_m[1]
                k = min(int(math.hypot(x, y) / sight_m[2] + 0.5), n_ranges - 1)
                turn = math.atan2(x, y) / _TWO_PI
                b = int((turn + 1.0) * n_bearings + 0.5) % n_bearings
                weight = (2.0 / 3.0 if i == 0 else 1.0 / 6.0) * (2.0 / 3.0 if j == 0 else 1.0 / 6.0)
                total += weight * in_sight[b, k]
                if i == 0 and j == 0:
                    at_mean = in_sight[b, k]
        if at_mean == 0.0:
            total *= _HIDDEN_WEIGHT
        if total < 1.0 - 1e-6:
            p_in_fov[t] *= total


@kernel
def linearise(sensor_model: SensorModel, mean: FloatArray, cov: FloatArray) -> LinearisedMeasurement:
    """Return the measurement model of tracks with means (n, 4) and covariances (n, 4, 4)."""
    if sensor_model.is_polar:
        z_hat, A, noise, p_in_fov = _range_bearing(
            mean, cov, sensor_model.position_m, sensor_model.noise, sensor_model.fov, sensor_model.centre_rad
        )
    else:
        z_hat, p_in_fov = _position(mean, cov, sensor_model.fov)
        A = np.zeros((1, 2, 2))
        noise = sensor_model.noise
        A[0, 0, 0] = A[0, 1, 1] = 1.0
    if sensor_model.in_sight.size > 0:
        _hide_by_terrain(mean, cov, sensor_model.in_sight, sensor_model.sight_m, p_in_fov)
    return LinearisedMeasurement(z_hat, A, noise, p_in_fov, sensor_model.p_d, sensor_model.is_polar)


def sensor_model(sensor: Sensor) -> SensorModel:
    """Return a sensor as kernels use it."""
    p_d = min(float(sensor.detection_probability), MAX_DETECTION_PROBABILITY)
    polar = sensor.polar
    in_sight: Float32Array = _NO_TABLE
    sight_m = np.zeros(3)
    seen = sensor.visibility
    if seen is not None:
        in_sight = seen.share
        sight_m = np.array([seen.east_m, seen.north_m, seen.range_step_m])
    if polar is None:
        noise = np.array(sensor.noise_cov_m2, dtype=np.float64, order="C").reshape(1, 2, 2)
        return SensorModel(
            is_polar=False,
            noise=noise,
            fov=field_bounds_m(sensor),
            position_m=np.zeros(2),
            centre_rad=0.0,
            p_d=p_d,
            in_sight=in_sight,
            sight_m=sight_m,
        )
    noise = np.diag([polar.range_std_m**2, polar.bearing_std_rad**2]).reshape(1, 2, 2)
    half_rad = polar.bearing_rad[1]
    fov = np.array([polar.range_m, (-half_rad, half_rad)], dtype=np.float64)
    position_m = np.array([polar.east_m, polar.north_m], dtype=np.float64)
    return SensorModel(True, noise, fov, position_m, float(polar.bearing_rad[0]), p_d, in_sight, sight_m)
