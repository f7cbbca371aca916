"""What is flown: the track of every vehicle stays out of obstacles, wherever its route has the choice.

The last metres to a target are the target's: it may pass beside an obstacle, or over one. So a track is
looked at until its vehicle is within twice the capture radius of the end of its route.
"""

from __future__ import annotations

import dataclasses
import math

import msgspec
import numpy as np
import pytest

from gcs.model import Effect, Event, Fate, Plan, Tick
from sim_vehicles.scenario import WindTable, load
from sim_vehicles.virtual import VirtualRun

WIND = WindTable(east_m_s=2.0, north_m_s=-2.5, gust_std_m_s=0.8)


def least_room_m(name: str, seed: int, wind: WindTable | None = None) -> float:
    """Fly a whole mission; return how near any vehicle came to any blocked cell on its way."""
    scenario = load(name)
    if wind is not None:
        airframe = msgspec.structs.replace(scenario.config.airframe, wind_m_s=4.0)
        scenario = dataclasses.replace(
            scenario,
            config=msgspec.structs.replace(scenario.config, airframe=airframe),
            simulation=msgspec.structs.replace(scenario.simulation, wind=wind),
        )
    near_m = 2.0 * scenario.config.planning.capture_radius_m
    ends: dict[int, np.ndarray] = {}
    done: set[int] = set()
    track: list[tuple[float, float]] = []

    def on_effect(_t_ns: int, effect: Effect) -> None:
        if isinstance(effect, Plan):
            ends.update({route.vehicle: route.points_m[-1] for route in effect.routes})
        elif isinstance(effect, Fate) and effect.fate != "flying":
            done.add(effect.vehicle)

    def on_event(event: Event) -> None:
        if isinstance(event, Tick):
            for vehicle in run.vehicles.values():
                place, end = (vehicle.east_m, vehicle.north_m), ends.get(vehicle.system_id)
                if end is None or not vehicle.alive or vehicle.system_id in done:
                    continue
                if math.dist(place, end) > near_m:
                    track.append(place)

    run = VirtualRun(scenario, seed, on_event=on_event, on_effect=on_effect)
    run.run()
    assert run.ended
    grid = run.command.grid
    cells = np.argwhere(grid.blocked)[:, ::-1]
    places = np.array(track)[::4] / grid.spacing_m
    gaps = np.maximum(np.abs(places[:, np.newaxis] - cells[np.newaxis]) - 0.5, 0.0)
    return float(np.hypot(gaps[..., 0], gaps[..., 1]).min()) * grid.spacing_m


@pytest.mark.parametrize(
    ("name", "wind", "room_m"),
    [("random-obstacles", None, 10.0), ("prescribed", None, 20.0), ("prescribed", WIND, 15.0)],
)
def test_nobody_flies_into_an_obstacle(name, wind, room_m):
    assert least_room_m(name, 1, wind) > room_m


@pytest.mark.slow
@pytest.mark.parametrize("wind", [None, WIND])
@pytest.mark.parametrize("name", ["deterministic", "prescribed"])
def test_nobody_flies_into_an_obstacle_over_seeds(name, wind):
    """Where starts and targets stand off obstacles; what happens elsewhere: docs/planning.md."""
    rooms_m = [least_room_m(name, seed, wind) for seed in range(1, 9)]
    assert min(rooms_m) > 0.0, rooms_m
