"""Routes over terrain that are kept apart: at the heights of another layer, or by a detour round a vehicle.

First each route in turn gets a layer, as over level ground. Where climbs are steep the heights of all layers
come together, so that none separates two vehicles. Then one of those that meet soon gets a route round, over
or under the places where the other one will be, if it is in the air: on the ground it waits for its turn.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from gcs.model import Route
from gcs.planning.layer_assignment import Conflict, PlannedFlight, assign_layers, meeting_places_m
from gcs.planning.pair_route import shape_over_terrain
from gcs.planning.plan_result import Choice
from gcs.planning.planner_inputs import MissionInputs, TargetDemand
from gcs.planning.terrain.detour import AvoidedFlight
from gcs.planning.terrain.terrain_search import TerrainSearch

_SOON_S: Final = 90.0
"""Time ahead in which a vehicle makes a detour round another one."""
_MAX_DETOURS: Final = 8
"""Detours that are tried in one plan."""
_DETOURS_EACH: Final = 2
"""Detours that are tried for one vehicle of a pair: the second one leads round the next vehicle, too."""
_MAX_LONGER_M: Final = 500.0
"""Length that a detour may add."""
_MARGIN: Final = 1.3
"""Multiple of the least distances that new routes keep from others where they can."""
_DETOUR_MARGIN: Final = 1.5
"""Multiple of the least distances that a detour keeps from the predicted places of the other vehicle."""
_GAIN_S: Final = 20.0
"""Time by which it must meet another vehicle later."""
_AROUND_S: Final = 5.0
"""Error of the time at which the other vehicle is at a place."""


@dataclass(frozen=True)
class _Planned:
    """Route that a vehicle may get, and whom it comes near to there."""

    route: Route
    flight: PlannedFlight
    near: list[Conflict]

    @property
    def first_s(self) -> float:
        """When it first comes near another one; infinite if it does not."""
        return min((one.after_s for one in self.near), default=math.inf)


def separate_over_terrain(
    choice: Choice, inputs: MissionInputs
) -> tuple[list[Route], list[PlannedFlight], tuple[Conflict, ...]]:
    """Return new routes that are kept apart, their flights, and the pairs that come near all the same.

    Each route in turn gets the first layer, from the preferred one on, in which it is separated from others,
    or else the one in which it meets one last. Then those that meet soon make detours, the first first.
    """
    planned: dict[int, PlannedFlight] = {}
    routes: dict[int, Route] = {}
    searches = {route.vehicle: _Search(route, inputs) for route in choice.new}
    for route in choice.new:
        others = [*choice.flights, *planned.values()]
        one = _in_best_layer(route, searches[route.vehicle], others, inputs)
        planned[route.vehicle] = one.flight
        routes[route.vehicle] = one.route
    left = _MAX_DETOURS
    tried: set[tuple[int, int]] = set()
    while left > 0:
        near = _conflicts_of(planned, choice.flights, inputs, _MARGIN)
        soon = [one for one in near if one.after_s <= _SOON_S and one.vehicles not in tried]
        if not soon:
            break
        pair = min(soon, key=lambda one: one.after_s).vehicles
        tried.add(pair)
        for vehicle in reversed(pair):
            if vehicle not in planned or inputs.agents[vehicle].is_grounded or left <= 0:
                continue
            others = [*choice.flights, *(flight for v, flight in planned.items() if v != vehicle)]
            present = _planned(routes[vehicle], others, inputs)
            most = min(left, _DETOURS_EACH)
            detour, count = _with_detour(present, searches[vehicle], others, inputs, most)
            left -= count
            if detour is not None:
                planned[vehicle] = detour.flight
                routes[vehicle] = detour.route
                break
    near = _conflicts_of(planned, choice.flights, inputs)
    return list(routes.values()), list(planned.values()), tuple(near)


def _conflicts_of(
    planned: Mapping[int, PlannedFlight],
    kept: Sequence[PlannedFlight],
    inputs: MissionInputs,
    margin: float = 1.0,
) -> list[Conflict]:
    """Return the pairs that come near each other, with one of the planned vehicles at least."""
    near = _conflicts([*kept, *planned.values()], inputs, margin)
    return [one for one in near if not planned.keys().isdisjoint(one.vehicles)]


class _Search:
    """Routes of one vehicle to its target, in each layer, and beside other flights."""

    def __init__(self, lowest: Route, inputs: MissionInputs) -> None:
        self._lowest = lowest
        self._inputs = inputs

    @cached_property
    def _search(self) -> TerrainSearch:
        inputs = self._inputs
        assert inputs.terrain is not None
        agent = inputs.agents[self._lowest.vehicle]
        target_m = inputs.grid.nearest_inside(inputs.targets[self._lowest.target])
        demand = inputs.demands.get(self._lowest.target, TargetDemand())
        velocities_m_s = [demand.velocity_m_s]
        return TerrainSearch(inputs.terrain, inputs.grid, [agent], [target_m], inputs.options, velocities_m_s)

    def route(self, layer: int, avoided: Sequence[AvoidedFlight] = ()) -> Route | None:
        """Return the route in a layer; None without one."""
        if layer == 0 and not avoided:
            return self._lowest  # planned so
        route = self._lowest
        shaped = shape_over_terrain(self._search, (0, 0), route.vehicle, route.target, layer, avoided).route
        return None if shaped is None else replace(shaped, layer=layer)


def _in_best_layer(
    route: Route, search: _Search, others: Sequence[PlannedFlight], inputs: MissionInputs
) -> _Planned:
    """Return a route in the first layer in which it is separated, or else in which it meets another last."""
    tries: list[_Planned] = []
    for turn in range(inputs.layers):
        layer = (inputs.preferred_layers[route.vehicle] + turn) % inputs.layers
        tries.append(_planned(search.route(layer) or replace(route, layer=layer), others, inputs))
        if not tries[-1].near:
            break
    return max(tries, key=lambda one: one.first_s)


def _with_detour(
    planned: _Planned,
    search: _Search,
    others: Sequence[PlannedFlight],
    inputs: MissionInputs,
    most: int,
) -> tuple[_Planned | None, int]:
    """Return a route round those that a vehicle would meet, None without one, and how many were tried."""
    route = planned.route
    latest = planned
    avoided: list[AvoidedFlight] = []
    for tried in range(1, most + 1):
        first = min(latest.near, key=lambda one: one.after_s)
        (met,) = (vehicle for vehicle in first.vehicles if vehicle != route.vehicle)
        other = next(one for one in others if one.vehicle == met)
        limits_m = _MARGIN * inputs.separation_m, _MARGIN * inputs.min_height_m
        places_m = meeting_places_m(latest.flight, other, *limits_m, _AROUND_S)
        radius_m = max(other.radius_m, other.end_radius_m)
        distance_m = _DETOUR_MARGIN * inputs.separation_m + radius_m
        avoided.append(AvoidedFlight(places_m, distance_m, _DETOUR_MARGIN * inputs.min_height_m))
        detour = search.route(route.layer, avoided)
        if detour is None or detour.length_m > route.length_m + _MAX_LONGER_M:
            return None, tried
        latest = _planned(detour, others, inputs)
        if latest.first_s > planned.first_s + _GAIN_S:
            return latest, tried
    return None, most


def _planned(route: Route, others: Sequence[PlannedFlight], inputs: MissionInputs) -> _Planned:
    flight = replace(new_flight(route, inputs), layer=route.layer, keeps_layer=True)
    near = [one for one in _conflicts([*others, flight], inputs, _MARGIN) if route.vehicle in one.vehicles]
    return _Planned(route, flight, near)


def _conflicts(
    flights: Sequence[PlannedFlight], inputs: MissionInputs, margin: float = 1.0
) -> tuple[Conflict, ...]:
    limits_m = margin * inputs.separation_m, margin * inputs.min_height_m
    return assign_layers(flights, inputs.layers, *limits_m)[1]


def new_flight(route: Route, inputs: MissionInputs) -> PlannedFlight:
    """Return the flight on a new route, in any layer."""
    agent = inputs.agents[route.vehicle]
    begin_m = inputs.begins_m.get(route.vehicle, [(agent.east_m, agent.north_m)])
    path_m = np.vstack((*begin_m, route.flown_m))
    heights_m = route.heights_msl_m
    circle_m = 0.0
    if heights_m is not None:
        heights_m = np.concatenate((np.full(len(begin_m), agent.height_msl_m), heights_m))
        loiter = (agent.options or inputs.options).loiter
        circle_m = 0.0 if loiter is None else loiter.radius_m
    return PlannedFlight(
        route.vehicle,
        path_m,
        agent.speed_m_s,
        inputs.preferred_layers[route.vehicle],
        heights_msl_m=heights_m,
        end_radius_m=circle_m,
        wind_m_s=agent.wind_m_s,
    )
