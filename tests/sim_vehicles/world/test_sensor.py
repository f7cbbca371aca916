"""A user would lose calibration: a sensor that is better, worse or more telling than it says."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.ridged import ridge
from hypothesis import given
from hypothesis import strategies as st

from gcs.model import NS_PER_S, Polar, Sensor, TruthObject, Viewpoint, read_only
from gcs.tracking.models.sensor_geometry import polar_sensor, sensor_coordinates
from sim_vehicles.world.scenario import load
from sim_vehicles.world.sensor import TrueSight, make_sensors, observe
from sim_vehicles.world.world import World

FIELD = (-100.0, -50.0, 900.0, 450.0)
AREA_M2 = 1000.0 * 500.0
SENSOR = Sensor("radar", 0.9, 4.0 / AREA_M2, read_only(np.diag([9.0, 25.0])), FIELD)
CLEAN = replace(SENSOR, detection_probability=1.0, clutter_density_per_m2=0.0)
OBJECTS = [
    TruthObject("agents", 1, 100.0, 100.0, True),
    TruthObject("agents", 2, 700.0, 100.0, True),
    TruthObject("targets", 0, 400.0, 400.0, True),
]
SCANS = 2000


def points(sensor, objects, *, seed=0, index=0):
    return observe(sensor, objects, seed, index, index * NS_PER_S).z_m


def as_set(z_m):
    return {tuple(row) for row in z_m.tolist()}


def test_a_scan_has_its_time_and_sensor() -> None:
    scan = observe(SENSOR, OBJECTS, 0, 3, 42)
    assert (scan.t_ns, scan.measured_t_ns, scan.sensor) == (42, 42, SENSOR)
    assert scan.z_m.shape[1] == 2
    assert not scan.z_m.flags.writeable


def test_objects_are_detected_with_the_sensors_probability() -> None:
    quiet = replace(SENSOR, clutter_density_per_m2=0.0)
    seen = sum(len(points(quiet, OBJECTS, index=i)) for i in range(SCANS))
    n, p = SCANS * len(OBJECTS), SENSOR.detection_probability
    assert seen == pytest.approx(n * p, abs=5 * math.sqrt(n * p * (1 - p)))


def test_noise_has_the_sensors_covariance_on_each_axis() -> None:
    errors = np.vstack([points(CLEAN, OBJECTS[:1], index=i) - (100.0, 100.0) for i in range(SCANS)])
    assert errors.mean(axis=0) == pytest.approx((0.0, 0.0), abs=5 * 5.0 / math.sqrt(SCANS))
    assert np.cov(errors.T) == pytest.approx(np.diag([9.0, 25.0]), abs=5 * 25.0 * math.sqrt(2 / SCANS))
    assert errors.var(axis=0)[0] == pytest.approx(9.0, rel=5 * math.sqrt(2 / SCANS))


def test_clutter_is_poisson_in_number() -> None:
    counts = np.array([len(points(SENSOR, [], index=i)) for i in range(SCANS)])
    assert counts.mean() == pytest.approx(4.0, abs=5 * math.sqrt(4.0 / SCANS))
    assert counts.var() == pytest.approx(4.0, rel=5 * math.sqrt(2 / SCANS))


def test_clutter_is_uniform_over_the_field_of_view() -> None:
    clutter = np.vstack([points(SENSOR, [], index=i) for i in range(SCANS)])
    east_min, north_min, east_max, north_max = FIELD
    cells, _, _ = np.histogram2d(
        *clutter.T, bins=(10, 5), range=((east_min, east_max), (north_min, north_max))
    )
    assert cells.sum() == len(clutter)
    expected = len(clutter) / 50
    chi2 = ((cells - expected) ** 2 / expected).sum()
    assert chi2 < 100.0  # 49 degrees of freedom: one in 30 000


def test_the_order_of_points_tells_nothing() -> None:
    """Where the first object stands in the scan is uniform over all places, clutter's among them."""
    noisy, ranks = replace(CLEAN, clutter_density_per_m2=SENSOR.clutter_density_per_m2), []
    for index in range(SCANS):
        z = points(noisy, OBJECTS, index=index)
        nearest = int(np.argmin(np.hypot(*(z - (100.0, 100.0)).T)))
        ranks.append((nearest + 0.5) / len(z))
    assert np.mean(ranks) == pytest.approx(0.5, abs=5 * 0.29 / math.sqrt(SCANS))
    assert np.var(ranks) > 0.05


def test_lost_objects_and_those_outside_the_field_of_view_are_not_seen() -> None:
    gone = [replace(OBJECTS[0], alive=False), TruthObject("targets", 0, 901.0, 100.0, True)]
    assert all(len(points(CLEAN, gone, index=i)) == 0 for i in range(50))
    on_the_edge = [TruthObject("targets", 0, 900.0, 450.0, True)]
    assert all(len(points(CLEAN, on_the_edge, index=i)) == 1 for i in range(50))


@given(st.integers(0, 2**31), st.integers(0, 10**6), st.lists(st.booleans(), min_size=6, max_size=6))
def test_a_loss_changes_no_detection_of_the_others(seed: int, index: int, alive: list[bool]) -> None:
    places = [TruthObject("agents", i, 100.0 * i, 50.0 * i, True) for i in range(6)]
    everybody = as_set(points(SENSOR, places, seed=seed, index=index))
    survivors = [replace(thing, alive=is_alive) for thing, is_alive in zip(places, alive, strict=True)]
    rest = as_set(points(SENSOR, survivors, seed=seed, index=index))
    assert rest <= everybody
    assert len(everybody - rest) <= alive.count(False)


@given(st.integers(0, 2**31), st.integers(0, 10**6))
def test_a_seed_and_an_index_mean_one_scan(seed: int, index: int) -> None:
    again = [points(SENSOR, OBJECTS, seed=seed, index=index) for _ in range(2)]
    assert np.array_equal(*again)
    others = [points(CLEAN, OBJECTS, seed=s, index=i) for s, i in ((seed, index + 1), (seed + 1, index))]
    one = points(CLEAN, OBJECTS, seed=seed, index=index)
    assert not any(as_set(one) & as_set(other) for other in others)


def test_scans_of_one_seed_are_independent() -> None:
    errors = np.array([points(CLEAN, OBJECTS[:1], index=i)[0] for i in range(SCANS)]) - (100.0, 100.0)
    for lag in (1, 2, 5):
        product = (errors[:-lag, 0] * errors[lag:, 0]).mean() / 9.0
        assert product == pytest.approx(0.0, abs=5 / math.sqrt(SCANS))


def test_a_perfect_sensor_sees_everything_every_time() -> None:
    assert all(len(points(CLEAN, OBJECTS, index=i)) == 3 for i in range(200))


def test_a_sensor_announces_its_model() -> None:
    scenario = load("prescribed")
    table, area = scenario.simulation.sensor, scenario.config.map
    sensor = make_sensors(scenario)[0]
    east_min, north_min, east_max, north_max = sensor.field_of_view_m
    margin = table.field_margin_m
    assert sensor.field_of_view_m == (-margin, -margin, area.width_m + margin, area.height_m + margin)
    assert (sensor.name, sensor.detection_probability) == (table.name, table.detection_probability)
    assert np.array_equal(sensor.noise_cov_m2, np.eye(2) * table.noise_std_m**2)
    size_m2 = (east_max - east_min) * (north_max - north_min)
    assert sensor.clutter_density_per_m2 * size_m2 == pytest.approx(table.clutter_per_scan)
    counts = [len(points(sensor, [], index=i)) for i in range(500)]
    assert np.mean(counts) == pytest.approx(table.clutter_per_scan, abs=5 * math.sqrt(20 / 500))


def test_a_radar_measures_range_and_bearing_in_its_sector() -> None:
    polar = Polar(0.0, 0.0, 3.0, 0.01, (50.0, 600.0), (math.pi / 4, math.pi / 4), 2.0 / (550.0 * math.pi / 2))
    radar = polar_sensor("radar", 1.0, polar)
    quiet = replace(radar, polar=replace(polar, clutter_per_m_rad=0.0))
    seen = np.concatenate([points(quiet, OBJECTS, index=i) for i in range(SCANS)])
    assert len(seen) == 2 * SCANS  # the one at 700 m east is too far
    z = sensor_coordinates(quiet, seen[np.hypot(*seen.T) < 300.0])
    assert z.mean(axis=0) == pytest.approx((math.hypot(100.0, 100.0), math.pi / 4), abs=0.4)
    assert z.std(axis=0) == pytest.approx((3.0, 0.01), rel=0.1)
    clutter = sensor_coordinates(radar, np.concatenate([points(radar, [], index=i) for i in range(SCANS)]))
    assert len(clutter) / SCANS == pytest.approx(2.0, abs=0.2)
    assert clutter[:, 0].mean() == pytest.approx(325.0, rel=0.05)  # uniform in range, not in area


def test_sensors_take_turns_in_the_order_of_time_and_draw_their_own_noise() -> None:
    world = World(load("radars"), 0, 0)
    scans = [
        (world.scan_t_ns(i), world.scan(i, world.truth(world.scan_t_ns(i), [])).sensor.name) for i in range(9)
    ]
    assert [t for t, _ in scans] == sorted(t for t, _ in scans)
    assert [name for _, name in scans[:4]] == ["radar-west", "radar-north", "camera", "camera"]
    assert world.arrival_t_ns(1) - world.scan_t_ns(1) == NS_PER_S // 4


# ------------------------------------------------------------ terrain

MAST = Viewpoint(300.0, 1000.0, 10.0, is_agl=True)
WIDE = replace(CLEAN, field_of_view_m=(0.0, 0.0, 2000.0, 2000.0), viewpoint=MAST)


def test_terrain_hides_what_is_below_the_line_of_sight() -> None:
    """From 10 m above the valley, 700 m before a crest of 150 m: at 1500 m the line is 250 m high."""
    objects = [
        TruthObject("targets", 0, 800.0, 1000.0, True, alt_msl_m=102.0),
        TruthObject("targets", 1, 1500.0, 1000.0, True, alt_msl_m=102.0),
        TruthObject("agents", 1, 1500.0, 900.0, True, alt_msl_m=300.0),
        TruthObject("agents", 2, 1500.0, 800.0, True, alt_msl_m=400.0),
        TruthObject("agents", 3, 1500.0, 700.0, True),
    ]
    seen = observe(WIDE, objects, 0, 0, 0, sight=TrueSight(ridge(), WIDE, MAST)).z_m
    assert sorted(round(north / 100.0) for _, north in seen.tolist()) == [7, 8, 10]
    assert len(observe(WIDE, objects, 0, 0, 0).z_m) == 5


def test_a_slant_range_is_that_to_the_true_height() -> None:
    polar = Polar(300.0, 1000.0, 1e-6, 1e-9, (0.0, 3000.0), (0.0, math.pi), 0.0, is_slant=True)
    radar = replace(polar_sensor("r", 1.0, polar), viewpoint=MAST)
    high = TruthObject("agents", 1, 700.0, 1000.0, True, alt_msl_m=410.0)
    scan = observe(radar, [high], 0, 0, 0, sight=TrueSight(ridge(), radar, MAST))
    assert sensor_coordinates(radar, scan.z_m)[0] == pytest.approx((500.0, math.pi / 2.0), abs=1e-3)
