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

Clutter is uniform in what a sensor measures. Intensities are given per m2 on the map to whoever compares
sensors and kinds; a cell of range and bearing dr x db covers r dr db there, so lambda(r, b) = r lambda(east,
north).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gcs.compiling import inlined, kernel
from gcs.model import FloatArray, Polar, Sensor, read_only

if TYPE_CHECKING:
    import numpy.typing as npt

MOST_DETECTION = 0.999
"""Of a sensor that calls itself perfect: no gate is, and one miss must not be a death certificate."""
_LEAST_RANGE_M = 1e-3
"""Nearer, a bearing means nothing, and clutter per m2 would be infinite."""
_TWO_PI = 2.0 * math.pi
_EYE = np.eye(2).reshape(1, 2, 2)
_EVERYWHERE = np.array([[-math.inf, math.inf], [-math.inf, math.inf]])


class View(NamedTuple):
    """How n predicted tracks are seen; where they share `A` and `noise`, these are (1, 2, 2)."""

    z_hat: FloatArray
    """(n, 2) what it would measure."""
    A: FloatArray
    """(n or 1, 2, 2) how that changes with the position."""
    noise: FloatArray
    """(n or 1, 2, 2) covariance of the rest."""
    inside: FloatArray
    """(n,) probability that the track is in the field of view."""
    p_d: float
    """Detection probability in there."""
    wraps: bool
    """Whether the second coordinate is an angle."""


@inlined
def wrapped(angle_rad: Any) -> Any:
    """Return the same angle in [-pi, pi]."""
    return angle_rad - _TWO_PI * np.rint(angle_rad / _TWO_PI)


@inlined
def _share(centre: float, std: float, low: float, high: float) -> float:
    """Probability of a Gaussian between two bounds."""
    if low <= centre - 6.0 * std and centre + 6.0 * std <= high:
        return 1.0
    scale = math.sqrt(2.0) * max(std, 1e-12)
    return 0.5 * (math.erf((high - centre) / scale) - math.erf((low - centre) / scale))


@kernel
def _inside_box(mean: FloatArray, cov: FloatArray, field: FloatArray) -> Any:
    """Probability that each track is within `field` (2, 2), least and greatest of each coordinate."""
    inside = np.empty(mean.shape[0])
    for t in range(inside.size):
        inside[t] = 1.0
        for i in range(2):
            inside[t] *= _share(mean[t, i], math.sqrt(cov[t, i, i]), field[i, 0], field[i, 1])
    return inside


@kernel
def _range_bearing(
    mean: FloatArray, cov: FloatArray, place: FloatArray, R: FloatArray, field: FloatArray, centre_rad: float
) -> Any:
    """Unscented view of each track; `field` bounds the range, and the bearing relative to `centre_rad`."""
    n = mean.shape[0]
    z_hat, A, noise, inside = np.empty((n, 2)), np.empty((n, 2, 2)), np.empty((n, 2, 2)), np.empty(n)
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
            dz[i, 0], dz[i, 1] = math.hypot(px, py) - r0, wrapped(math.atan2(px, py) - b0)
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
        noise[t, 0, 0] = R[0, 0] + max(s00 - (c00 * c00 + c01 * c01) / 3.0, 0.0)
        noise[t, 1, 1] = R[1, 1] + max(s11 - (c10 * c10 + c11 * c11) / 3.0, 0.0)
        noise[t, 0, 1] = noise[t, 1, 0] = R[0, 1] + s01 - (c00 * c10 + c01 * c11) / 3.0
        z_hat[t, 0], z_hat[t, 1] = r0 + m0, wrapped(b0 + m1)
        inside[t] = _share(z_hat[t, 0], math.sqrt(s00), field[0, 0], field[0, 1])
        if field[1, 1] < math.pi:
            inside[t] *= _share(wrapped(z_hat[t, 1] - centre_rad), math.sqrt(s11), field[1, 0], field[1, 1])
    return z_hat, A, noise, inside


def view(sensor: Sensor, mean: FloatArray, cov: FloatArray) -> View:
    """Return how a sensor sees tracks with means (n, 4) and covariances (n, 4, 4)."""
    p_d = min(float(sensor.detection_probability), MOST_DETECTION)
    polar = sensor.polar
    if polar is None:
        noise = np.array(sensor.noise_cov_m2, dtype=np.float64).reshape(1, 2, 2)
        inside = _inside_box(mean, cov, _box(sensor))
        return View(np.ascontiguousarray(mean[:, :2]), _EYE, noise, inside, p_d, wraps=False)
    R = np.diag([polar.range_std_m**2, polar.bearing_std_rad**2])
    half_rad = polar.bearing_rad[1]
    field = np.array([polar.range_m, (-half_rad, half_rad)])
    place = np.array([polar.east_m, polar.north_m])
    z_hat, A, noise, inside = _range_bearing(mean, cov, place, R, field, float(polar.bearing_rad[0]))
    return View(z_hat, A, noise, inside, p_d, wraps=True)


def measured(sensor: Sensor, z_m: FloatArray) -> FloatArray:
    """Return what the sensor measured (m, 2) of detections given as east/north: range and bearing."""
    if sensor.polar is None:
        return z_m
    x, y = z_m[:, 0] - sensor.polar.east_m, z_m[:, 1] - sensor.polar.north_m
    return np.column_stack([np.hypot(x, y), np.arctan2(x, y)])


def on_map(polar: Polar, z: FloatArray) -> FloatArray:
    """Return east/north (m, 2) of ranges and bearings (m, 2)."""
    range_m, bearing_rad = z.T
    return np.column_stack(
        [polar.east_m + range_m * np.sin(bearing_rad), polar.north_m + range_m * np.cos(bearing_rad)]
    )


def sector(
    place_m: tuple[float, float],
    stds: tuple[float, float],
    range_m: tuple[float, float],
    sector_deg: tuple[float, float],
    clutter_per_scan: float,
) -> Polar:
    """Return the geometry of a range/bearing sensor as its maker states it.

    Parameters
    ----------
    place_m
        East and north of the sensor.
    stds
        Of the range in metres, of the bearing in degrees.
    range_m
        Least and greatest range.
    sector_deg
        Its centre, clockwise from north, and its width.
    clutter_per_scan
        Uniform over range and bearing.
    """
    half_rad = math.radians(sector_deg[1]) / 2.0
    return Polar(
        *place_m,
        stds[0],
        math.radians(stds[1]),
        range_m,
        (math.radians(sector_deg[0]), half_rad),
        clutter_per_scan / ((range_m[1] - range_m[0]) * 2.0 * half_rad),
    )


def polar_sensor(name: str, detection_probability: float, polar: Polar) -> Sensor:
    """Return a range/bearing sensor, with what those need to know who only draw."""
    middle_m = max(0.5 * (polar.range_m[0] + polar.range_m[1]), _LEAST_RANGE_M)
    variance_m2 = 0.5 * (polar.range_std_m**2 + (middle_m * polar.bearing_std_rad) ** 2)
    centre_rad, half_rad = polar.bearing_rad
    # The box around a sector: its ends, and the compass points that lie in it.
    turns = np.array(
        [-half_rad, half_rad, *(math.remainder(k * math.pi / 2 - centre_rad, _TWO_PI) for k in range(4))]
    )
    turns = turns[np.abs(turns) <= half_rad + 1e-12]
    corners = np.array([(range_m, centre_rad + turn) for range_m in polar.range_m for turn in turns])
    (west, south), (east, north) = (f(on_map(polar, corners), axis=0).tolist() for f in (np.min, np.max))
    return Sensor(
        name,
        detection_probability,
        polar.clutter_per_m_rad / middle_m,
        read_only(np.eye(2) * variance_m2),
        (west, south, east, north),
        polar,
    )


def clutter_per_m2(sensor: Sensor, z_m: FloatArray) -> FloatArray:
    """Return the sensor's clutter intensity (m,) at detections (m, 2), per m2 on the map."""
    if sensor.polar is None:
        return np.full(len(z_m), float(sensor.clutter_density_per_m2))
    return sensor.polar.clutter_per_m_rad / cell_m2(sensor, z_m)


def cell_m2(sensor: Sensor, z_m: FloatArray) -> FloatArray:
    """Return the area on the map (m,) of a unit cell of what the sensor measures, at detections (m, 2)."""
    if sensor.polar is None:
        return np.ones(len(z_m))
    return np.maximum(
        np.hypot(z_m[:, 0] - sensor.polar.east_m, z_m[:, 1] - sensor.polar.north_m), _LEAST_RANGE_M
    )


def noise_m2(sensor: Sensor, z_m: FloatArray) -> FloatArray:
    """Return the covariances (m, 2, 2) of detections (m, 2) on the map."""
    if sensor.polar is None:
        return np.broadcast_to(sensor.noise_cov_m2, (len(z_m), 2, 2))
    range_m, bearing_rad = measured(sensor, z_m).T
    sin, cos = np.sin(bearing_rad), np.cos(bearing_rad)
    along = np.stack([sin, cos], axis=-1)
    across = np.stack([cos, -sin], axis=-1)
    return np.asarray(
        sensor.polar.range_std_m**2 * along[:, :, None] * along[:, None, :]
        + (np.maximum(range_m, _LEAST_RANGE_M) * sensor.polar.bearing_std_rad)[:, None, None] ** 2
        * (across[:, :, None] * across[:, None, :])
    )


def covers(sensor: Sensor, places_m: FloatArray) -> npt.NDArray[np.bool_]:
    """Return whether each place (n, 2) lies in the field of view."""
    if sensor.polar is None:
        (west, east), (south, north) = _box(sensor)
        x, y = places_m[:, 0], places_m[:, 1]
        return np.asarray((west <= x) & (x <= east) & (south <= y) & (y <= north))
    range_m, bearing_rad = measured(sensor, places_m).T
    centre_rad, half_rad = sensor.polar.bearing_rad
    off_rad = np.abs(np.angle(np.exp(1j * (bearing_rad - centre_rad))))
    least_m, most_m = sensor.polar.range_m
    return np.asarray((least_m <= range_m) & (range_m <= most_m) & (off_rad <= half_rad + 1e-12))


def expected_clutter(sensor: Sensor) -> float:
    """Return the mean number of false detections in a scan; infinite for a field of view without an end."""
    if sensor.polar is None:
        (west, east), (south, north) = _box(sensor)
        return float(sensor.clutter_density_per_m2 * (east - west) * (north - south))
    least_m, most_m = sensor.polar.range_m
    half_rad = min(sensor.polar.bearing_rad[1], math.pi)
    return sensor.polar.clutter_per_m_rad * (most_m - least_m) * 2.0 * half_rad


def _box(sensor: Sensor) -> FloatArray:
    """Return the bounds of a position sensor's field of view, a row for each coordinate."""
    west, south, east, north = sensor.field_of_view_m
    return np.array([[west, east], [south, north]], dtype=np.float64)


def warm_up_calls() -> list[tuple[Any, ...]]:
    """One call of every kernel, types as in a tracker."""
    mean, cov = np.zeros((1, 4)), np.eye(4).reshape(1, 4, 4)
    return [
        (_inside_box, mean, cov, _EVERYWHERE),
        (_range_bearing, mean, cov, np.zeros(2), np.eye(2), _EVERYWHERE, 0.0),
    ]
