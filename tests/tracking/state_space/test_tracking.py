"""Several objects are tracked with a user's models: the same labels and states as with ours, and better ones
where a model says more."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.tracking import (
    Birth,
    GlmbParams,
    MeasurementModel,
    Sensor,
    SwitchingMotion,
    TrackingModel,
    constant_velocity,
    linear_measurement,
    map_coordinates,
    ospa,
    polar_sensor,
    sector,
    track,
)

FIELD_M = (-1000.0, -1000.0, 1000.0, 1000.0)
CAMERA = Sensor("camera", 0.9, 10 / 2000**2, 8.0**2 * np.eye(2), FIELD_M)
POLAR = sector((0.0, -1200.0), (8.0, 0.5), (10.0, 2500.0), (0.0, 120.0), 10.0)
RADAR = polar_sensor("radar", 0.9, POLAR)
MOTION = constant_velocity(2, 2.0)
OURS = GlmbParams(accel_psd_m2_s3=2.0, tail_share=0.0)
THEIRS = replace(OURS, accel_psd_m2_s3=0.0)
PLACES = [(-600.0, 0.0), (0.0, 500.0), (500.0, -500.0)]
BIRTHS = tuple(Birth(np.array([*at, 0.0, 0.0]), np.diag([400.0, 400.0, 400.0, 400.0]), 0.05) for at in PLACES)


def crossing(sensor, count=40, seed=1):
    """Three objects that meet in the middle, among false detections."""
    rng = np.random.default_rng(seed)
    places = np.array(PLACES)
    speed = -places / 20.0
    scans = []
    for k in range(count):
        seen = (places + k * speed)[rng.random(3) < 0.9]
        z = seen + rng.normal(0.0, 8.0, seen.shape)
        false = rng.uniform(-1000.0, 1000.0, (rng.poisson(10), 2))
        if sensor.polar is not None:
            reach = np.column_stack([rng.uniform(10, 2500, len(false)), rng.uniform(-1.0, 1.0, len(false))])
            false = map_coordinates(sensor.polar, reach)
        scans.append(rng.permutation(np.vstack([z, false])))
    return scans


@pytest.mark.parametrize("sensor", [CAMERA, RADAR], ids=["camera", "radar"])
@pytest.mark.parametrize("estimator", ["filtered", "recovered", "smoothed"])
def test_planar_sensors_give_what_the_tracker_of_the_plane_gives(sensor, estimator):
    scans = crossing(sensor)
    times = np.arange(40.0)
    ours = track(scans, times, sensor, TrackingModel(OURS, BIRTHS, 0.05, 20.0), estimator)
    theirs = track(scans, times, sensor, TrackingModel(THEIRS, BIRTHS, 0.05, 20.0, motion=MOTION), estimator)
    assert [one.label for one in ours.trajectories] == [one.label for one in theirs.trajectories]
    assert len(ours) >= 3
    for one, other in zip(ours.trajectories, theirs.trajectories, strict=True):
        np.testing.assert_array_equal(one.t_ns, other.t_ns)
        np.testing.assert_allclose(one.mean, other.mean, atol=1e-3)
        # Limits on hypotheses cut in another order: labels are associated jointly above a conflict of 1e-3.
        np.testing.assert_allclose(one.existence, other.existence, atol=1e-3)


def test_a_lag_is_causal_with_a_users_models():
    scans = crossing(CAMERA)
    model = TrackingModel(THEIRS, BIRTHS, motion=MOTION)
    whole = track(scans, np.arange(40.0), CAMERA, model, lag_scans=3).positions_m()
    known = track(scans[:24], np.arange(24.0), CAMERA, model, lag_scans=3).positions_m()
    assert known[20].keys() == whole[20].keys()
    assert all(known[20][label].tolist() == whole[20][label].tolist() for label in known[20])


@pytest.mark.parametrize("motion", [None, MOTION], ids=["plane", "states"])
def test_an_amplitude_weighs_a_detection_by_its_likelihood_ratio(motion):
    """The existence after a scan, by the formula of a Bernoulli filter (Ristic et al. 2013, section II)."""
    params = OURS if motion is None else THEIRS
    birth = Birth(np.zeros(4), np.diag([100.0, 100.0, 25.0, 25.0]), 0.1)
    z = np.array([[3.0, -4.0], [-12.0, 5.0]])
    ratio = np.array([1.5, -0.7])
    S = 100.0 + 64.0
    density = np.exp(-0.5 * (z**2).sum(axis=1) / S) / (2.0 * math.pi * S) / CAMERA.clutter_density_per_m2
    exists = 0.1 * (0.1 + 0.9 * (density * np.exp(ratio)).sum())
    model = TrackingModel(params, (birth,), motion=motion)
    found = track([z, []], [0.0, 1.0], CAMERA, model, "filtered", log_ratios=[ratio, []])
    assert found.trajectories[0].existence[0] == pytest.approx(exists / (exists + 0.9), abs=1e-6)


@pytest.mark.parametrize("motion", [None, MOTION], ids=["plane", "states"])
def test_amplitudes_tell_faint_clutter_from_objects(motion):
    """Exponential powers: mean 1 of clutter, 8 of objects, both above a threshold of 1 (Rayleigh fading)."""
    rng = np.random.default_rng(3)
    heavy = replace(CAMERA, clutter_density_per_m2=120 / 2000**2)
    scans, ratios = [], []
    for k in range(30):
        seen = (np.array(PLACES) - k * np.array(PLACES) / 20.0)[rng.random(3) < 0.9]
        false = rng.uniform(-1000.0, 1000.0, (rng.poisson(120), 2))
        scans.append(np.vstack([seen + rng.normal(0.0, 8.0, seen.shape), false]))
        power = 1.0 + np.concatenate([rng.exponential(8.0, len(seen)), rng.exponential(1.0, len(false))])
        ratios.append(math.log(1 / 8) + (power - 1.0) * (1.0 - 1 / 8))
    params = OURS if motion is None else THEIRS
    model = TrackingModel(params, births_per_s=0.1, birth_speed_std_m_s=30.0, motion=motion)

    def error_m(log_ratios):
        at = track(scans, np.arange(30.0), heavy, model, "filtered", log_ratios=log_ratios).positions_m()
        truth = [np.array(PLACES) * (1.0 - k / 20.0) for k in range(30)]
        return np.mean([ospa(list(x.values()), y).total_m for x, y in zip(at, truth, strict=True)])

    assert error_m(ratios) < 0.7 * error_m(None)


def doppler(x):
    r = np.hypot(x[:, 0], x[:, 1])
    return np.column_stack([r, np.arctan2(x[:, 0], x[:, 1]), (x[:, 0] * x[:, 2] + x[:, 1] * x[:, 3]) / r])


NOISE = np.diag([20.0**2, 0.01**2, 0.5**2])


def birth_of(z):
    """Place by range and bearing, with the measured speed along the line of sight and any speed across it."""
    r, b, rate = z
    along = np.array([math.sin(b), math.cos(b)])
    across = np.array([along[1], -along[0]])
    turn = np.column_stack([along, across])
    cov = np.zeros((4, 4))
    cov[:2, :2] = turn @ np.diag([20.0**2, (r * 0.01) ** 2]) @ turn.T
    cov[2:, 2:] = turn @ np.diag([0.5**2, 40.0**2]) @ turn.T
    return np.array([*(r * along), *(rate * along)]), cov


def test_doppler_shows_the_speed_of_objects_that_pass_each_other():
    """Along one line of sight one comes and one goes: where they meet, only their speeds differ."""
    volume = 4000.0 * 2.0 * 100.0
    own = MeasurementModel("radar", 0.9, 15 / volume, doppler, NOISE, angles=(1,), birth=birth_of)
    view = sector((0.0, 0.0), (20.0, math.degrees(0.01)), (0.0, 4000.0), (0.0, 114.6), 15.0)
    plane = polar_sensor("radar", 0.9, view)
    model = TrackingModel(GlmbParams(0.0), births_per_s=0.1, motion=constant_velocity(2, 3.0))
    rng = np.random.default_rng(1)
    scans = []
    for k in range(30):
        places = np.array([[5.0, 1000.0 + 6.0 * k, 0.0, 6.0], [-5.0, 1180.0 - 6.0 * k, 0.0, -6.0]])
        z = doppler(places) + rng.multivariate_normal(np.zeros(3), NOISE, 2)
        false = rng.uniform([0.0, -1.0, -50.0], [4000.0, 1.0, 50.0], (rng.poisson(15), 3))
        scans.append(np.vstack([z[rng.random(2) < 0.9], false]))
    flat = [map_coordinates(view, z[:, :2]) for z in scans]
    error_m_s = {}
    for name, sensor, given in (("doppler", own, scans), ("plane", plane, flat)):
        found = track(given, np.arange(30.0), sensor, model)
        going, coming = sorted(found.trajectories, key=lambda one: -one.mean[-1, 1])[:2]
        error_m_s[name] = np.concatenate([going.mean[:, 3] - 6.0, coming.mean[:, 3] + 6.0]).std()
    assert error_m_s["doppler"] < 0.6
    assert error_m_s["doppler"] < 0.4 * error_m_s["plane"]


def test_objects_in_three_dimensions_are_told_apart_by_their_height():
    rng = np.random.default_rng(4)
    R = np.diag([100.0, 100.0, 400.0])
    box = np.array([[-1000.0, -1000.0, 0.0], [1000.0, 1000.0, 2000.0]])
    radar = linear_measurement(
        "radar",
        0.9,
        20 / np.prod(box[1] - box[0]),
        np.eye(3, 6),
        R,
        np.diag([1e6, 1e6, 1e6, 900.0, 900.0, 100.0]),
    )
    truth = [np.array([[30.0 * k - 450.0, 0.0, 500.0], [450.0 - 30.0 * k, 0.0, 1500.0]]) for k in range(30)]
    scans = []
    for places in truth:
        seen = places[rng.random(2) < 0.9]
        false = rng.uniform(*box, (rng.poisson(20), 3))
        scans.append(np.vstack([seen + rng.multivariate_normal(np.zeros(3), R, len(seen)), false]))
    model = TrackingModel(GlmbParams(0.0), births_per_s=0.1, motion=constant_velocity(3, 1.0))
    found = track(scans, np.arange(30.0), radar, model)
    assert len(found) == 2
    assert list(found.columns()) == ["k", "t_s", "label", "x", "y", "z", "vx", "vy", "vz", "existence"]
    errors = [ospa(list(at.values()), y).total_m for at, y in zip(found.positions_m(), truth, strict=True)]
    assert np.mean(errors[3:]) < 15.0
    for one in found.trajectories:
        assert np.ptp(one.mean[:, 2]) < 200.0


def test_what_is_out_of_view_is_not_missed():
    """An object behind a wall for ten scans keeps its label, if the model says that the wall hides it."""
    rng = np.random.default_rng(2)
    z = [np.array([[20.0 * k, 0.0]]) + rng.normal(0.0, 5.0, (1, 2)) for k in range(30)]
    scans = [[] if 10 <= k < 20 else one for k, one in enumerate(z)]
    camera = linear_measurement("camera", 0.95, 1e-7, np.eye(2, 4), 25.0 * np.eye(2))
    hidden = replace(camera, in_view=lambda x: (x[:, 0] < 190.0) | (x[:, 0] > 390.0))
    birth = Birth(np.zeros(4), np.diag([100.0, 100.0, 400.0, 400.0]), 0.05)
    model = TrackingModel(GlmbParams(0.0), (birth,), motion=constant_velocity(2, 0.5))

    def seen_at_15(sensor):
        found = track(scans[:16], np.arange(16.0), sensor, model, "filtered")
        return bool(found.positions_m()[15])

    assert seen_at_15(hidden)
    assert not seen_at_15(camera)


def test_aircraft_that_turn_keep_their_labels_with_motion_that_switches():
    """A radar with 10 s a turn, at up to 150 km: labels are those of the aircraft, and cruise is smooth."""
    radar = polar_sensor("radar", 0.85, sector((0.0, 0.0), (60.0, 0.08), (1e3, 200e3), (0.0, 360.0), 40.0))
    cruise = constant_velocity(2, 0.1)
    manoeuvre = constant_velocity(2, 300.0)
    shown = {}
    for name, motion in (("cruise", cruise), ("both", SwitchingMotion((cruise, manoeuvre), (120.0, 30.0)))):
        labels = 0
        for seed in range(2):
            scans = turning_traffic(radar, np.random.default_rng(seed))
            model = TrackingModel(
                GlmbParams(0.0, survival_probability_per_s=0.999),
                births_per_s=0.02,
                birth_speed_std_m_s=150.0,
                motion=motion,
            )
            labels += len(track(scans, 10.0 * np.arange(len(scans)), radar, model, "recovered"))
        shown[name] = labels / (2 * N_AIRCRAFT)
    assert shown["both"] <= 1.1 < shown["cruise"]


N_AIRCRAFT = 12


def turning_traffic(radar, rng, count=90):
    """Aircraft at 200 m/s that fly straight for some minutes, then turn at up to 3 degrees a second."""
    angle = rng.uniform(0.0, 2.0 * math.pi, N_AIRCRAFT)
    place = rng.uniform(-100e3, 100e3, (N_AIRCRAFT, 2))
    rate = np.zeros(N_AIRCRAFT)
    left = rng.uniform(0.0, 200.0, N_AIRCRAFT)
    scans = []
    for _ in range(count):
        for _ in range(10):
            left -= 1.0
            for i in np.flatnonzero(left < 0.0):
                turns = rate[i] == 0.0
                rate[i] = rng.choice([-1, 1]) * math.radians(rng.uniform(1.0, 3.0)) if turns else 0.0
                left[i] = rng.uniform(20.0, 60.0) if turns else rng.uniform(60.0, 240.0)
            angle += rate
            place = place + 200.0 * np.column_stack([np.cos(angle), np.sin(angle)])
        seen = place[rng.random(N_AIRCRAFT) < 0.85]
        z = np.column_stack([np.hypot(*seen.T), np.arctan2(seen[:, 0], seen[:, 1])])
        z += rng.normal(0.0, [60.0, math.radians(0.08)], z.shape)
        n = rng.poisson(40)
        false = np.column_stack([rng.uniform(1e3, 200e3, n), rng.uniform(-math.pi, math.pi, n)])
        scans.append(rng.permutation(map_coordinates(radar.polar, np.vstack([z[z[:, 0] < 200e3], false]))))
    return scans
