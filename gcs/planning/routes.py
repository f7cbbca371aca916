"""The planner: agents, targets and a map in, routes out.

The paper's simultaneous target assignment and trajectory optimisation: shortest ways on the grid for every
pair of agent and target, the Hungarian algorithm on their lengths, and the grid paths mapped to the map in
metres. Each step has its own module: `search`, `assignment`, `shaping`.

With the metric cost one search serves a whole row (or column, if there are fewer targets than agents) of the
cost matrix. The paper's cost has no such shortcut: its result depends on the goal, so it is searched pair by
pair.

Nothing here raises for what the world may bring: an agent inside an obstacle, no way, nobody there. The
result says what is wrong in `PlanResult.notes`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from gcs import compiling
from gcs.model import FloatArray, Label, Route, read_only
from gcs.planning.assignment import assign
from gcs.planning.grid import BoolArray, Grid, Point, free_grid
from gcs.planning.search import (
    IntArray,
    SearchCost,
    SearchMap,
    astar,
    fields,
    flat_index,
    search_map,
    trace_back,
)
from gcs.planning.shaping import DIRECT, close_and_seen, ends_of_ways, joins, shape
from gcs.planning.sight import clear_leg

Shape: TypeAlias = Literal["grid", "pulled"]


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
    shape : "grid" or "pulled"
        Legs along the grid, or pulled taut by line of sight.
    clearance_m : float
        Distance to keep from blocked cells, unless there is no way that does or only a long detour.
    switch_gain_m : float
        By how much agents that exchange targets must shorten the team's way.
    """

    search_cost: SearchCost = "metric"
    shape: Shape = "grid"
    clearance_m: float = 0.0
    switch_gain_m: float = 0.0


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
    """

    routes: tuple[Route, ...]
    unassigned_vehicles: tuple[int, ...]
    unassigned_targets: tuple[Label, ...]
    notes: tuple[str, ...]

    @property
    def total_length_m(self) -> float:
        """Length of all routes together."""
        return math.fsum(route.length_m for route in self.routes)


@dataclass(frozen=True, eq=False)
class _Places:
    """Where some agents or targets are, in cells, and how they join the map (see `shaping.joins`)."""

    xy: FloatArray
    nodes: IntArray
    off: FloatArray
    inside: BoolArray


Way: TypeAlias = Callable[[int, int], IntArray]
"""Flat nodes of the way of agent i to target j, in the order of flight; empty if they see each other
closely."""


def plan_routes(
    grid: Grid,
    agents: Mapping[int, AgentStart],
    targets: Mapping[Label, Point],
    current: Mapping[int, Label],
    options: PlanOptions,
) -> PlanResult:
    """Assign targets to agents and route each agent to its own; see `PlanOptions` and `PlanResult`.

    `current` is who flies to which target now; whoever and whatever is gone from it is ignored.
    """
    notes: list[str] = []
    vehicles = [v for v in sorted(agents) if _on_earth(agents[v].east_m, agents[v].north_m)]
    labels = [label for label in sorted(targets) if _on_earth(*targets[label])]
    notes += [f"agent {v}: its position is not on Earth" for v in sorted(set(agents) - set(vehicles))]
    notes += [f"target {label}: its position is not on Earth" for label in sorted(set(targets) - set(labels))]
    notes += ["no agents"] * (not agents) + ["no targets"] * (not targets)
    routes: list[Route] = []
    if vehicles and labels:
        smap = search_map(grid, options.clearance_m)
        starts = _places(grid, smap, [(agents[v].east_m, agents[v].north_m) for v in vehicles])
        goals = _places(grid, smap, [targets[label] for label in labels])
        find_ways = _paper_ways if options.search_cost == "paper" else _metric_ways
        lengths_m, way = find_ways(grid, smap, starts, goals, options.clearance_m / grid.spacing_m)
        notes += _places_notes(grid, smap, vehicles, labels, starts, lengths_m)
        column = {label: j for j, label in enumerate(labels)}
        flown = {i: column[current[v]] for i, v in enumerate(vehicles) if current.get(v) in column}
        for i, j in assign(lengths_m, flown, options.switch_gain_m).items():
            vehicle, label = vehicles[i], labels[j]
            points, roomy = _shaped(grid, smap, agents[vehicle], starts, goals, i, j, way(i, j), options)
            if not goals.inside[j]:
                points[-1] = targets[label]
            else:
                east, north = points[-1]
                notes.append(
                    f"agent {vehicle}: target {label} is over an obstacle; "
                    f"the route ends at ({east:.0f}, {north:.0f}) m"
                )
            if not roomy:
                notes.append(
                    f"agent {vehicle}: the route to target {label} comes nearer than "
                    f"{options.clearance_m:g} m to obstacles: no way but a long detour, or none, keeps away"
                )
            length_m = float(np.hypot(*np.diff(points, axis=0).T).sum())
            routes.append(Route(vehicle, label, read_only(points[1:]), length_m))
    served = {route.target for route in routes}
    busy = {route.vehicle for route in routes}
    return PlanResult(
        tuple(routes),
        tuple(v for v in sorted(agents) if v not in busy),
        tuple(label for label in sorted(targets) if label not in served),
        tuple(notes),
    )


def _on_earth(east_m: float, north_m: float) -> bool:
    """Whether an estimate is a place at all: neither NaN nor farther off than the Earth is round."""
    return abs(east_m) + abs(north_m) < 5e7


def _places(grid: Grid, smap: SearchMap, points_m: Sequence[Point]) -> _Places:
    """Find how places join the map."""
    xy = (np.array(points_m, dtype=np.float64) - grid.origin_m) / grid.spacing_m
    return _Places(xy, *joins(grid.blocked, smap.mainland, smap.tight, smap.stride, xy))


def _metric_ways(
    grid: Grid, smap: SearchMap, starts: _Places, goals: _Places, reach: float
) -> tuple[FloatArray, Way]:
    """Shortest ways of all pairs: their lengths in metres, (n, m), inf where there is none, and the ways."""
    turned = len(goals.xy) < len(starts.xy)
    near, far = (goals, starts) if turned else (starts, goals)
    field = fields(smap.moves, smap.tight, smap.offsets, smap.any_tight, near.nodes, near.off)
    lengths, via = ends_of_ways(
        grid.blocked, reach, field, near.xy, near.inside, far.xy, far.nodes, far.off, far.inside
    )
    path = np.empty(smap.moves.size, dtype=np.int64)

    def trace(i: int, j: int) -> tuple[int, float]:
        count, flown = trace_back(
            smap.moves, smap.tight, smap.offsets, field[i], near.nodes[i], near.off[i], via[i, j], path
        )
        return int(count), float(flown)

    if smap.any_tight:
        # Tight moves counted many times over while searching; the assignment compares what is flown.
        for i, j in np.argwhere(via >= 0):
            last = float(far.off[j][far.nodes[j] == via[i, j]][0])
            lengths[i, j] = trace(i, j)[1] + last

    def way(i: int, j: int) -> IntArray:
        i, j = (j, i) if turned else (i, j)
        count = 0 if via[i, j] == DIRECT else trace(i, j)[0]
        return path[:count].copy() if turned else path[:count][::-1].copy()

    return (lengths.T if turned else lengths) * grid.spacing_m, way


def _paper_ways(
    grid: Grid, smap: SearchMap, starts: _Places, goals: _Places, reach: float
) -> tuple[FloatArray, Way]:
    """Ways of all pairs by the paper's cost, from nearest node to nearest node; lengths are what is flown."""
    lengths_m = np.full((len(starts.xy), len(goals.xy)), np.inf)
    ways: dict[tuple[int, int], IntArray] = {}
    path = np.empty(smap.moves.size, dtype=np.int64)
    for i, (a, first) in enumerate(zip(starts.xy, _nearest_joins(starts), strict=True)):
        for j, (b, last) in enumerate(zip(goals.xy, _nearest_joins(goals), strict=True)):
            if first < 0 or last < 0:
                continue
            count = 0
            if starts.inside[i] or goals.inside[j] or not close_and_seen(grid.blocked, reach, a, b):
                count, _ = astar(smap.moves, smap.tight, smap.offsets, smap.stride, first, last, True, path)
                if count == 0:
                    continue
            ways[i, j] = path[:count][::-1].copy()
            points = np.vstack((a, _cells(smap, ways[i, j]), b))
            lengths_m[i, j] = np.hypot(*np.diff(points, axis=0).T).sum() * grid.spacing_m
    return lengths_m, lambda i, j: ways[i, j]


def _nearest_joins(places: _Places) -> list[int]:
    """Return the nearest node by which each place joins the map, -1 for none."""
    best = np.argmin(np.where(places.nodes >= 0, places.off, np.inf), axis=1)
    return [int(node) for node in places.nodes[np.arange(len(best)), best]]


def _cells(smap: SearchMap, flat: IntArray) -> FloatArray:
    """Return flat nodes as (k, 2) places in cells."""
    rows, cols = np.divmod(flat, smap.stride)
    return np.column_stack((cols - 1, rows - 1)).astype(np.float64)


def _shaped(
    grid: Grid,
    smap: SearchMap,
    agent: AgentStart,
    starts: _Places,
    goals: _Places,
    i: int,
    j: int,
    nodes: IntArray,
    options: PlanOptions,
) -> tuple[FloatArray, bool]:
    """Return a route's points in metres, the agent's place first, and whether it keeps the clearance."""
    ends_at_target = not goals.inside[j]
    parts = [starts.xy[i : i + 1], _cells(smap, nodes)] + [goals.xy[j : j + 1]] * ends_at_target
    course = agent.course_rad if agent.course_rad is not None and math.isfinite(agent.course_rad) else None
    heading = np.zeros(2) if course is None else np.array([math.sin(course), math.cos(course)])
    reach = options.clearance_m / grid.spacing_m
    points, roomy = shape(
        grid.blocked,
        reach,
        np.concatenate(parts),
        heading,
        bool(starts.inside[i]),
        bool(ends_at_target),
        options.shape == "pulled",
    )
    metres: FloatArray = points * grid.spacing_m + np.array(grid.origin_m)
    return metres, bool(roomy)


def _places_notes(
    grid: Grid,
    smap: SearchMap,
    vehicles: Sequence[int],
    labels: Sequence[Label],
    starts: _Places,
    lengths_m: FloatArray,
) -> list[str]:
    """Say who is inside an obstacle and who cannot get anywhere."""
    if grid.blocked.all():
        return ["the map has no free cell"]
    notes = []
    for i in np.flatnonzero(starts.inside).tolist():
        east, north = _cells(smap, starts.nodes[i, :1])[0] * grid.spacing_m + np.array(grid.origin_m)
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
    blocked, smap = grid.blocked, search_map(grid)
    moves, path = (smap.moves, smap.tight, smap.offsets), np.empty(smap.moves.size, np.int64)
    xy, inside, field = np.zeros((1, 2)), np.zeros(1, np.bool_), np.zeros((1, smap.moves.size))
    node = flat_index(smap, (0, 0))
    nodes, off = np.full((1, 4), node), np.zeros((1, 4))
    return [
        (clear_leg, blocked, 0.0, 0.0, 1.0, 1.0, 0.0, -1),
        (shape, blocked, 0.0, xy, np.zeros(2), False, False, False),
        (joins, blocked, smap.mainland, smap.tight, smap.stride, xy),
        (ends_of_ways, blocked, 0.0, field, xy, inside, xy, nodes, off, inside),
        (close_and_seen, blocked, 0.0, xy[0], xy[0]),
        (trace_back, *moves, field[0], nodes[0], off[0], nodes[0, 0], path),
        (fields, *moves, smap.any_tight, nodes, off),
        (astar, *moves, smap.stride, node, node, True, path),
    ]


def warm_up() -> None:
    """Compile every kernel, or load it from the cache: seconds, once; without it the first plan pays."""
    compiling.warm_up(__name__)
