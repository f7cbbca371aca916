"""The planner: agents, targets and a map in, routes out.

The paper's simultaneous target assignment and trajectory optimisation: shortest ways on the grid for every
pair of agent and target, the Hungarian algorithm on their lengths, and the grid paths mapped to the map in
metres. Each step has its own module: `matrix`, `assignment`, `shaping`.

Nothing here raises for what the world may bring: an agent inside an obstacle, no way, nobody there. The
result says what is wrong in `PlanResult.notes`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from gcs import jit
from gcs.model import FloatArray, Label, Route, read_only, target_name, vehicle_name
from gcs.planning import deconfliction, intercept, vehicle_model
from gcs.planning.assignment import assign
from gcs.planning.map import clearance_nodes
from gcs.planning.map.grid import Grid, Point, free_grid
from gcs.planning.map.line_of_sight import clear_leg
from gcs.planning.options import AgentState, PlanOptions, TargetDemand
from gcs.planning.path.initial_turn import start_is_safe, start_room
from gcs.planning.path.shortcut import close_and_seen, is_roomy, joins, legs_are_clear, pull
from gcs.planning.path.string_pulling import tauten
from gcs.planning.path.turns import flyable
from gcs.planning.route_search import Search
from gcs.planning.search import canonical_ordering, cost_matrix
from gcs.planning.search.cost_matrix import Places
from gcs.planning.search.neighbours import SearchMap, cells, search_map
from gcs.planning.terminal import loiter
from gcs.planning.terminal.loiter import ending

Stage: TypeAlias = Literal["search", "assignment", "shaping"]


@dataclass(frozen=True, slots=True)
class PlanResult:
    """Who flies where.

    Attributes
    ----------
    routes : tuple of Route
        Ordered by vehicle. A route ends at the target's exact position, unless the target is over an
        obstacle.
    unassigned_vehicles, unassigned_targets : tuple
        In order; both hold all that is in no route.
    notes : tuple of str
        What an operator should know: who is inside an obstacle, cannot get anywhere, or has to fly too near.
    grid_lengths_m : mapping of int to float
        Length of each vehicle's way along the grid, before it was shaped.
    short : frozenset of int
        Vehicles that no clear way leads past their targets; their routes end before these.
    """

    routes: tuple[Route, ...]
    unassigned_vehicles: tuple[int, ...]
    unassigned_targets: tuple[Label, ...]
    notes: tuple[str, ...]
    grid_lengths_m: Mapping[int, float] = field(default_factory=dict)
    stops_short: frozenset[int] = frozenset()

    @property
    def total_length_m(self) -> float:
        """Length of all routes together."""
        return math.fsum(route.length_m for route in self.routes)


def _unwatched(_stage: Stage) -> None:
    """Nobody wants to know."""


def plan_routes(
    grid: Grid,
    agents: Mapping[int, AgentState],
    targets: Mapping[Label, Point],
    current: Mapping[int, Label],
    options: PlanOptions,
    done: Callable[[Stage], None] = _unwatched,
    demands: Mapping[Label, TargetDemand] = MappingProxyType({}),
) -> PlanResult:
    """Assign targets to agents and route each agent to its own; see `PlanOptions` and `PlanResult`.

    `current` is who flies to which target now; whoever and whatever is gone from it is ignored. `done` is
    told when a stage of the work ends, for whoever measures times. `demands` says what is special of targets.
    """
    notes: list[str] = []
    vehicles = [v for v in sorted(agents) if _on_earth(agents[v].east_m, agents[v].north_m)]
    labels = [label for label in sorted(targets) if _on_earth(*targets[label])]
    notes += [f"{_agent(v)}: its position is not on Earth" for v in sorted(set(agents) - set(vehicles))]
    notes += [
        f"{_target(label)}: its position is not on Earth" for label in sorted(set(targets) - set(labels))
    ]
    notes += ["no agents"] * (not agents) + ["no targets"] * (not targets)
    routes: list[Route] = []
    grid_lengths_m: dict[int, float] = {}
    stops_short: set[int] = set()
    if vehicles and labels:
        asked = [demands.get(label, TargetDemand()) for label in labels]
        search = Search(
            grid, [agents[v] for v in vehicles], [targets[label] for label in labels], asked, options
        )
        notes += _places_notes(grid, search.smap, vehicles, labels, search.starts, search.costs)
        done("search")
        pairs = _assigned(search.costs, vehicles, labels, asked, current, options)
        done("assignment")
        for i, j in pairs.items():
            vehicle, label = vehicles[i], labels[j]
            aimed = search.route(i, j)
            grid_lengths_m[vehicle] = aimed.grid_length_m
            notes += [f"{_agent(vehicle)}: {note.format(target_name(label))}" for note in aimed.notes]
            route = Route(vehicle, label, aimed.points_m, aimed.length_m)
            route, problem = _ended(grid, route, agents[vehicle], aimed.target_m, options)
            routes.append(route)
            if problem:
                notes.append(f"{_agent(vehicle)}: {problem.format(target_name(label))}")
                stops_short.add(vehicle)
        done("shaping")
    served = {route.target for route in routes}
    busy = {route.vehicle for route in routes}
    return PlanResult(
        tuple(routes),
        tuple(v for v in sorted(agents) if v not in busy),
        tuple(label for label in sorted(targets) if label not in served),
        tuple(notes),
        grid_lengths_m,
        frozenset(stops_short),
    )


def _assigned(
    costs: FloatArray,
    vehicles: Sequence[int],
    labels: Sequence[Label],
    asked: Sequence[TargetDemand],
    current: Mapping[int, Label],
    options: PlanOptions,
) -> dict[int, int]:
    """Target of each agent that gets one, by number. A target has a column for each agent that it needs."""
    columns, ranks = _columns(len(vehicles), asked, options)
    free: dict[Label, list[int]] = {}
    for column, j in reversed(list(enumerate(columns))):
        free.setdefault(labels[j], []).append(column)
    flown = {}
    for i, vehicle in enumerate(vehicles):
        left = free.get(current[vehicle]) if vehicle in current else None
        if left:
            flown[i] = left.pop()
    pairs = assign(costs[:, columns], flown, options.switch_gain_m, ranks, options.objective)
    return {i: columns[column] for i, column in pairs.items()}


def _columns(agents: int, asked: Sequence[TargetDemand], options: PlanOptions) -> tuple[list[int], list[int]]:
    """Return the target of each column and its rank; columns for spare agents come after all others."""
    columns = [j for j, demand in enumerate(asked) for _ in range(demand.agents)]
    ranks = [asked[j].rank for j in columns]
    if options.surplus == "double":
        beyond, rounds = max(ranks, default=0), math.ceil(max(0, agents - len(columns)) / len(asked))
        for more in range(1, rounds + 1):
            columns += range(len(asked))
            ranks += [beyond + more] * len(asked)
    return columns, ranks


def _ended(
    grid: Grid, route: Route, start: AgentState, target_m: Point, options: PlanOptions
) -> tuple[Route, str]:
    """Return a route with an end that its vehicle can fly; and what an operator should know of it."""
    if options.loiter is None or options.shape != "flyable":
        return route, ""
    end = ending(grid, start, route.points_m, target_m, options, options.loiter)
    problem = ""
    if end.room_m < 0.0:
        problem = "no clear way to pass target {} or to wait near it: it would fly into an obstacle there"
    elif not end.passes:
        problem = "no clear way to pass target {}; it waits near it"
    if end.points_m is route.points_m:
        return replace(route, wait_m=end.wait_m), problem
    way_m = np.vstack(((start.east_m, start.north_m), end.points_m))
    length_m = float(np.hypot(*np.diff(way_m, axis=0).T).sum())
    route = replace(route, points_m=read_only(end.points_m), length_m=length_m, wait_m=end.wait_m)
    return route, problem


def _agent(vehicle: int) -> str:
    return f"agent {vehicle_name(vehicle)}"


def _target(label: Label) -> str:
    return f"target {target_name(label)}"


def _on_earth(east_m: float, north_m: float) -> bool:
    """Whether an estimate is a place at all: neither NaN nor farther off than the Earth is round."""
    return abs(east_m) + abs(north_m) < 5e7


def _places_notes(
    grid: Grid,
    smap: SearchMap,
    vehicles: Sequence[int],
    labels: Sequence[Label],
    starts: Places,
    lengths_m: FloatArray,
) -> list[str]:
    """Say who is inside an obstacle and who cannot get anywhere."""
    if grid.blocked.all():
        return ["the map has no free cell"]
    notes = []
    for i in np.flatnonzero(starts.inside).tolist():
        east, north = cells(smap, starts.nodes[i, :1])[0] * grid.spacing_m + np.array(grid.origin_m)
        notes.append(f"{_agent(vehicles[i])}: inside an obstacle; leaves it by ({east:.0f}, {north:.0f}) m")
    reached = np.isfinite(lengths_m)
    notes += [
        f"{_agent(vehicles[i])}: no path to any target" for i in np.flatnonzero(~reached.any(axis=1)).tolist()
    ]
    notes += [
        f"{_target(labels[j])}: no path from any agent" for j in np.flatnonzero(~reached.any(axis=0)).tolist()
    ]
    return notes


def warm_up_calls() -> list[jit.Call]:
    """One call of every kernel, types as in a plan; the longest to compile stand at the ends."""
    grid = free_grid((2, 2), 10.0)
    blocked, smap, xy = grid.blocked, search_map(grid), np.zeros((1, 2))
    way = np.array([[0.0, 0.0], [1.0, 1.0]])
    return [
        (clear_leg, blocked, 0.0, 0.0, 1.0, 1.0, 0.0, -1),
        (tauten, blocked, 0.0, way, np.zeros(2), 0.0, 0.0, -1),
        (pull, blocked, 0.0, way, np.zeros(2), -1, False, False),
        (joins, blocked, smap.mainland, smap.tight, smap.stride, xy),
        (close_and_seen, blocked, 0.0, xy[0], xy[0]),
        (is_roomy, blocked, 0.0, way, -1, False),
        (legs_are_clear, blocked, way, -1),
        *canonical_ordering.warm_up_calls(),
        *clearance_nodes.warm_up_calls(),
        *cost_matrix.warm_up_calls(),
        *intercept.warm_up_calls(),
        *vehicle_model.warm_up_calls(),
        *loiter.warm_up_calls(),
        *deconfliction.warm_up_calls(),
        (flyable, blocked, 0.0, way, np.zeros(2), 1.0, -1),
        (start_is_safe, blocked, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, -1),
        (start_room, blocked, 0.0, 0.0, 0.0),
    ]


def warm_up() -> None:
    """Compile every kernel, or load it from the cache: seconds, once; without it the first plan pays."""
    jit.warm_up(__name__)
