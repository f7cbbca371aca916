"""Motion planning for a team of fixed-wing vehicles: grid search, assignment, flyable routes.

`plan_swarm` plans a team on an occupancy grid, arrays in and out (`docs/library.md`).
`plan_mission` takes `MissionInputs` and returns a `PlanResult`: routes in altitude layers, for the engine,
`gcs plan` and the preflight check. Its first part, `plan_routes`, takes a `Grid`, the `AgentState` of each
vehicle and the targets.
The package is pure: no I/O, no clock, no random numbers.

Reading order:

1. `planner_inputs`: inputs of the planner. `planner`: a whole plan, with altitude layers. `team_routes`: its
   first part, assignment and routes. `plan_result`: what comes out. `swarm_plan`: the same in arrays.
2. `map`: obstacle grid, polygons, exact line of sight, clearance-shifted nodes.
3. `search`: eight-neighbour moves, canonical ordering (jump-point pruning), A*, one-to-all Dijkstra, and the
   cost matrix of all agent-target pairs.
4. `assignment` (Hungarian, with hysteresis) and `intercept` (moving targets).
5. `path`: from grid path to flyable route. Shortcuts, string pulling over tangent points, corner
   smoothing and splitting, turns, initial turn, Dubins paths.
6. `route_search`: paths of one agent to one target, all of the above. `pair_route`: its route with loiter.
7. `wind_triangle`, `forward_simulation`: future flight of a vehicle. `flight_variants`, `routes_in_wind`:
   its flights in wind, and routes that keep their clearance in them. `route_joining`, `route_progress`:
   joining and following a route.
8. `manoeuvres`: climb after take-off, terminal loiter, return route and landing.
9. `layer_assignment`: altitude layers.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gcs.planning.map.grid import Grid
    from gcs.planning.plan_notes import PlanNote
    from gcs.planning.plan_result import PlanResult
    from gcs.planning.planner import plan_mission
    from gcs.planning.planner_inputs import AgentState, LoiterSpec, MissionInputs, PlanOptions, TargetDemand
    from gcs.planning.swarm_plan import SwarmPlan, plan_swarm
    from gcs.planning.team_routes import plan_routes

__all__ = [
    "AgentState",
    "Grid",
    "LoiterSpec",
    "MissionInputs",
    "PlanNote",
    "PlanOptions",
    "PlanResult",
    "SwarmPlan",
    "TargetDemand",
    "plan_mission",
    "plan_routes",
    "plan_swarm",
]

_MODULES = {
    "AgentState": "planner_inputs",
    "Grid": "map.grid",
    "LoiterSpec": "planner_inputs",
    "MissionInputs": "planner_inputs",
    "PlanNote": "plan_notes",
    "PlanOptions": "planner_inputs",
    "PlanResult": "plan_result",
    "SwarmPlan": "swarm_plan",
    "TargetDemand": "planner_inputs",
    "plan_mission": "planner",
    "plan_routes": "team_routes",
    "plan_swarm": "swarm_plan",
}


def __getattr__(name: str) -> Any:
    """Import a public name at first use, so that short commands load no compiler (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
