"""Kept routes: which of their routes vehicles fly on with when a plan has others for them."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from typing import Final

import numpy as np

from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.replanning.triggers import Triggers
from gcs.core.state import Agent
from gcs.model import FloatArray, Route
from gcs.planning.map.grid import Point
from gcs.planning.plan_result import Choice, PlanResult, choose_new
from gcs.planning.planner_inputs import AgentState, MissionInputs
from gcs.planning.route_joining import total_turn_rad

_SAME_PLACE_M: Final = 1.0
_NEAR_END_M: Final = 100.0
_MAX_TURN_NEAR_END_RAD: Final = math.radians(270.0)
"""Turns beyond which a vehicle near its target, or near the end of its route, keeps the route it flies."""
_LOW_M: Final = 5.0
"""Distance below the flight band from which a new route is no improvement."""
_SAMPLE_M: Final = 20.0
_LOOP_RADII: Final = 4.0
"""Extent of a loop's waypoints, in turn radii."""


class KeptRoutes:
    """Chooses between new routes and those that vehicles have."""

    def __init__(
        self,
        mission: MissionInputs,
        layers: AltitudeLayers,
        triggers: Triggers,
        agents: Mapping[int, Agent],
    ) -> None:
        self._mission = mission
        self._layers = layers
        self._triggers = triggers
        self._agents = agents

    def settled(
        self, mission: MissionInputs, occupied: Container[int], inputs: PlanningInputs
    ) -> dict[int, Route]:
        """Return the routes that vehicles keep if they keep their targets, whatever new ones would be.

        They are those that `_is_still_good` accepts for any other route.
        """
        triggers = self._triggers
        found: dict[int, Route] = {}
        for vehicle in mission.agents:
            routes = self._agents[vehicle].routes
            is_flyable = not routes.is_blocked and vehicle not in occupied
            route = routes.flown if routes.proposed is None and is_flyable else routes.proposed
            if (
                route is not None
                and route.target in mission.targets
                and self._is_near_enough(vehicle, route, inputs)
                and not triggers.has_passed_target(vehicle, inputs)
                and not triggers.is_endangered(vehicle, inputs)
            ):
                found[vehicle] = route
        return found

    def choose(
        self,
        starts: Mapping[int, AgentState],
        arriving: Sequence[Route],
        settled: Mapping[int, Route],
        occupied: Container[int],
        inputs: PlanningInputs,
        result: PlanResult,
    ) -> Choice:
        """Choose between new routes and those that vehicles have."""
        kept = [*arriving, *(settled[vehicle] for vehicle in sorted(result.settled))]
        kept += self._without_end(result, inputs)
        new: list[Route] = []
        for route, changed in zip(result.routes, choose_new(result).new, strict=True):
            current = self._agents[route.vehicle].routes
            is_flyable = not current.is_blocked and route.vehicle not in occupied
            is_worse = self.is_low(changed) or self._turns_back(changed, starts[route.vehicle], inputs)
            # A route that waits for approval stays as long as it is good.
            good = [
                one
                for one in (current.proposed, current.flown if is_flyable else None)
                if one is not None
                and self._is_still_good(one, route, inputs, is_worse or route.vehicle in result.stops_short)
            ]
            kept += good[:1]
            new += [] if good else [changed]
        return Choice(new, kept, self._layers.flights(kept, new, inputs))

    def _is_near_enough(self, vehicle: int, route: Route, inputs: PlanningInputs) -> bool:
        """Return True if a route ends near enough to its target, or is too new to be changed."""
        triggers = self._triggers
        return not triggers.is_settled(vehicle, inputs) or triggers.is_within_tolerance(
            vehicle, route, inputs
        )

    def _without_end(self, result: PlanResult, inputs: PlanningInputs) -> list[Route]:
        """Return the flown routes to targets where no new route has a clear end: they are kept."""
        flown = {vehicle: self._agents[vehicle].routes for vehicle in sorted(result.endless)}
        return [
            routes.flown
            for vehicle, routes in flown.items()
            if routes.flown is not None
            and routes.flown.target in inputs.targets
            and not routes.is_blocked
            and not self._triggers.is_endangered(vehicle, inputs)
        ]

    def is_low(self, route: Route) -> bool:
        """Return True if a route leads below the flight band, since its vehicle is low where it begins."""
        terrain = self._mission.terrain
        if terrain is None or route.heights_msl_m is None:
            return False
        legs_m = np.hypot(*np.diff(route.flown_m, axis=0).T)
        along_m = np.concatenate(([0.0], np.cumsum(legs_m)))
        at_m = np.arange(0.0, along_m[-1] + _SAMPLE_M, _SAMPLE_M)
        places_m = np.column_stack([np.interp(at_m, along_m, axis) for axis in route.flown_m.T])
        agl_m = np.interp(at_m, along_m, route.heights_msl_m) - terrain.elevation.heights_at(places_m)
        return float(agl_m.min()) < terrain.min_agl_m - _LOW_M

    def _is_still_good(self, flown: Route, new: Route, inputs: PlanningInputs, is_worse: bool) -> bool:
        """Return True if a vehicle should keep its route.

        `is_worse`: the new one ends before its target, turns back near it, or leads below the flight band.
        """
        vehicle = new.vehicle
        triggers = self._triggers
        if flown.target != new.target or triggers.is_endangered(vehicle, inputs):
            return False
        if is_worse:
            return True
        if triggers.has_passed_target(vehicle, inputs):
            return False
        if math.dist(new.target_point_m, flown.target_point_m) < _SAME_PLACE_M:
            return True
        return self._is_near_enough(vehicle, flown, inputs)

    def _turns_back(self, new: Route, start: AgentState, inputs: PlanningInputs) -> bool:
        """Return True if a vehicle near its target, or near the end of its route, would make a full turn."""
        newest = self._agents[new.vehicle].routes.newest
        agent = inputs.agents[new.vehicle]
        if newest is None or new.vehicle in inputs.passed:
            return False
        to_target_m = _distance_m(agent.mean, inputs.targets[new.target].mean)
        if min(to_target_m, _distance_m(agent.mean, newest.target_point_m)) > _NEAR_END_M:
            return False
        options = self._mission.agents[new.vehicle].options or self._mission.options
        loop_m = _LOOP_RADII * options.turn_radius_m
        return total_turn_rad(start, new.points_m, _NEAR_END_M + loop_m) > _MAX_TURN_NEAR_END_RAD


def _distance_m(a: FloatArray, b: FloatArray | Point) -> float:
    return math.hypot(float(a[0]) - float(b[0]), float(a[1]) - float(b[1]))
