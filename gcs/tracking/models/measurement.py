"""How a sensor sees a track: what it would measure there, how sharply, and whether it looks there at all.

Every filter here updates by a *view*: the sensor as if it were linear around each predicted track,

    z = z_hat + A (p - p_hat) + e,    e ~ N(0, noise),

p being the position. For a sensor that reports positions this is exact, with A = I. For one that reports
range and bearing it comes from the unscented transform (Julier & Uhlmann 2004) of the position, whose
Gaussian is carried through the measurement by five points: z_hat is their mean, A = C' P^-1 their regression
on the position, and what the line leaves over adds to the noise. That is the unscented Kalman filter, written
so that association and update need not know of it: S = A P A' + noise, K = P A' S^-1, the Joseph form. (The
points of an unscented transform of the whole state with kappa = 3 - n give the same, as velocities are not
measured.) Where a track's spread is wide for its range, it is nearer to the truth than an extended filter,
though not exact either; and it survives a track over the sensor.

A sensor looks at a field: a box on the map, or a sector around it. How probable it is that a track is in
there is an integral over its Gaussian (along each coordinate by itself), not a question about its mean: at an
edge, a track is missed a little and may still be detected; one that is far outside is not missed at all; one
that may be anywhere, because it was not seen for long, is missed where the sensor looks.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from gcs.jit import called, inlined, kernel, leaf
from gcs.tracking.models.sensors import MAX_DETECTION_PROBABILITY, field_bounds_m

if TYPE_CHECKING:
    from gcs.model import FloatArray, Sensor

_TWO_PI = 2.0 * math.pi


class SensorModel(NamedTuple):
    """What kernels know of a sensor."""

    is_polar: bool
    """Whether it measures range and bearing."""
    noise: FloatArray
    """(1, 2, 2) covariance of what it measures."""
    fov: FloatArray
    """(2, 2) least and greatest of each coordinate in the field of view; of a bearing, off the centre."""
    position_m: FloatArray
    """(2,) where a polar one stands."""
    centre_rad: float
    """And which way it looks."""
    p_d: float
    """Detection probability in the field of view."""


class LinearisedMeasurement(NamedTuple):
    """How n predicted tracks are seen; where they share `A` and `noise`, these are (1, 2, 2)."""

    z_hat: FloatArray
    """(n, 2) what it would measure."""
    A: FloatArray
    """(n or 1, 2, 2) how that changes with the position."""
    noise: FloatArray
    """(n or 1, 2, 2) covariance of the rest."""
    p_in_fov: FloatArray
    """(n,) probability that the track is in the field of view."""
    p_d: float
    """Detection probability in there."""
    has_bearing: bool
    """Whether the second coordinate is an angle."""


@inlined
def wrap_angle(angle_rad: Any) -> Any:
    """Return the same angle in [-pi, pi]."""
    return angle_rad - _TWO_PI * np.rint(angle_rad / _TWO_PI)


@inlined
def _probability_between(centre: float, std: float, low: float, high: float) -> float:
    """Probability of a Gaussian between two bounds."""
    if low <= centre - 6.0 * std and centre + 6.0 * std <= high:
        return 1.0
    scale = math.sqrt(2.0) * max(std, 1e-12)
    return 0.5 * (math.erf((high - centre) / scale) - math.erf((low - centre) / scale))


@leaf
def _fill_positions(mean: FloatArray, cov: FloatArray, fov: FloatArray, z_hat: Any, p_in_fov: Any) -> None:
    everywhere = True
    for i in range(2):
        everywhere &= fov[i, 0] == -np.inf and fov[i, 1] == np.inf
    for t in range(p_in_fov.size):
        z_hat[t, 0], z_hat[t, 1], p_in_fov[t] = mean[t, 0], mean[t, 1], 1.0
        if not everywhere:
            for i in range(2):
                p_in_fov[t] *= _probability_between(mean[t, i], math.sqrt(cov[t, i, i]), fov[i, 0], fov[i, 1])


@called
def _position(mean: FloatArray, cov: FloatArray, fov: FloatArray) -> Any:
    """View of each track by a sensor that reports positions, and how probably it is within `field`."""
    z_hat, p_in_fov = np.empty((mean.shape[0], 2)), np.empty(mean.shape[0])
    _fill_positions(mean, cov, fov, z_hat, p_in_fov)
    return z_hat, p_in_fov


@called
def _range_bearing(
    mean: FloatArray, cov: FloatArray, place: FloatArray, R: FloatArray, fov: FloatArray, centre_rad: float
) -> Any:
    """Unscented view of each track; `field` bounds the range, and the bearing relative to `centre_rad`."""
    n = mean.shape[0]
    z_hat, A, noise, p_in_fov = np.empty((n, 2)), np.empty((n, 2, 2)), np.empty((n, 2, 2)), np.empty(n)
    dp, dz = np.zeros((5, 2)), np.zeros((5, 2))
    for t in range(n):
        x, y = mean[t, 0] - place[0], mean[t, 1] - place[1]
        r0, b0 = math.hypot(x, y), math.atan2(x, y)
        l00 = math.sqrt(3.0 * max(cov[t, 0, 0], 1e-12))
        l10 = 3.0 * cov[t, 1, 0] / l00
        l11 = math.sqrt(max(3.0 * cov[t, 1, 1] - l10 * l10, 1e-12))
        dp[1, 0], dp[1, 1], dp[2, 1] = l00, l10, l11
        dp[3, 0], dp[3, 1], dp[4, 1] = -l00, -l10, -l11
        m0, m1 = 0.0, 0.0
        for i in range(1, 5):
            px, py = x + dp[i, 0], y + dp[i, 1]
            dz[i, 0], dz[i, 1] = math.hypot(px, py) - r0, wrap_angle(math.atan2(px, py) - b0)
            m0 += dz[i, 0] / 6.0
            m1 += dz[i, 1] / 6.0
        # Regression on the position through the factor: A L = C' L'^-1, column by column.
        c00, c01 = (dz[1, 0] - dz[3, 0]) / 2.0, (dz[2, 0] - dz[4, 0]) / 2.0
        c10, c11 = (dz[1, 1] - dz[3, 1]) / 2.0, (dz[2, 1] - dz[4, 1]) / 2.0
        A[t, 0, 1], A[t, 1, 1] = c01 / l11, c11 / l11
        A[t, 0, 0], A[t, 1, 0] = (c00 - A[t, 0, 1] * l10) / l00, (c10 - A[t, 1, 1] * l10) / l00
        s00, s01, s11 = 0.0, 0.0, 0.0
        for i in range(5):
            u = 1.0 / 3.0 if i == 0 else 1.0 / 6.0
            s00 += u * (dz[i, 0] - m0) ** 2
            s01 += u * (dz[i, 0] - m0) * (dz[i, 1] - m1)
            s11 += u * (dz[i, 1] - m1) ** 2
        noise[t, 0, 0] = R[0, 0, 0] + max(s00 - (c00 * c00 + c01 * c01) / 3.0, 0.0)
        noise[t, 1, 1] = R[0, 1, 1] + max(s11 - (c10 * c10 + c11 * c11) / 3.0, 0.0)
        noise[t, 0, 1] = noise[t, 1, 0] = R[0, 0, 1] + s01 - (c00 * c10 + c01 * c11) / 3.0
        z_hat[t, 0], z_hat[t, 1] = r0 + m0, wrap_angle(b0 + m1)
        p_in_fov[t] = _probability_between(z_hat[t, 0], math.sqrt(s00), fov[0, 0], fov[0, 1])
        if fov[1, 1] < math.pi:
            p_in_fov[t] *= _probability_between(
                wrap_angle(z_hat[t, 1] - centre_rad), math.sqrt(s11), fov[1, 0], fov[1, 1]
            )
    return z_hat, A, noise, p_in_fov


@kernel
def linearise(sensor_model: SensorModel, mean: FloatArray, cov: FloatArray) -> LinearisedMeasurement:
    """How a sensor sees tracks with means (n, 4) and covariances (n, 4, 4)."""
    if sensor_model.is_polar:
        z_hat, A, noise, p_in_fov = _range_bearing(
            mean, cov, sensor_model.position_m, sensor_model.noise, sensor_model.fov, sensor_model.centre_rad
        )
    else:
        z_hat, p_in_fov = _position(mean, cov, sensor_model.fov)
        A, noise = np.zeros((1, 2, 2)), sensor_model.noise
        A[0, 0, 0] = A[0, 1, 1] = 1.0
    return LinearisedMeasurement(z_hat, A, noise, p_in_fov, sensor_model.p_d, sensor_model.is_polar)


def sensor_model(sensor: Sensor) -> SensorModel:
    """Return what kernels know of a sensor."""
    p_d = min(float(sensor.detection_probability), MAX_DETECTION_PROBABILITY)
    polar = sensor.polar
    if polar is None:
        noise = np.array(sensor.noise_cov_m2, dtype=np.float64, order="C").reshape(1, 2, 2)
        return SensorModel(
            is_polar=False,
            noise=noise,
            fov=field_bounds_m(sensor),
            position_m=np.zeros(2),
            centre_rad=0.0,
            p_d=p_d,
        )
    noise = np.diag([polar.range_std_m**2, polar.bearing_std_rad**2]).reshape(1, 2, 2)
    half_rad = polar.bearing_rad[1]
    fov = np.array([polar.range_m, (-half_rad, half_rad)], dtype=np.float64)
    position_m = np.array([polar.east_m, polar.north_m], dtype=np.float64)
    return SensorModel(True, noise, fov, position_m, float(polar.bearing_rad[0]), p_d)


def view(sensor: Sensor, mean: FloatArray, cov: FloatArray) -> LinearisedMeasurement:
    """Return how a sensor sees tracks with means (n, 4) and covariances (n, 4, 4)."""
    return cast(LinearisedMeasurement, linearise(sensor_model(sensor), mean, cov))
