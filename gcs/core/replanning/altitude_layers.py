"""Altitude layers for the routes of a plan."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs.config import Config
from gcs.core.replanning.inputs import OtherVehicle
from gcs.core.replanning.plan_targets import place_of
from gcs.model import Route, Track, vehicle_name
from gcs.planning.deconfliction import Conflict, PlannedFlight, assign_layers, min_separation_m
from gcs.planning.map.grid import Point
from gcs.planning.route_progress import CORRIDOR_M, next_point


def layer_count(config: Config) -> int:
    """How many layers a mission has."""
    return config.mission.layers if config.mission.layer_step_m > 0.0 else 1


def preferred_layers(config: Config) -> dict[int, int]:
    """The layer that each vehicle gets first, if it can: one after the other, in the order of the file."""
    return {agent.vehicle: number % layer_count(config) for number, agent in enumerate(config.agents)}


class AltitudeLayers:
    """Assigns altitude layers: one for each vehicle while there are enough, and the same one if possible."""

    def __init__(self, config: Config) -> None:
        self._count = layer_count(config)
        self._least_m = config.planning.separation_m
        self._speeds_m_s = {agent.vehicle: config.speed_m_s(agent.vehicle) for agent in config.agents}
        self._lane = preferred_layers(config)
        self._newest: dict[int, Route] = {}
        self._base_m, self._step_m = config.mission.altitude_rel_m, config.mission.layer_step_m
        self.other_vehicles: tuple[OtherVehicle, ...] = ()
        """Vehicles in the air that have no route here: they keep the layer that they are in."""

    def of(self, vehicle: int) -> int:
        """Layer that a vehicle has, or gets if it can."""
        return self._lane.get(vehicle, 0)

    def give(
        self,
        routes: Sequence[Route],
        changed: Collection[int],
        agents: Mapping[int, Track],
        arrived: Collection[int],
    ) -> tuple[list[Route], list[str]]:
        """Return the routes in their layers, and what an operator should know.

        Routes of vehicles that are not in `changed` are flown already. Who has arrived circles where
        its last route led it.
        """
        flights = [self._flight(r, agents[r.vehicle], r.vehicle not in changed) for r in routes]
        flights += self._others(routes, arrived)
        layers, conflicts = assign_layers(flights, self._count, self._least_m)
        given = [
            replace(route, layer=layers[route.vehicle]) if route.vehicle in changed else route
            for route in routes
        ]
        self._newest |= {route.vehicle: route for route in given}
        self._lane |= {route.vehicle: route.layer for route in given}
        return given, [_words(conflict) for conflict in conflicts]

    def separation_m(
        self,
        routes: Sequence[Route],
        proposed: Collection[int],
        agents: Mapping[int, Track],
        arrived: Collection[int],
    ) -> dict[int, float]:
        """Return how near each vehicle comes to another of its layer, with routes in the layers they have."""
        flights = [
            replace(self._flight(r, agents[r.vehicle], r.vehicle not in proposed), layer=r.layer)
            for r in routes
        ]
        return min_separation_m([*flights, *self._others(routes, arrived)])

    def _others(self, routes: Sequence[Route], arrived: Collection[int]) -> list[PlannedFlight]:
        """What vehicles in the air without a route among these fly: they circle, or return."""
        planned, aside = {route.vehicle for route in routes}, {one.vehicle for one in self.other_vehicles}
        circling = [self._newest[v] for v in arrived if v in self._newest and v not in aside]
        flights = [self._beside(one, layer) for one, layer in self._layers() if one.vehicle not in planned]
        return flights + [self._circling(route) for route in circling]

    def is_clear(self, route: Route, routes: Sequence[Route], places: Mapping[int, Point]) -> bool:
        """Return True if a route keeps clear, in its layer, of others that are flown from where these are."""
        flights = [self._beside(one, layer) for one, layer in self._layers() if one.vehicle != route.vehicle]
        flown = [one for one in (*routes, route) if one.vehicle in places]
        flights += [self._from(one, places[one.vehicle]) for one in flown]
        _, conflicts = assign_layers(flights, self._count, self._least_m)
        return not any(route.vehicle in conflict.vehicles for conflict in conflicts)

    def _layers(self) -> Iterator[tuple[OtherVehicle, int]]:
        """Yield vehicles aside whose heights lie in a layer, with that."""
        for one in self.other_vehicles:
            layer = round((one.height_m - self._base_m) / self._step_m) if self._count > 1 else 0
            if 0 <= layer < self._count:
                yield one, layer

    def _beside(self, one: OtherVehicle, layer: int) -> PlannedFlight:
        points_m = np.array((one.place_m, one.to_m))
        return PlannedFlight(one.vehicle, points_m, self._speeds_m_s[one.vehicle], layer, True)

    def _flight(self, route: Route, agent: Track, is_flown: bool) -> PlannedFlight:
        place = place_of(agent)
        if is_flown:
            return self._from(route, place)
        points_m, layer = np.vstack((place, route.flown_m)), self.of(route.vehicle)
        return PlannedFlight(route.vehicle, points_m, self._speeds_m_s[route.vehicle], layer)

    def _from(self, route: Route, place: Point) -> PlannedFlight:
        """What is left of a route that is flown, from where its vehicle is."""
        points_m = np.vstack((place, route.flown_m[next_point(route.flown_m, place, CORRIDOR_M) :]))
        return PlannedFlight(route.vehicle, points_m, self._speeds_m_s[route.vehicle], route.layer, True)

    def _circling(self, route: Route) -> PlannedFlight:
        return PlannedFlight(
            route.vehicle, route.flown_m[[-1, -1]], self._speeds_m_s[route.vehicle], route.layer, True
        )


def _words(conflict: Conflict) -> str:
    """Say it without figures that change from look to look: it is said once."""
    first, second = (vehicle_name(vehicle) for vehicle in conflict.vehicles)
    return f"agents {first} and {second} will come near each other at one altitude: no layer is left"
