"""A copy of a flight that flew otherwise would pass or fail tests for a reason of its own."""

import pytest
from helpers.flight_copies import copy_of
from helpers.hills import elevation_of, terrain_table
from helpers.ordered_flight import SEED, Flight

from gcs.config import read_text
from gcs.config.key_overrides import override_keys
from gcs.io.record_json import encode
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import parse_scenario

HILLS = terrain_table(elevation_of(lambda east, north: 70.0 + 0.05 * east + 0.0 * north, 2000.0))
WINDY = ["simulation.airframe=banked", "simulation.wind.east_m_s=3.0", "simulation.wind.gust_std_m_s=1.0"]
FLYABLE = ["map.obstacles=[]", "planning.shape=flyable"]


@pytest.mark.parametrize(
    ("scenario", "keys", "tables", "loss"),
    [
        ("prescribed", ["simulation.px4=[1, 3]"], "", 0.2),
        ("radars", [], "", 0.0),
        ("deterministic", [*WINDY, *FLYABLE], HILLS, 0.0),
    ],
)
def test_a_copy_flies_on_as_the_flight_and_disturbs_it_not(scenario, keys, tables, loss):
    text, source = read_text(scenario)
    scenario = parse_scenario(override_keys(text + tables, keys, source), source)
    alone, copied = (Flight(VirtualRun(scenario, SEED, loss=loss)) for _ in range(2))
    alone.run.run(25.0)
    copied.run.run(15.0)
    again = Flight(copy_of(copied.run), copied.events.copy(), copied.effects.copy())
    copied.run.vehicles["vehicle:1"].autopilot.disarm()
    copied.run.run(20.0)
    again.run.run(25.0)
    assert [encode(event) for event in again.events] == [encode(event) for event in alone.events]
    assert [encode(e) for _, e in again.effects] == [encode(e) for _, e in alone.effects]
    assert len(copied.effects) != len(again.effects)
