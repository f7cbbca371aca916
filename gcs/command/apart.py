"""Altitude lanes for the routes of a plan."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs.command.aims import place_of
from gcs.config import Config
from gcs.model import Route, Track, vehicle_name
from gcs.planning.progress import CORRIDOR_M, next_point
from gcs.planning.separation import Conflict, Flight, least_separation_m, separate


def lane_count(config: Config) -> int:
    """How many lanes a mission has."""
    return config.mission.lanes if config.mission.lane_step_m > 0.0 else 1


def own_lanes(config: Config) -> dict[int, int]:
    """The lane that each vehicle gets first, if it can: one after the other, in the order of the file."""
    return {agent.vehicle: number % lane_count(config) for number, agent in enumerate(config.agents)}


class Lanes:
    """Who flies how high: each vehicle its own lane while there are enough, and the same one if it can be."""

    def __init__(self, config: Config) -> None:
        self._count = lane_count(config)
        self._least_m = config.planning.separation_m
        self._speeds_m_s = {agent.vehicle: config.speed_m_s(agent.vehicle) for agent in config.agents}
        self._lane = own_lanes(config)
        self._newest: dict[int, Route] = {}

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
        """Return the routes in their lanes, and what an operator should know.

        Routes of vehicles that are not in `changed` are flown already. Who has arrived circles where
        its last route led it.
        """
        flights = self._flights(routes, changed, agents, arrived)
        lanes, conflicts = separate(flights, self._count, self._least_m)
        given = [
            replace(route, lane=lanes[route.vehicle]) if route.vehicle in changed else route
            for route in routes
        ]
        self._newest |= {route.vehicle: route for route in given}
        self._lane |= {route.vehicle: route.lane for route in given}
        return given, [_words(conflict) for conflict in conflicts]

    def separation_m(
        self,
        routes: Sequence[Route],
        proposed: Collection[int],
        agents: Mapping[int, Track],
        arrived: Collection[int],
    ) -> dict[int, float]:
        """Return how near each vehicle comes to another of its lane, with routes in the lanes they have."""
        flights = [
            replace(flight, lane=route.lane)
            for flight, route in zip(self._flights(routes, proposed, agents, ()), routes, strict=True)
        ]
        return least_separation_m([*flights, *self._flights((), (), agents, arrived)])

    def _flights(
        self,
        routes: Sequence[Route],
        changed: Collection[int],
        agents: Mapping[int, Track],
        arrived: Collection[int],
    ) -> list[Flight]:
        flights = [self._flight(r, agents[r.vehicle], r.vehicle not in changed) for r in routes]
        return flights + [self._circling(self._newest[v]) for v in arrived if v in self._newest]

    def _flight(self, route: Route, agent: Track, is_flown: bool) -> Flight:
        place = place_of(agent)
        first = next_point(route.flown_m, place, CORRIDOR_M) if is_flown else 0
        points_m = np.vstack((place, route.flown_m[first:]))
        lane = route.lane if is_flown else self.of(route.vehicle)
        return Flight(route.vehicle, points_m, self._speeds_m_s[route.vehicle], lane, is_flown)

    def _circling(self, route: Route) -> Flight:
        return Flight(
            route.vehicle, route.flown_m[[-1, -1]], self._speeds_m_s[route.vehicle], route.lane, True
        )


def _words(conflict: Conflict) -> str:
    """Say it without figures that change from look to look: it is said once."""
    first, second = (vehicle_name(vehicle) for vehicle in conflict.vehicles)
    return f"agents {first} and {second} will come near each other at one altitude: no lane is left"
