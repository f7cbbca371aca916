"""A user would lose an evening: a mistake in the world's table without a name, a seed that is two worlds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.ridged import VALLEY_MSL_M, ridge, terrain_table

from gcs.config import scenario_names
from gcs.errors import ConfigError
from sim_vehicles.world.scenario import generator, load, parse_scenario
from sim_vehicles.world.vehicle_specs import in_launch_layers, vehicle_specs

GOOD = """
name = "x"
[frame]
lat_deg = 33.0
lon_deg = -87.0
alt_msl_m = 70.0
[[agents]]
system_id = 1
east_m = 100.0
north_m = 100.0
[[births]]
east_m = 900.0
north_m = 900.0
[simulation]
forward_speed_m_s = 15.0
"""
TARGET = "[[simulation.targets]]\neast_m = 900.0\nnorth_m = 900.0\n"
GAUSSIAN = "[simulation.gaussian_targets]\nspeed_std_m_s = 2.0\nmax_speed_m_s = 5.0\n"


@pytest.fixture
def mistake(tmp_path: Path):
    """Loads a text that must be refused; returns the error."""

    def refused(text: str) -> ConfigError:
        path = tmp_path / "world.toml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(ConfigError) as caught:
            load(str(path))
        assert caught.value.file == str(path)
        assert str(caught.value).startswith(str(path))
        return caught.value

    return refused


@pytest.mark.parametrize("name", scenario_names())
def test_every_shipped_scenario_describes_a_world(name: str) -> None:
    scenario = load(name)
    assert scenario.config.name == scenario.source == name
    assert scenario.simulation.targets or scenario.simulation.gaussian_targets
    assert scenario.text.startswith("#")
    assert scenario.frame == scenario.config.local_frame


def test_a_file_gets_the_documented_defaults(tmp_path: Path) -> None:
    path = tmp_path / "world.toml"
    path.write_text(GOOD + TARGET, encoding="utf-8")
    simulation = load(str(path)).simulation
    sensor, death = simulation.sensor, simulation.death
    assert (sensor.period_s, sensor.detection_probability, sensor.clutter_per_scan) == (1.0, 0.98, 20.0)
    assert (death.survival_probability, death.check_period_s, death.prescribed) == (1.0, 1.0, [])


@pytest.mark.parametrize(
    ("wrong", "key", "words"),
    [
        (
            "[simulation.sensor]\ndetection_probability = 1.1",
            "simulation.sensor.detection_probability",
            "<= 1",
        ),
        ("[simulation.sensor]\nnoise_std_m = 0.0", "simulation.sensor.noise_std_m", "> 0"),
        ("[simulation.sensor]\nperiod_s = 0.0", "simulation.sensor.period_s", "0.05"),
        ("[simulation.sensor]\nclutter_per_scan = -1.0", "simulation.sensor.clutter_per_scan", ">= 0"),
        ('[simulation.sensor]\nname = "a b"', "simulation.sensor.name", "regex"),
        ("[simulation.sensor]\nrange_m = 3.0", "simulation.sensor", "unknown key `range_m`"),
        ("[simulation.death]\nsurvival_probability = 2", "simulation.death.survival_probability", "<= 1"),
        (
            "[simulation.death]\nprescribed = [{system_id = 1, at_s = 2.0}, {system_id = 9, at_s = 2.0}]",
            "simulation.death.prescribed[1].system_id",
            "9 is none of the agents",
        ),
        ("[[simulation.targets]]\neast_m = 900.0", "simulation.targets[0]", "`north_m` is missing"),
        (
            TARGET + "[[simulation.targets]]\neast_m = 2100.0\nnorth_m = 1.0",
            "simulation.targets[1]",
            "(2100.0, 1.0) lies outside the map: 2000.0 m x 2000.0 m",
        ),
        (TARGET + "appears_s = -1.0", "simulation.targets[0].appears_s", ">= 0"),
        (TARGET + GAUSSIAN, "simulation", "not both"),
        (GAUSSIAN.replace("5.0", "0.0"), "simulation.gaussian_targets.max_speed_m_s", "> 0"),
    ],
)
def test_a_mistake_names_file_key_and_what_was_expected(mistake, wrong: str, key: str, words: str) -> None:
    error = mistake(GOOD + wrong)
    assert error.key == key
    assert words in str(error)


def test_a_mission_without_a_world_is_refused(mistake) -> None:
    error = mistake(GOOD[: GOOD.index("[simulation]")])
    assert (error.key, "no world to simulate" in str(error)) == ("simulation", True)


def test_a_world_without_a_speed_is_refused(mistake) -> None:
    error = mistake(GOOD.replace("forward_speed_m_s = 15.0", "gps_noise_std_m = 1.0"))
    assert (error.key, "`forward_speed_m_s` is missing" in str(error)) == ("simulation", True)


def test_drawn_targets_need_places_to_be_drawn_from(mistake) -> None:
    without = GOOD.replace("[[births]]\neast_m = 900.0\nnorth_m = 900.0\n", "")
    assert mistake(without + GAUSSIAN).key == "simulation.gaussian_targets"


def test_a_seed_and_a_purpose_always_give_the_same_numbers() -> None:
    assert np.array_equal(generator(3, "scan", 7).random(8), generator(3, "scan", 7).random(8))


def test_seeds_purposes_and_indices_are_independent_of_each_other() -> None:
    """A drawn death must not follow from a drawn miss: no two streams are equal or correlated."""
    keys = [
        (seed, purpose, index) for seed in (0, 1, 2) for purpose in ("scan", "loss") for index in range(1, 7)
    ]
    keys += [(seed, "targets", 0) for seed in range(4)]
    draws = np.array([generator(seed, purpose, index).standard_normal(2000) for seed, purpose, index in keys])
    correlation = np.corrcoef(draws) - np.eye(len(draws))
    assert np.abs(correlation).max() < 5.0 / np.sqrt(2000)


def test_a_fault_of_an_unknown_vehicle_or_kind_is_named(mistake):
    fault = '[[simulation.faults]]\nsystem_id = {}\nat_s = 5.0\nkind = "{}"\n'
    assert "simulation.faults[0].system_id" in str(mistake(GOOD + TARGET + fault.format(9, "engine")))
    assert "simulation.faults[0].kind" in str(mistake(GOOD + TARGET + fault.format(1, "wing")))


def test_over_terrain_homes_are_on_the_ground_and_climbs_are_the_airframe_s():
    flat = parse_scenario(GOOD + TARGET, "world.toml")
    over = parse_scenario(
        GOOD + TARGET + terrain_table(ridge()) + "[airframe]\nclimb_m_s = 3.5\n", "world.toml"
    )
    (level,) = vehicle_specs(flat, 0)
    (high,) = vehicle_specs(over, 0)
    assert (level.home_rel_m, level.climb_m_s, level.sink_m_s) == (0.0, None, None)
    assert (high.home_rel_m, high.climb_m_s, high.sink_m_s) == (VALLEY_MSL_M - 70.0, 3.5, 2.0)


def test_a_launch_beside_a_hill_is_above_the_floor_of_the_band_all_round_its_circle():
    beside = GOOD.replace("east_m = 100.0", "east_m = 880.0")
    (spec,) = vehicle_specs(parse_scenario(beside + TARGET + terrain_table(ridge()), "world.toml"), 0)
    (level,) = vehicle_specs(parse_scenario(beside + TARGET, "world.toml"), 0)
    launch_msl_m = 70.0 + spec.home_rel_m + spec.alt_rel_m
    ground_m = [ridge().height_msl_m(spec.east_m + east_m, spec.north_m) for east_m in (-50.0, 0.0, 50.0)]
    assert min(launch_msl_m - height_m for height_m in ground_m) > 50.0
    assert spec.alt_rel_m > level.alt_rel_m


def test_neighbours_that_are_launched_at_once_circle_a_layer_apart_below_the_ceiling_of_the_band():
    agent = "[[agents]]\nsystem_id = {0}\neast_m = 100.0\nnorth_m = {0}00.0\n"
    agents = "".join(map(agent.format, (2, 3, 4, 5)))
    flat = parse_scenario(GOOD + agents + TARGET, "world.toml")
    lowest_m = flat.config.mission.altitude_rel_m
    heights_m = [spec.alt_rel_m - lowest_m for spec in in_launch_layers(vehicle_specs(flat, 0), flat)]
    assert heights_m == [0.0, 20.0, 40.0, 60.0, 80.0]
    over = parse_scenario(GOOD + agents + TARGET + terrain_table(ridge()), "world.toml")
    launches = in_launch_layers(vehicle_specs(over, 0), over)
    assert max(spec.alt_rel_m for spec in launches) <= over.config.terrain.max_agl_m


def test_slant_ranges_need_the_height_of_the_sensor(mistake):
    error = mistake(GOOD + TARGET + '[simulation.sensor]\nkind = "range_bearing"\nrange = "slant"\n')
    assert "simulation.sensor.range" in str(error)
    assert "height_agl_m" in str(error)
