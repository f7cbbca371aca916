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
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from gcs import compiling
from gcs.model import FloatArray, Label, Route, read_only
from gcs.planning import matrix
from gcs.planning.assignment import assign
from gcs.planning.grid import Grid, Point, free_grid
from gcs.planning.matrix import Places, cells, metric_ways, paper_ways
from gcs.planning.moves import IntArray, SearchMap, search_map
from gcs.planning.search import SearchCost
from gcs.planning.shaping import Shape, Shaped, close_and_seen, is_roomy, joins, pull, shape_way
from gcs.planning.sight import clear_leg
from gcs.planning.starts import start_is_clear, start_room
from gcs.planning.taut import tauten
from gcs.planning.turning import SHARP_CORNER, SHARP_START, flyable

Stage: TypeAlias = Literal["search", "assignment", "shaping"]


@dataclass(frozen=True, slots=True)
class AgentStart:
    """Where an agent's route begins, and its course over ground if that is known."""

    east_m: float
    north_m: float
    course_rad: float | None = None


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """How to plan.

    Attributes
    ----------
    search_cost : "metric" or "paper"
        Shortest paths, or the paper's cost of nodes traversed plus Euclidean heuristic.
    shape : "grid", "pulled" or "flyable"
        Legs along the grid, or pulled taut by line of sight, or with turns that can be flown besides.
    turn_radius_m : float
        Least radius of the turns of a flyable route.
    clearance_m : float
        Distance to keep from blocked cells, unless there is no way that does or only a long detour.
    switch_gain_m : float
        By how much agents that exchange targets must shorten the team's way.
    """

    search_cost: SearchCost = "metric"
    shape: Shape = "grid"
    clearance_m: float = 0.0
    switch_gain_m: float = 0.0
    turn_radius_m: float = 40.0


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
    """

    routes: tuple[Route, ...]
    unassigned_vehicles: tuple[int, ...]
    unassigned_targets: tuple[Label, ...]
    notes: tuple[str, ...]
    grid_lengths_m: Mapping[int, float] = field(default_factory=dict)

    @property
    def total_length_m(self) -> float:
        """Length of all routes together."""
        return math.fsum(route.length_m for route in self.routes)


def _unwatched(_stage: Stage) -> None:
    """Nobody wants to know."""


def plan_routes(
    grid: Grid,
    agents: Mapping[int, AgentStart],
    targets: Mapping[Label, Point],
    current: Mapping[int, Label],
    options: PlanOptions,
    done: Callable[[Stage], None] = _unwatched,
) -> PlanResult:
    """Assign targets to agents and route each agent to its own; see `PlanOptions` and `PlanResult`.

    `current` is who flies to which target now; whoever and whatever is gone from it is ignored. `done` is
    told when a stage of the work ends, for whoever measures times.
    """
    notes: list[str] = []
    vehicles = [v for v in sorted(agents) if _on_earth(agents[v].east_m, agents[v].north_m)]
    labels = [label for label in sorted(targets) if _on_earth(*targets[label])]
    notes += [f"agent {v}: its position is not on Earth" for v in sorted(set(agents) - set(vehicles))]
    notes += [f"target {label}: its position is not on Earth" for label in sorted(set(targets) - set(labels))]
    notes += ["no agents"] * (not agents) + ["no targets"] * (not targets)
    routes: list[Route] = []
    grid_lengths_m: dict[int, float] = {}
    if vehicles and labels:
        smap = search_map(grid, options.clearance_m)
        starts = _places(grid, smap, [(agents[v].east_m, agents[v].north_m) for v in vehicles])
        goals = _places(grid, smap, [targets[label] for label in labels])
        find_ways = paper_ways if options.search_cost == "paper" else metric_ways
        lengths_m, way = find_ways(grid, smap, starts, goals, options.clearance_m)
        notes += _places_notes(grid, smap, vehicles, labels, starts, lengths_m)
        done("search")
        column = {label: j for j, label in enumerate(labels)}
        flown = {i: column[current[v]] for i, v in enumerate(vehicles) if current.get(v) in column}
        pairs = assign(lengths_m, flown, options.switch_gain_m)
        done("assignment")
        for i, j in pairs.items():
            vehicle, label = vehicles[i], labels[j]
            grid_lengths_m[vehicle] = float(lengths_m[i, j])
            shaped = _shaped(grid, smap, agents[vehicle], starts, goals, i, j, way(i, j), options)
            points = shaped.points * grid.spacing_m + np.array(grid.origin_m)
            if not goals.inside[j]:
                points[-1] = targets[label]
            else:
                east, north = points[-1]
                notes.append(
                    f"agent {vehicle}: target {label} is over an obstacle; "
                    f"the route ends at ({east:.0f}, {north:.0f}) m"
                )
            if not shaped.is_roomy:
                notes.append(
                    f"agent {vehicle}: the route to target {label} comes nearer than "
                    f"{options.clearance_m:g} m to obstacles: no way but a long detour, or none, keeps away"
                )
            notes += _turn_notes(vehicle, shaped.problem)
            routes.append(Route(vehicle, label, read_only(points[1:]), shaped.length * grid.spacing_m))
        done("shaping")
    served = {route.target for route in routes}
    busy = {route.vehicle for route in routes}
    return PlanResult(
        tuple(routes),
        tuple(v for v in sorted(agents) if v not in busy),
        tuple(label for label in sorted(targets) if label not in served),
        tuple(notes),
        grid_lengths_m,
    )


def _on_earth(east_m: float, north_m: float) -> bool:
    """Whether an estimate is a place at all: neither NaN nor farther off than the Earth is round."""
    return abs(east_m) + abs(north_m) < 5e7


def _places(grid: Grid, smap: SearchMap, points_m: Sequence[Point]) -> Places:
    """Find how places join the map."""
    xy = (np.array(points_m, dtype=np.float64) - grid.origin_m) / grid.spacing_m
    return Places(xy, *joins(grid.blocked, smap.mainland, smap.tight, smap.stride, xy))


def _shaped(
    grid: Grid,
    smap: SearchMap,
    agent: AgentStart,
    starts: Places,
    goals: Places,
    i: int,
    j: int,
    nodes: IntArray,
    options: PlanOptions,
) -> Shaped:
    """Return a route as it is flown, in cells."""
    ends_at_target = not goals.inside[j]
    parts = [starts.xy[i : i + 1], cells(smap, nodes)] + [goals.xy[j : j + 1]] * ends_at_target
    course = agent.course_rad if agent.course_rad is not None and math.isfinite(agent.course_rad) else None
    heading = np.zeros(2) if course is None else np.array([math.sin(course), math.cos(course)])
    return shape_way(
        grid.blocked,
        options.clearance_m / grid.spacing_m,
        np.concatenate(parts),
        heading,
        bool(starts.inside[i]),
        bool(ends_at_target),
        options.shape,
        options.turn_radius_m / grid.spacing_m,
    )


def _turn_notes(vehicle: int, problem: int) -> list[str]:
    """Say what of a route its vehicle will not fly as planned."""
    notes = []
    if problem & SHARP_START:
        notes.append(f"agent {vehicle}: no clear turn on to its route; it turns as tightly as it can")
    if problem & SHARP_CORNER:
        notes.append(f"agent {vehicle}: its route has corners that it cannot fly without coming too near")
    return notes


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
        notes.append(f"agent {vehicles[i]}: inside an obstacle; leaves it by ({east:.0f}, {north:.0f}) m")
    reached = np.isfinite(lengths_m)
    notes += [
        f"agent {vehicles[i]}: no path to any target" for i in np.flatnonzero(~reached.any(axis=1)).tolist()
    ]
    notes += [
        f"target {labels[j]}: no path from any agent" for j in np.flatnonzero(~reached.any(axis=0)).tolist()
    ]
    return notes


def warm_up_calls() -> list[compiling.Call]:
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
        *matrix.warm_up_calls(),
        (flyable, blocked, 0.0, way, np.zeros(2), 1.0, -1),
        (start_is_clear, blocked, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, -1),
        (start_room, blocked, 0.0, 0.0, 0.0),
    ]


def warm_up() -> None:
    """Compile every kernel, or load it from the cache: seconds, once; without it the first plan pays."""
    compiling.warm_up(__name__)
