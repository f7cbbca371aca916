"""A wrong sensor model biases every radar track, loses objects at an edge, and confirms clutter."""

import math

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, JulierSigmaPoints, UnscentedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.model import NS_PER_S, Polar, Sensor
from gcs.tracking.glmb import kalman
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams
from gcs.tracking.models import sensor_geometry
from gcs.tracking.models.measurement_model import linearise, sensor_model, wrap_angle

FIELD = (-1000.0, -1000.0, 1000.0, 1000.0)
ALL_ROUND = (0.0, math.pi)


def radar(place=(0.0, 0.0), std=(5.0, 0.01), sector=ALL_ROUND, reach=(0.0, 3000.0), p_d=0.9, clutter=1e-3):
    polar = Polar(*place, *std, reach, sector, clutter)
    return Sensor("radar", p_d, 1e-6, np.eye(2) * 25.0, FIELD, polar)


def box(p_d=0.9):
    return Sensor("box", p_d, 1e-6, np.diag([9.0, 16.0]), FIELD)


def spd(rng, n, scale):
    root = rng.normal(0.0, 1.0, (n, n))
    return (root @ root.T + 0.1 * np.eye(n)) * np.outer(scale, scale)


def range_bearing(x):
    return np.array([math.hypot(x[0], x[1]), math.atan2(x[0], x[1])])


def jacobian(x):
    r = math.hypot(x[0], x[1])
    return np.array([[x[0] / r, x[1] / r, 0.0, 0.0], [x[1] / r**2, -x[0] / r**2, 0.0, 0.0]])


def residual(a, b):
    d = a - b
    d[1] = math.remainder(d[1], 2.0 * math.pi)
    return d


def updated(sensor, mean, cov, place_m):
    view = linearise(sensor_model(sensor), mean[None], cov[None])
    z = sensor_geometry.sensor_coordinates(sensor, np.reshape(place_m, (1, 2)))
    first = np.zeros(1, np.int64)
    new, new_cov = kalman.update_tracks(mean[None], cov[None], first, first, z, view)
    return new[0], new_cov[0]


@pytest.mark.parametrize("seed", range(8))
def test_the_update_is_that_of_filterpys_unscented_filter_also_across_south(seed):
    rng = np.random.default_rng(seed)
    bearing = rng.uniform(-0.02, 0.02) + math.pi if seed < 4 else rng.uniform(-3.0, 3.0)
    reach = rng.uniform(300.0, 2000.0)
    mean = np.array([reach * math.sin(bearing), reach * math.cos(bearing), *rng.normal(0, 10, 2)])
    cov = spd(rng, 4, np.array([8.0, 8.0, 3.0, 3.0]))
    place = mean[:2] + rng.normal(0.0, 10.0, 2)
    points = JulierSigmaPoints(4, kappa=-1.0)
    peer = UnscentedKalmanFilter(
        4, 2, 1.0, range_bearing, lambda x, _: x, points, z_mean_fn=mean_about(mean), residual_z=residual
    )
    peer.x = mean.copy()
    peer.P = cov.copy()
    peer.R = np.diag([25.0, 1e-4])
    peer.sigmas_f = points.sigma_points(peer.x, peer.P)
    peer.update(range_bearing(place))
    found, found_cov = updated(radar(), mean, cov, place)
    np.testing.assert_allclose(found, peer.x, atol=1e-6)
    np.testing.assert_allclose(found_cov, peer.P, atol=1e-6)


def mean_about(centre):
    """Mean of range and bearing, the bearings taken relative to that of the centre."""
    at = range_bearing(centre)

    def mean(points, weights):
        return at + sum(w * residual(p, at) for w, p in zip(weights, points, strict=True))

    return mean


def test_a_sharp_track_is_updated_as_by_filterpys_extended_filter():
    rng = np.random.default_rng(3)
    for _ in range(5):
        mean = np.array([*rng.uniform(500.0, 900.0, 2) * rng.choice([-1, 1], 2), 3.0, -4.0])
        cov = spd(rng, 4, np.array([0.3, 0.3, 1.0, 1.0]))
        place = mean[:2] + rng.normal(0.0, 0.5, 2)
        peer = ExtendedKalmanFilter(4, 2)
        peer.x = mean.copy()
        peer.P = cov.copy()
        peer.R = np.diag([25.0, 1e-4])
        peer.update(range_bearing(place), jacobian, range_bearing, residual=residual)
        found, found_cov = updated(radar(), mean, cov, place)
        np.testing.assert_allclose(found, peer.x, atol=2e-3)
        np.testing.assert_allclose(found_cov, peer.P, rtol=2e-3, atol=2e-3)


@settings(max_examples=200)
@given(
    seed=st.integers(0, 2**32 - 1),
    reach=st.sampled_from([0.0, 1e-9, 1.0, 30.0, 3000.0, 1e6]),
    std=st.sampled_from([1e-3, 1.0, 100.0, 1e5]),
    noise=st.sampled_from([(1e-2, 1e-5), (5.0, 0.02), (300.0, 3.0)]),
)
def test_any_track_seen_from_anywhere_keeps_a_sound_covariance(seed, reach, std, noise):
    rng = np.random.default_rng(seed)
    mean = np.array([*(reach * rng.normal(0.0, 1.0, 2)), *rng.normal(0.0, 10.0, 2)])
    cov = spd(rng, 4, np.array([std, std, 5.0, 5.0]))
    sensor = radar(std=noise)
    view = linearise(sensor_model(sensor), mean[None], cov[None])
    assert 0.0 <= view.p_in_fov[0] <= 1.0
    assert abs(view.z_hat[0, 1]) <= math.pi
    found, found_cov = updated(sensor, mean, cov, mean[:2] + std * rng.normal(0.0, 1.0, 2))
    assert np.isfinite(found).all()
    assert np.array_equal(found_cov, found_cov.T)
    scale = np.sqrt(np.diag(found_cov))
    assert np.linalg.eigvalsh(found_cov / np.outer(scale, scale)).min() > 0.0


@given(angle=st.floats(-1e3, 1e3))
def test_angles_wrap(angle):
    wrapped = wrap_angle.py_func(angle)
    assert abs(wrapped) <= math.pi + 1e-9
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


def test_the_clutter_of_a_sector_is_uniform_in_range_and_bearing():
    sensor = radar(place=(100.0, -50.0), sector=(2.0, 0.5), reach=(200.0, 1500.0), clutter=1e-2)
    rng = np.random.default_rng(0)
    places = rng.uniform(-1600.0, 1600.0, (400_000, 2)) + np.array([100.0, -50.0])
    inside = sensor_geometry.covers(sensor, places)
    total = sensor_geometry.clutter_per_m2(sensor, places[inside]).sum() * 3200.0**2 / len(places)
    assert total == pytest.approx(sensor_geometry.expected_clutter(sensor), rel=0.02)
    assert sensor_geometry.expected_clutter(sensor) == pytest.approx(1e-2 * 1300.0 * 1.0)


@pytest.mark.parametrize("sensor", [box(), radar(sector=(math.pi, 0.5), reach=(300.0, 900.0))])
def test_the_probability_in_view_is_the_integral_of_the_gaussian(sensor):
    """Against sampling: the edges of the field, its corners, and a sector that lies across south."""
    rng = np.random.default_rng(1)
    for centre in [(0.0, -300.0), (30.0, -880.0), (200.0, -500.0), (990.0, 980.0), (-1020.0, 0.0)]:
        mean = np.array([*centre, 0.0, 0.0])
        cov = np.diag([20.0**2, 25.0**2, 1.0, 1.0])
        draws = rng.multivariate_normal(mean[:2], cov[:2, :2], 20_000)
        found = linearise(sensor_model(sensor), mean[None], cov[None]).p_in_fov[0]
        assert found == pytest.approx(sensor_geometry.covers(sensor, draws).mean(), abs=0.05)


def test_noise_on_the_map_lies_along_and_across_the_line_of_sight():
    rng = np.random.default_rng(2)
    sensor = radar(place=(40.0, 10.0), std=(3.0, 0.01))
    place = np.array([640.0, 810.0])
    z = sensor_geometry.sensor_coordinates(sensor, place[None])[0] + rng.normal(0.0, (3.0, 0.01), (50_000, 2))
    draws = np.column_stack([40.0 + z[:, 0] * np.sin(z[:, 1]), 10.0 + z[:, 0] * np.cos(z[:, 1])])
    np.testing.assert_allclose(sensor_geometry.noise_m2(sensor, place[None])[0], np.cov(draws.T), rtol=0.05)


def fly(sensors_of, path, scans=20, seed=0, births=None, params=None):
    """Track one object along `path(t_s)`; a scan of each sensor every second, without clutter."""
    rng = np.random.default_rng(seed)
    tracker = Glmb("targets", params or GlmbParams(accel_psd_m2_s3=1.0), 0)
    start = np.array([*path(0.0), 0.0, 0.0])
    birth = Birth(start, np.diag([400.0, 400.0, 100.0, 100.0]), 0.1)
    for k in range(scans):
        place = np.array([path(float(k))])
        for i, sensor in enumerate(sensors_of):
            z = place[sensor_geometry.covers(sensor, place)]
            if sensor.polar is not None and len(z):
                r, b = sensor_geometry.sensor_coordinates(sensor, z)[0] + rng.normal(
                    0.0, (sensor.polar.range_std_m, sensor.polar.bearing_std_rad)
                )
                z = np.array([[math.sin(b), math.cos(b)]]) * r + (sensor.polar.east_m, sensor.polar.north_m)
            elif len(z):
                z = z + rng.normal(0.0, np.sqrt(np.diag(sensor.noise_cov_m2)), (1, 2))
            tracker.update(k * NS_PER_S, z, sensor, [birth] if k + i == 0 else ())
    return tracker


def test_an_object_that_passes_south_of_a_radar_keeps_its_label():
    tracker = fly([radar()], lambda t: (-300.0 + 30.0 * t, -500.0))
    (found,) = tracker.estimate()
    assert found.label == (0, 0)
    assert found.mean[:2] == pytest.approx((270.0, -500.0), abs=15.0)


def test_radars_of_crossing_sight_see_sharper_than_each_alone():
    far = radar(place=(0.0, 2000.0), std=(3.0, 0.03))
    here = radar(place=(2000.0, 0.0), std=(3.0, 0.03))
    spread = [
        np.trace(fly(those, lambda t: (20.0 * t, 10.0)).estimate()[0].cov[:2, :2])
        for those in ([far], [here], [far, here])
    ]
    assert spread[2] < 0.3 * min(spread[:2])
