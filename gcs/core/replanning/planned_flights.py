"""Planned flights of all vehicles, and the altitude layers of their routes."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs.config import Config
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.plan_targets import place_of
from gcs.core.replanning.replanning_state import OtherVehicle, ReplanningState
from gcs.core.state import Agent
from gcs.core.tasking.mission_builder import flown_points
from gcs.model import FloatArray, Route, VehicleState
from gcs.planning.layer_assignment import Conflict, PlannedFlight, assign_layers, min_separation_m
from gcs.planning.map.grid import Point
from gcs.planning.planner_inputs import MissionInputs
from gcs.planning.route_progress import remaining_m
from gcs.planning.wind_triangle import plausible_wind_m_s

_SOON_S = 120.0
"""A vehicle that is met later is no reason for another layer yet."""
_NEAR_LAYER = 0.25
"""A vehicle less than this share of a layer step from a layer is in that layer alone."""


class AltitudeLayers:
    """Altitude layers of vehicles, and the flights that a new route keeps clear of."""

    def __init__(
        self,
        config: Config,
        mission: MissionInputs,
        agents: Mapping[int, Agent],
        state: ReplanningState,
    ) -> None:
        self._mission = mission
        self._agents = agents
        self._state = state
        airframes = config.airframes_of_agents.items()
        self._radii_m = {vehicle: one.loiter_radius_m for vehicle, one in airframes}
        self._flown_radii_m = {vehicle: one.circle_radius_m for vehicle, one in airframes}
        """Of circles as they are flown, in thin air and wind."""
        self._base_m = config.mission.altitude_rel_m
        self._step_m = config.mission.layer_step_m
        self._base_msl_m = config.frame.alt_msl_m

    def height_m(self, layer: int) -> float:
        """Return the height of a layer above home."""
        return self._base_m + layer * self._step_m

    def end_height_m(self, route: Route) -> float:
        """Return the height of the end of a route above home."""
        if route.heights_msl_m is None:
            return self.height_m(route.layer)
        return float(route.heights_msl_m[-1]) - self._base_msl_m

    def present_height_m(self, state: VehicleState, above_own_m: float) -> float:
        """Return the height of a vehicle above home: over terrain above that of the mission file."""
        return above_own_m if self._mission.terrain is None else state.alt_msl_m - self._base_msl_m

    def of(self, vehicle: int) -> int:
        """Return the layer of a vehicle, or its preferred one."""
        latest = self._agents[vehicle].routes.latest
        return self._mission.preferred_layers[vehicle] if latest is None else latest.layer

    def flights(
        self, kept: Sequence[Route], new: Sequence[Route], inputs: PlanningInputs
    ) -> list[PlannedFlight]:
        """Return the flights that new routes keep clear of: on routes that are kept, and without a route.

        Arrived vehicles circle at the ends of their last routes. Routes of vehicles with a climb begin at its
        end.
        """
        flights = [self._from(route, begin_m(route.vehicle, inputs)) for route in kept]
        return flights + self._others([*kept, *new], inputs.arrived)

    def that_may_meet(
        self, new: Sequence[Route], kept: Sequence[Route], inputs: PlanningInputs
    ) -> list[Route]:
        """Return the kept routes whose areas come near those of new ones, at any time."""
        if not (new and kept):
            return []
        reach_m = self._mission.separation_m + 2.0 * max(self._radii_m.values())
        low_m, high_m = (bounds[:, None] for bounds in _areas(new, inputs))
        lows_m, highs_m = _areas(kept, inputs)
        is_near = ((lows_m - high_m < reach_m) & (low_m - highs_m < reach_m)).all(axis=2)
        return [kept[k] for k in np.flatnonzero(is_near.any(axis=0)).tolist()]

    def separation_m(
        self, routes: Sequence[Route], proposed: Collection[int], inputs: PlanningInputs
    ) -> dict[int, float]:
        """Return the minimum distance of each vehicle to another of its layer."""
        kept = [route for route in routes if route.vehicle not in proposed]
        flights = [self._from(r, begin_m(r.vehicle, inputs), 0) for r in routes if r.vehicle in proposed]
        return min_separation_m([*flights, *self.flights(kept, routes, inputs)], self._mission.min_height_m)

    def _others(self, routes: Sequence[Route], arrived: Collection[int]) -> list[PlannedFlight]:
        """Return the flights of vehicles without a route among these: they circle, or return."""
        planned = {route.vehicle for route in routes}
        others = {one.vehicle for one in self._state.other_vehicles}
        latest = [self._agents[vehicle].routes.latest for vehicle in arrived if vehicle not in others]
        circling = [self._circling(route) for route in latest if route is not None]
        return [one for one in self._other_flights() if one.vehicle not in planned] + circling

    def _circling(self, route: Route) -> PlannedFlight:
        """Return the flight round the circle at the end of a route."""
        end_m = route.flown_m[[-1, -1]]
        heights_m = None if route.heights_msl_m is None else route.heights_msl_m[[-1, -1]]
        return self._planned(route, end_m, route.layer, heights_m, self._flown_radii_m[route.vehicle])

    def is_clear(self, route: Route, routes: Sequence[Route], places: Mapping[int, Point]) -> bool:
        """Return True if a route is separated, in its layer, from others flown from these positions."""
        flights = [one for one in self._other_flights() if one.vehicle != route.vehicle]
        flown = [one for one in (*routes, route) if one.vehicle in places]
        flights += [self._from(one, [places[one.vehicle]]) for one in flown]
        conflicts = self._conflicts(flights)
        return not any(route.vehicle in conflict.vehicles for conflict in conflicts)

    def occupied(self, routes: Sequence[Route], inputs: PlanningInputs) -> set[int]:
        """Return the vehicles that soon meet one without a route in their layers, and not in another."""
        flights = self.flights(routes, (), inputs)
        if self._mission.layers < 2 or len(flights) == len(routes):
            return set()
        conflicts = self._conflicts(flights)
        pairs = [set(one.vehicles) for one in conflicts if one.after_s <= _SOON_S]
        ours = {route.vehicle for route in routes}
        met = set[int]().union(*(pair & ours for pair in pairs if len(pair & ours) == 1))
        return {vehicle for vehicle in met if self._is_apart_elsewhere(vehicle, flights)}

    def conflicts(self, routes: Sequence[Route], inputs: PlanningInputs) -> tuple[Conflict, ...]:
        """Return which vehicles come near each other on the rest of their routes, or on circles, as now."""
        return self._conflicts(self.flights(routes, (), inputs))

    def first_met(self, routes: Sequence[Route], inputs: PlanningInputs) -> dict[int, float]:
        """Return when vehicles soon meet others at one height, in seconds, the first first."""
        conflicts = self.conflicts(routes, inputs)
        ours = {route.vehicle for route in routes}
        soon = sorted((one for one in conflicts if one.after_s <= _SOON_S), key=lambda one: -one.after_s)
        met = {v: one.after_s for one in soon for v in one.vehicles if v in ours}
        return dict(sorted(met.items(), key=lambda one: (one[1], -one[0])))

    def _conflicts(self, flights: Sequence[PlannedFlight]) -> tuple[Conflict, ...]:
        mission = self._mission
        return assign_layers(flights, mission.layers, mission.separation_m, mission.min_height_m)[1]

    def _is_apart_elsewhere(self, vehicle: int, flights: Sequence[PlannedFlight]) -> bool:
        free = [replace(one, keeps_layer=one.vehicle != vehicle) for one in flights]
        conflicts = self._conflicts(free)
        return not any(vehicle in conflict.vehicles for conflict in conflicts)

    def _other_flights(self) -> list[PlannedFlight]:
        """Return the flights of the other vehicles within a layer."""
        flights = []
        for one in self._state.other_vehicles:
            level = (one.height_m - self._base_m) / self._step_m if self._mission.layers > 1 else 0.0
            near = {math.floor(level + _NEAR_LAYER), math.ceil(level - _NEAR_LAYER)}  # between two: both
            places_m = np.array((one.position_m, one.to_m))
            if self._mission.terrain is not None:
                heights_m = np.full(2, self._base_msl_m + one.height_m)
                flights.append(self._planned(one, places_m, 0, heights_m, one.radius_m))
                continue
            flights += [
                self._planned(one, places_m, layer, None, one.radius_m)
                for layer in sorted(near)
                if 0 <= layer < self._mission.layers
            ]
        return flights

    def _from(self, route: Route, begin: Sequence[Point], passed: int | None = None) -> PlannedFlight:
        """Return the flight on a route; without a number of points passed, the remaining one."""
        agent = self._agents[route.vehicle]
        if passed is None:
            passed = flown_points(agent, route, agent.perception.motion.state)
        points_m = np.vstack((*begin, remaining_m(route.flown_m, passed)))
        heights_m = self._heights_msl_m(route, len(begin), passed)
        return self._planned(route, points_m, route.layer, heights_m)

    def _planned(
        self,
        one: Route | OtherVehicle,
        points_m: FloatArray,
        layer: int,
        heights_m: FloatArray | None,
        radius_m: float = 0.0,
    ) -> PlannedFlight:
        """Return a flight that keeps its layer."""
        speed_m_s = self._mission.agents[one.vehicle].speed_m_s
        circle_m = 0.0 if heights_m is None else self._radii_m[one.vehicle]
        return PlannedFlight(
            one.vehicle,
            points_m,
            speed_m_s,
            layer,
            keeps_layer=True,
            radius_m=radius_m,
            heights_msl_m=heights_m,
            end_radius_m=circle_m,
            wind_m_s=self.wind_m_s(one.vehicle) or (0.0, 0.0),
        )

    def wind_m_s(self, vehicle: int) -> Point | None:
        """Return the wind that a vehicle reports, east and north; None if it reports none."""
        agent = self._agents[vehicle]
        state = agent.perception.motion.state
        if state is None:
            return None
        cruise_m_s = self._mission.agents[vehicle].speed_m_s
        return plausible_wind_m_s(agent.link.wind_m_s, state.ground_speed_m_s, state.course_rad, cruise_m_s)

    def _heights_msl_m(self, route: Route, begins: int, passed: int = 0) -> FloatArray | None:
        """Return the heights of the rest of a route over terrain, and its vehicle's height before it."""
        if route.heights_msl_m is None:
            return None
        left_m = remaining_m(route.heights_msl_m, passed)
        state = self._agents[route.vehicle].perception.motion.state
        now_m = float(left_m[0]) if state is None else state.alt_msl_m
        return np.concatenate((np.full(begins, now_m), left_m))


def _areas(routes: Sequence[Route], inputs: PlanningInputs) -> tuple[FloatArray, FloatArray]:
    """Return the least and the greatest coordinates of routes with their begins and climbs, (n, 2) each."""
    begins_m = [begin_m(route.vehicle, inputs) for route in routes]
    ends_m = np.array([(begin[0], begin[-1]) for begin in begins_m])
    first = np.cumsum([0] + [len(route.flown_m) for route in routes[:-1]])
    points_m = np.concatenate([route.flown_m for route in routes])
    low_m: FloatArray = np.minimum(np.minimum.reduceat(points_m, first), ends_m.min(axis=1))
    high_m: FloatArray = np.maximum(np.maximum.reduceat(points_m, first), ends_m.max(axis=1))
    return low_m, high_m


def begin_m(vehicle: int, inputs: PlanningInputs) -> list[Point]:
    """Return where an agent is, and the end of its climb."""
    place_m = place_of(inputs.agents[vehicle])
    climb = inputs.climbs.get(vehicle)
    return [place_m] if climb is None else [place_m, climb.latest_end_m]
