"""Plan of a mission: routes to assigned targets, in altitude layers, or at heights that separate them.

`plan_mission` is what the engine, `gcs plan` and the preflight check call. `team_routes.plan_routes` is its
first part: the routes of one plan, whatever is flown already. Then new routes get altitude layers
(`layer_assignment`); over terrain they are planned at the heights of a layer.

Source: Hill, Thomas & Larson, simultaneous target assignment and trajectory optimisation. Shortest grid
paths of all agent-target pairs form the cost matrix (`search.cost_matrix`). The Hungarian algorithm
assigns agents to targets (`assignment`). Each assigned path becomes a route (`route_search`, `path`), with a
terminal loiter (`manoeuvres.loiter`).

Bad input raises nothing: an agent inside an obstacle, an unreachable target and an empty team are reported in
`PlanResult.notes`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter

import numpy as np

from gcs.model import Route
from gcs.planning.layer_assignment import Conflict, PlannedFlight, assign_layers
from gcs.planning.pair_route import shape_over_terrain
from gcs.planning.plan_result import Choice, PlanResult, choose_new
from gcs.planning.planner_inputs import MissionInputs
from gcs.planning.team_routes import Stage, ignore_stage, plan_routes
from gcs.planning.terrain.terrain_search import TerrainSearch


def plan_mission(
    inputs: MissionInputs,
    choose: Callable[[PlanResult], Choice] = choose_new,
    on_stage: Callable[[Stage], None] = ignore_stage,
) -> PlanResult:
    """Assign targets to agents, plan their routes, and give them altitude layers.

    Parameters
    ----------
    choose : callable
        Returns which of the new routes are flown, and which flights go on.
    on_stage : callable
        As for `plan_routes`.
    """
    result = plan_routes(
        inputs.grid,
        inputs.agents,
        inputs.targets,
        inputs.flown_to,
        inputs.options,
        on_stage,
        inputs.demands,
        inputs.terrain,
    )
    choice = choose(result)
    if inputs.terrain is None:
        flights = [_flight(route, inputs) for route in choice.new]
        layers, conflicts = assign_layers([*flights, *choice.flights], inputs.layers, inputs.separation_m)
        new = [replace(route, layer=layers[route.vehicle]) for route in choice.new]
    else:
        new, flights, conflicts = _apart_over_terrain(choice, inputs)
    routes = sorted([*choice.kept, *new], key=attrgetter("vehicle"))
    busy = {route.vehicle for route in routes}
    served = {route.target for route in routes}
    return replace(
        result,
        routes=tuple(routes),
        unassigned_vehicles=tuple(v for v in result.unassigned_vehicles if v not in busy),
        unassigned_targets=tuple(label for label in result.unassigned_targets if label not in served),
        paths_m={flight.vehicle: flight.points_m for flight in flights},
        conflicts=conflicts,
    )


def _apart_over_terrain(
    choice: Choice, inputs: MissionInputs
) -> tuple[list[Route], list[PlannedFlight], tuple[Conflict, ...]]:
    """Return new routes at heights that separate them, their flights, and the pairs that come near.

    Each route in turn gets the first layer, from the preferred one on, in which it is separated from others,
    or else the one in which it meets one last.
    """
    new: list[Route] = []
    flights: list[PlannedFlight] = []
    found: list[Conflict] = []
    for route in choice.new:
        others = [*choice.flights, *flights]
        tries: list[tuple[float, Route, PlannedFlight, list[Conflict]]] = []
        for turn in range(inputs.layers):
            layer = (inputs.preferred_layers[route.vehicle] + turn) % inputs.layers
            planned = _in_layer(route, layer, inputs)
            flight = replace(_flight(planned, inputs), layer=layer, keeps_layer=True)
            _, all_near = assign_layers(
                [*others, flight], inputs.layers, inputs.separation_m, inputs.min_height_m
            )
            near = [one for one in all_near if route.vehicle in one.vehicles]
            first_s = min((one.after_s for one in near), default=math.inf)
            tries.append((first_s, planned, flight, near))
            if not near:
                break
        _, planned, flight, near = max(tries, key=lambda one: one[0])
        new.append(planned)
        flights.append(flight)
        found += near
    return new, flights, tuple(found)


def _in_layer(route: Route, layer: int, inputs: MissionInputs) -> Route:
    """Return a route over terrain at the heights that a layer prefers."""
    assert inputs.terrain is not None
    if layer == 0:
        return replace(route, layer=layer)  # planned so
    agent = inputs.agents[route.vehicle]
    target_m = inputs.grid.nearest_inside(inputs.targets[route.target])
    search = TerrainSearch(inputs.terrain, inputs.grid, [agent], [target_m], inputs.options)
    planned = shape_over_terrain(search, (0, 0), route.vehicle, route.target, layer).route
    return replace(route if planned is None else planned, layer=layer)


def _flight(route: Route, inputs: MissionInputs) -> PlannedFlight:
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
