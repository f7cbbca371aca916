"""Planned flights of all vehicles, and the altitude layers of their routes."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from gcs.config import Config
from gcs.core.replanning.plan_targets import place_of
from gcs.core.replanning.records import OtherVehicle, ReplanningState
from gcs.core.state import Agent
from gcs.core.tasking.mission_builder import flown_points
from gcs.model import FloatArray, NoticeCode, Route, Track
from gcs.planning.layer_assignment import Conflict, PlannedFlight, assign_layers, min_separation_m
from gcs.planning.manoeuvres.climb import Climb
from gcs.planning.map.grid import Point
from gcs.planning.plan_notes import PlanNote
from gcs.planning.route_progress import remaining_m

_SOON_S = 120.0
"""A vehicle that is met later is no reason for another layer yet."""
_NEAR_LAYER = 0.25
"""A vehicle less than this share of a layer step from a layer is in that layer alone."""


def layer_count(config: Config) -> int:
    """Return the number of altitude layers."""
    return config.mission.layers if config.mission.layer_step_m > 0.0 else 1


def preferred_layers(config: Config) -> dict[int, int]:
    """Return the preferred layer of each vehicle, in the order of the mission file."""
    return {agent.vehicle: number % layer_count(config) for number, agent in enumerate(config.agents)}


class AltitudeLayers:
    """Assigns altitude layers: one per vehicle while there are enough, and a constant one if possible."""

    def __init__(self, config: Config, agents: Mapping[int, Agent], state: ReplanningState) -> None:
        self._agents = agents
        self._state = state
        self._count = layer_count(config)
        self._min_separation_m = config.planning.separation_m
        self._speeds_m_s = config.speeds_m_s
        airframes = config.airframes_of_agents.items()
        self._radii_m = {vehicle: one.loiter_radius_m for vehicle, one in airframes}
        self._preferred = preferred_layers(config)
        self._base_m = config.mission.altitude_rel_m
        self._step_m = config.mission.layer_step_m

    def of(self, vehicle: int) -> int:
        """Return the layer of a vehicle, or its preferred one."""
        latest = self._agents[vehicle].routes.latest
        return self._preferred[vehicle] if latest is None else latest.layer

    def give(
        self,
        routes: Sequence[Route],
        changed: Collection[int],
        agents: Mapping[int, Track],
        arrived: Collection[int],
        climbs: Mapping[int, Climb] = MappingProxyType({}),
    ) -> tuple[list[Route], list[PlanNote]]:
        """Return the routes with their layers, and notes for the operator.

        Routes of vehicles that are not in `changed` are flown already. Arrived vehicles circle at the ends
        of their last routes. Routes of vehicles with a climb begin at its end.
        """
        begins = {r.vehicle: _begin(agents[r.vehicle], climbs.get(r.vehicle)) for r in routes}
        flights = [
            self._new(r, begins[r.vehicle]) if r.vehicle in changed else self._from(r, begins[r.vehicle])
            for r in routes
        ]
        flights += self._others(routes, arrived)
        layers, conflicts = assign_layers(flights, self._count, self._min_separation_m)
        given = [
            replace(route, layer=layers[route.vehicle]) if route.vehicle in changed else route
            for route in routes
        ]
        for route in given:
            self._agents[route.vehicle].routes.latest = route
        return given, [_note(conflict) for conflict in conflicts]

    def separation_m(
        self,
        routes: Sequence[Route],
        proposed: Collection[int],
        agents: Mapping[int, Track],
        arrived: Collection[int],
        climbs: Mapping[int, Climb],
    ) -> dict[int, float]:
        """Return the minimum distance of each vehicle to another of its layer."""
        begins = {r.vehicle: _begin(agents[r.vehicle], climbs.get(r.vehicle)) for r in routes}
        flights = [
            replace(self._new(r, begins[r.vehicle]), layer=r.layer)
            if r.vehicle in proposed
            else self._from(r, begins[r.vehicle])
            for r in routes
        ]
        return min_separation_m([*flights, *self._others(routes, arrived)])

    def _others(self, routes: Sequence[Route], arrived: Collection[int]) -> list[PlannedFlight]:
        """Return the flights of vehicles without a route among these: they circle, or return."""
        planned = {route.vehicle for route in routes}
        others = {one.vehicle for one in self._state.other_vehicles}
        latest = [self._agents[vehicle].routes.latest for vehicle in arrived if vehicle not in others]
        circling = [
            self._planned(route, route.flown_m[[-1, -1]], route.layer, radius_m=self._radii_m[route.vehicle])
            for route in latest
            if route is not None
        ]
        return [one for one in self._other_flights() if one.vehicle not in planned] + circling

    def is_clear(self, route: Route, routes: Sequence[Route], places: Mapping[int, Point]) -> bool:
        """Return True if a route is separated, in its layer, from others flown from these positions."""
        flights = [one for one in self._other_flights() if one.vehicle != route.vehicle]
        flown = [one for one in (*routes, route) if one.vehicle in places]
        flights += [self._from(one, [places[one.vehicle]]) for one in flown]
        _, conflicts = assign_layers(flights, self._count, self._min_separation_m)
        return not any(route.vehicle in conflict.vehicles for conflict in conflicts)

    def occupied(
        self,
        routes: Sequence[Route],
        agents: Mapping[int, Track],
        arrived: Collection[int],
        climbs: Mapping[int, Climb] = MappingProxyType({}),
    ) -> set[int]:
        """Return the vehicles that soon meet one without a route in their layers, and not in another."""
        others = self._others(routes, arrived)
        if self._count < 2 or not others:
            return set()
        flights = [
            self._from(route, _begin(agents[route.vehicle], climbs.get(route.vehicle))) for route in routes
        ]
        _, conflicts = assign_layers([*flights, *others], self._count, self._min_separation_m)
        pairs = [set(one.vehicles) for one in conflicts if one.after_s <= _SOON_S]
        ours = {route.vehicle for route in routes}
        met = set[int]().union(*(pair & ours for pair in pairs if len(pair & ours) == 1))
        return {vehicle for vehicle in met if self._is_apart_elsewhere(vehicle, [*flights, *others])}

    def _is_apart_elsewhere(self, vehicle: int, flights: Sequence[PlannedFlight]) -> bool:
        free = [replace(one, keeps_layer=one.vehicle != vehicle) for one in flights]
        _, conflicts = assign_layers(free, self._count, self._min_separation_m)
        return not any(vehicle in conflict.vehicles for conflict in conflicts)

    def _other_flights(self) -> list[PlannedFlight]:
        """Return the flights of the other vehicles within a layer."""
        flights = []
        for one in self._state.other_vehicles:
            level = (one.height_m - self._base_m) / self._step_m if self._count > 1 else 0.0
            near = {math.floor(level + _NEAR_LAYER), math.ceil(level - _NEAR_LAYER)}  # between two: both
            places_m = np.array((one.position_m, one.to_m))
            flights += [
                self._planned(one, places_m, layer, radius_m=one.radius_m)
                for layer in sorted(near)
                if 0 <= layer < self._count
            ]
        return flights

    def _new(self, route: Route, begin: Sequence[Point]) -> PlannedFlight:
        """Return the flight on a new route, in any layer."""
        points_m = np.vstack((*begin, route.flown_m))
        layer = self.of(route.vehicle)
        return self._planned(route, points_m, layer, is_fixed=False)

    def _from(self, route: Route, begin: Sequence[Point]) -> PlannedFlight:
        """Return the remaining flight on a route."""
        agent = self._agents[route.vehicle]
        passed = flown_points(agent, route, agent.perception.motion.state)
        points_m = np.vstack((*begin, remaining_m(route.flown_m, passed)))
        return self._planned(route, points_m, route.layer)

    def _planned(
        self,
        one: Route | OtherVehicle,
        points_m: FloatArray,
        layer: int,
        *,
        is_fixed: bool = True,
        radius_m: float = 0.0,
    ) -> PlannedFlight:
        speed_m_s = self._speeds_m_s[one.vehicle]
        return PlannedFlight(one.vehicle, points_m, speed_m_s, layer, is_fixed, radius_m)


def _begin(agent: Track, climb: Climb | None) -> list[Point]:
    """Return where an agent is, and the end of its climb."""
    return [place_of(agent)] if climb is None else [place_of(agent), climb.latest_end_m]


def _note(conflict: Conflict) -> PlanNote:
    """Return a note without figures, which would make it new at every check."""
    return PlanNote(NoticeCode.NO_LAYER_LEFT, None, {"vehicles": conflict.vehicles})
