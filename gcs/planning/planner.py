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

from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter

from gcs.planning.layer_assignment import assign_layers
from gcs.planning.plan_result import Choice, PlanResult, choose_new
from gcs.planning.planner_inputs import MissionInputs
from gcs.planning.routes_over_terrain import new_flight, separate_over_terrain
from gcs.planning.team_routes import Stage, ignore_stage, plan_routes


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
        flights = [new_flight(route, inputs) for route in choice.new]
        layers, conflicts = assign_layers([*flights, *choice.flights], inputs.layers, inputs.separation_m)
        new = [replace(route, layer=layers[route.vehicle]) for route in choice.new]
    else:
        new, flights, conflicts = separate_over_terrain(choice, inputs)
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
