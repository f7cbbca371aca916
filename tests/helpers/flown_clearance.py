"""Clearance of flown tracks from obstacles, and distances of vehicles from each other, on virtual time.

The last metres to a target are the target's: it may pass next to an obstacle, or over one. So a track is
checked until its vehicle is within twice the capture radius of the end of its route, or has arrived; how
near vehicles come to obstacles there, circling among it, is a figure of its own.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from gcs.config import Config
from gcs.core.separation.minima import LOST_SHARE, layer_step_m, min_distance_m
from gcs.model import NS_PER_S, AgentStatus, Effect, Event, FloatArray, Plan, Tick
from gcs.planning.map.grid import Grid
from helpers.staging import zones_on
from sim_vehicles.campaign.virtual_run import START_T_NS, STEP_NS, VirtualRun
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import DeathTable, Scenario, WindTable

_SAMPLE_PERIOD_TICKS = 4
"""Ticks between two samples: 0.2 s, 3 m."""
_IN_AIR_M = 2.0
"""Height from which a vehicle is in the air."""
_MORE_S, _LATEST_S = 10.0, 1200.0
"""Time after the end of the mission, for return flights."""


@dataclass(frozen=True, slots=True)
class Nearest:
    """Least clearance of a vehicle from obstacles."""

    clearance_m: float
    """Distance from the nearest blocked cell; 0 inside one."""
    vehicle: int
    t_s: float
    """From the mission's start."""
    tasked_s: float
    """Since the vehicle's route was last changed."""
    routes: int
    """How many it had had by then."""
    east_m: float
    north_m: float
    at_end_m: float = math.inf
    """The same within twice the capture radius of the end of a route, and after arrival."""
    arrived: int = 0
    near_pairs: tuple[NearPair, ...] = ()


@dataclass(frozen=True, slots=True)
class NearPair:
    """Two vehicles in the air that lost separation from each other."""

    vehicles: tuple[int, int]
    t_s: float
    """Where they were nearest horizontally, from the mission's start."""
    distance_m: float
    height_m: float
    modes: tuple[str, str]


@dataclass(frozen=True, slots=True)
class ReturnFlight:
    """Return flight of a vehicle from its target."""

    clearance_m: float
    """Least distance from blocked cells, from its arrival at the target to its landing; 0 inside one."""
    home_m: float
    """Distance from home where it landed, or was last."""


@dataclass(frozen=True, slots=True)
class FlownHome:
    """A mission that ends at home."""

    flights: dict[int, ReturnFlight]
    """By vehicle, of those that reached their targets."""
    near_pairs: tuple[NearPair, ...]


class PairWatch:
    """Notes pairs of vehicles in the air that lose separation (`gcs.core.separation.minima`)."""

    def __init__(self, config: Config) -> None:
        self._min_m = min_distance_m(config)
        self._min_height_m = LOST_SHARE * layer_step_m(config)
        self._near: dict[tuple[int, int], NearPair] = {}

    def look(self, vehicles: Iterable[SimVehicle], t_ns: int) -> None:
        """Look at the vehicles once."""
        flying = [one for one in vehicles if one.alive and one.autopilot.flying and one.alt_rel_m > _IN_AIR_M]
        for one, other in itertools.combinations(flying, 2):
            distance_m = math.dist((one.east_m, one.north_m), (other.east_m, other.north_m))
            height_m = abs(one.alt_rel_m - other.alt_rel_m)
            if distance_m >= self._min_m or height_m >= self._min_height_m:
                continue
            pair = (one.system_id, other.system_id)
            if pair not in self._near or distance_m < self._near[pair].distance_m:
                modes = (one.autopilot.mode.name, other.autopilot.mode.name)
                t_s = (t_ns - START_T_NS) / NS_PER_S
                self._near[pair] = NearPair(pair, t_s, distance_m, height_m, modes)

    @property
    def near_pairs(self) -> tuple[NearPair, ...]:
        """What was seen, each pair once."""
        return tuple(self._near.values())


def in_wind(scenario: Scenario, wind: WindTable, planned_m_s: float) -> Scenario:
    """Return a scenario in a wind, for which its routes allow by `[airframe] wind_m_s`."""
    airframe = msgspec.structs.replace(scenario.config.airframe, wind_m_s=planned_m_s)
    return dataclasses.replace(
        scenario,
        config=msgspec.structs.replace(scenario.config, airframe=airframe),
        simulation=msgspec.structs.replace(scenario.simulation, wind=wind),
    )


def nearest(scenario: Scenario, seed: int, for_s: float = math.inf) -> Nearest:
    """Fly a mission, or its begin; return where any vehicle came nearest to any blocked cell on its way."""
    near_m = 2.0 * scenario.config.planning.capture_radius_m
    ends: dict[int, FloatArray] = {}
    tasked: dict[int, tuple[int, int]] = {}
    done: set[int] = set()
    arrived: set[int] = set()
    pairs = PairWatch(scenario.config)
    best, at_end_m = Nearest(math.inf, 0, 0.0, 0.0, 0, 0.0, 0.0), math.inf
    ticks = 0

    def on_effect(t_ns: int, effect: Effect) -> None:
        if isinstance(effect, Plan):
            ends.update({route.vehicle: route.points_m[-1] for route in effect.routes})
            tasked.update({v: (t_ns, tasked.get(v, (0, 0))[1] + 1) for v in effect.changed})
        elif isinstance(effect, AgentStatus) and effect.status != "active":
            done.add(effect.vehicle)
            arrived.update([effect.vehicle] if effect.status == "arrived" else [])

    def on_event(event: Event) -> None:
        nonlocal best, at_end_m, ticks
        if not isinstance(event, Tick):
            return
        ticks += 1
        if ticks % _SAMPLE_PERIOD_TICKS:
            return
        pairs.look(run.vehicles.values(), event.t_ns)
        for vehicle in run.vehicles.values():
            number, place = vehicle.system_id, (vehicle.east_m, vehicle.north_m)
            if number not in ends or not vehicle.alive:
                continue
            clearance_m = distance_to_obstacle_m(run.engine.grid, cells, place)
            if number in done or math.dist(place, ends[number]) <= near_m:
                at_end_m = min(at_end_m, clearance_m)
                continue
            if clearance_m < best.clearance_m:
                t_ns, count = tasked[number]
                best = Nearest(
                    clearance_m,
                    number,
                    (event.t_ns - START_T_NS) / NS_PER_S,
                    (event.t_ns - t_ns) / NS_PER_S,
                    count,
                    *place,
                )

    run = VirtualRun(scenario, seed, on_event=on_event, on_effect=on_effect)
    cells = np.argwhere(run.engine.grid.blocked)[:, ::-1].astype(np.float64)
    run.run(min(for_s, scenario.config.mission.max_duration_s))
    return dataclasses.replace(best, at_end_m=at_end_m, arrived=len(arrived), near_pairs=pairs.near_pairs)


def landing(scenario: Scenario) -> Scenario:
    """Return a scenario whose vehicles land at home after their targets, and are lost for no other reason."""
    mission = msgspec.structs.replace(scenario.config.mission, end="land")
    return dataclasses.replace(
        scenario,
        config=msgspec.structs.replace(scenario.config, mission=mission),
        simulation=msgspec.structs.replace(scenario.simulation, death=DeathTable()),
    )


def flown_home(scenario: Scenario, seed: int, *, straight: bool = False) -> FlownHome:
    """Fly a whole mission that ends at home; return how each vehicle that reached its target came home.

    With `straight` return routes are planned as if there were no obstacles.
    """
    arrived: dict[int, ReturnFlight] = {}
    pairs = PairWatch(scenario.config)

    def on_effect(_t_ns: int, effect: Effect) -> None:
        if isinstance(effect, AgentStatus) and effect.status == "arrived":
            arrived.setdefault(effect.vehicle, ReturnFlight(math.inf, math.inf))

    def on_event(event: Event) -> None:
        if not isinstance(event, Tick) or (event.t_ns - START_T_NS) // STEP_NS % _SAMPLE_PERIOD_TICKS:
            return
        pairs.look(run.vehicles.values(), event.t_ns)
        for vehicle in run.vehicles.values():
            if vehicle.system_id in arrived and vehicle.autopilot.flying:
                home, place = vehicle.autopilot.home, (vehicle.east_m, vehicle.north_m)
                arrived[vehicle.system_id] = ReturnFlight(
                    min(
                        arrived[vehicle.system_id].clearance_m,
                        distance_to_obstacle_m(run.engine.grid, cells, place),
                    ),
                    math.dist(place, (home.east_m, home.north_m)),
                )

    run = VirtualRun(scenario, seed, on_event=on_event, on_effect=on_effect)
    cells = np.argwhere(run.engine.grid.blocked)[:, ::-1].astype(np.float64)
    if straight:
        empty = replace(run.engine.grid, blocked=np.zeros_like(run.engine.grid.blocked))
        run.engine.stages.return_routes._zones = zones_on(empty)
    flown_s = run.run()
    while any(run.vehicles[peer].autopilot.flying for peer in run.vehicles) and flown_s < _LATEST_S:
        run.ended = False
        flown_s = run.run(flown_s + _MORE_S)
    return FlownHome(arrived, pairs.near_pairs)


def distance_to_obstacle_m(grid: Grid, cells: FloatArray, place: tuple[float, float]) -> float:
    """Return the distance of a place from the nearest of the blocked `cells` (column, row); 0 inside one."""
    at = (np.array(place) - grid.origin_m) / grid.spacing_m
    gaps = np.maximum(np.abs(at - cells) - 0.5, 0.0)
    return float(np.hypot(gaps[:, 0], gaps[:, 1]).min(initial=math.inf)) * grid.spacing_m
