"""Plan the mission of a team: search, assignment, shaping, altitude layers.

`plan_mission` is what the engine, `gcs plan` and the preflight check call. `plan_routes` is its first part:
the routes of one plan, whatever is flown already.

Source: Hill, Thomas & Larson, simultaneous target assignment and trajectory optimisation. Shortest grid
paths of all agent-target pairs form the cost matrix (`search.cost_matrix`). The Hungarian algorithm
assigns agents to targets (`assignment`). Each assigned path becomes a route (`route_search`, `path`), with a
terminal loiter (`manoeuvres.loiter`).

Bad input raises nothing: an agent inside an obstacle, an unreachable target and an empty team are reported in
`PlanResult.notes`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from gcs import jit
from gcs.model import FloatArray, Label, NoticeCode, Parameter, Route, read_only, target_name
from gcs.planning import forward_simulation, intercept, layer_assignment
from gcs.planning.assignment import assign_agents, fit_costs, pinned_costs, with_change_costs
from gcs.planning.layer_assignment import Conflict, PlannedFlight, assign_layers
from gcs.planning.manoeuvres import loiter
from gcs.planning.manoeuvres.loiter import plan_terminal_loiter
from gcs.planning.map import clearance_nodes
from gcs.planning.map.grid import Grid, Point, free_grid
from gcs.planning.map.line_of_sight import clear_leg, clearances_along
from gcs.planning.path.initial_turn import is_turn_safe, start_clearance
from gcs.planning.path.path_shaping import (
    connect_to_grid,
    is_adjacent_and_visible,
    keeps_clearance,
    legs_are_clear,
    shorten,
)
from gcs.planning.path.string_pulling import pull_string
from gcs.planning.path.turns import make_flyable
from gcs.planning.plan_notes import PlanNote
from gcs.planning.planner_inputs import AgentState, MissionInputs, PlanOptions, TargetDemand
from gcs.planning.route_joining import capture_length_m, has_explicit_turn, turn_around_s
from gcs.planning.route_search import RouteSearch
from gcs.planning.routes_in_wind import (
    WIND_SHARES,
    clearance_in_wind_m,
    detour_worth_m,
    keeps_enough,
    needed_clearance_m,
    widened,
)
from gcs.planning.search import canonical_ordering, cost_matrix
from gcs.planning.search.cost_matrix import Endpoints
from gcs.planning.search.neighbours import SearchMap, cells, search_map
from gcs.planning.terrain.ground import Terrain
from gcs.planning.terrain.terrain_search import TerrainSearch

_OF_WIDER = (NoticeCode.ROUTE_NEAR_OBSTACLES, NoticeCode.SHARP_CORNERS)
"""Notes on a route that compare it with the clearance and the turns asked for."""
_MAX_ASSIGNMENTS = 4
"""Assignments of one plan. A pair whose route has no clear end is excluded from the next one."""
Stage: TypeAlias = Literal["search", "assignment", "shaping"]


@dataclass(frozen=True, slots=True)
class PlanResult:
    """Routes of a plan, and what is left out.

    Attributes
    ----------
    routes : tuple of Route
        Ordered by vehicle. A route ends at the exact target position, unless that is over an obstacle, or
        outside the map. No waypoint lies outside the map.
    unassigned_vehicles, unassigned_targets : tuple
        In order; all that have no route.
    notes : tuple of PlanNote
        For the operator.
    grid_lengths_m : mapping of int to float
        Length of each vehicle's grid path, before shaping.
    stops_short : frozenset of int
        Vehicles whose routes end before the target, because no clear path passes it.
    endless : frozenset of int
        Vehicles that fly to their targets now, and get no route there: no loiter circle at its end is clear.
    settled : frozenset of int
        Vehicles that keep the routes they have to their targets: none were shaped.
    captured : mapping of int to Route
        Shorter routes without an explicit first turn: the simulated vehicle captures them clear of obstacles.
    paths_m : mapping of int to ndarray, shape (k, 2)
        East and north of each new route, from the position of its vehicle; of `plan_mission` only.
    conflicts : tuple of Conflict
        Vehicles that come near each other because no layer is left; of `plan_mission` only.
    """

    routes: tuple[Route, ...]
    unassigned_vehicles: tuple[int, ...]
    unassigned_targets: tuple[Label, ...]
    notes: tuple[PlanNote, ...]
    grid_lengths_m: Mapping[int, float] = field(default_factory=dict)
    stops_short: frozenset[int] = frozenset()
    captured: Mapping[int, Route] = field(default_factory=dict)
    endless: frozenset[int] = frozenset()
    settled: frozenset[int] = frozenset()
    paths_m: Mapping[int, FloatArray] = field(default_factory=dict)
    conflicts: tuple[Conflict, ...] = ()

    @property
    def total_length_m(self) -> float:
        """Total length of all routes."""
        return math.fsum(route.length_m for route in self.routes)


@dataclass(frozen=True, slots=True)
class Choice:
    """New routes of a plan, and those that are kept.

    Attributes
    ----------
    new, kept : sequence of Route
    flights : sequence of PlannedFlight
        Those on kept routes, and of vehicles without a route; new routes keep clear of them.
    """

    new: Sequence[Route]
    kept: Sequence[Route] = ()
    flights: Sequence[PlannedFlight] = ()


def choose_new(result: PlanResult) -> Choice:
    """Choose all new routes, without an explicit first turn where the vehicle needs none."""
    return Choice([result.captured.get(route.vehicle, route) for route in result.routes])


def _ignore_stage(_stage: Stage) -> None:
    """Ignore the end of a stage."""


def plan_mission(
    inputs: MissionInputs,
    choose: Callable[[PlanResult], Choice] = choose_new,
    on_stage: Callable[[Stage], None] = _ignore_stage,
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
        inputs.settled,
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
    or else the one in which it stays farthest from them.
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
            least_m = min((one.distance_m for one in near), default=math.inf)
            tries.append((least_m, planned, flight, near))
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
    planned = _shape_over_terrain(search, (0, 0), route.vehicle, route.target, layer).route
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
    )


def plan_routes(
    grid: Grid,
    agents: Mapping[int, AgentState],
    targets: Mapping[Label, Point],
    current: Mapping[int, Label],
    options: PlanOptions,
    on_stage: Callable[[Stage], None] = _ignore_stage,
    demands: Mapping[Label, TargetDemand] = MappingProxyType({}),
    terrain: Terrain | None = None,
    settled: Mapping[int, Label] = MappingProxyType({}),
) -> PlanResult:
    """Assign targets to agents and plan a route for each assigned agent.

    Parameters
    ----------
    current : mapping of int to label
        Assignment that is being flown. Vehicles and targets that are gone are ignored.
    on_stage : callable
        Called with the name of each stage when it ends, for time measurements.
    demands : mapping of label to TargetDemand
        Targets that need more than one agent, have a rank, or move.
    terrain : Terrain or None
        Ground that routes keep above; None: the ground is flat. Over terrain targets do not move in a plan.
    settled : mapping of int to label
        Vehicles that keep the routes they have if they get these targets.
    """
    notes: list[PlanNote] = []
    vehicles = [v for v in sorted(agents) if _on_earth(agents[v].east_m, agents[v].north_m)]
    labels = [label for label in sorted(targets) if _on_earth(*targets[label])]
    notes += [PlanNote(NoticeCode.AGENT_NOT_ON_EARTH, v) for v in sorted(set(agents) - set(vehicles))]
    notes += [
        _of_target(NoticeCode.TARGET_NOT_ON_EARTH, label) for label in sorted(set(targets) - set(labels))
    ]
    missing = [NoticeCode.NO_AGENTS] * (not agents) + [NoticeCode.NO_TARGETS] * (not targets)
    notes += [PlanNote(code) for code in missing]
    notes += [
        _of_target(NoticeCode.TARGET_OUTSIDE_MAP, label)
        for label in labels
        if not grid.contains(targets[label])
    ]
    found: dict[tuple[int, int], _ShapedRoute] = {}
    shaped: list[_ShapedRoute] = []
    keeping: dict[int, Label] = {}
    if vehicles and labels:
        needs = [demands.get(label, TargetDemand()) for label in labels]
        starts = [agents[v] for v in vehicles]
        goals = [grid.nearest_inside(targets[label]) for label in labels]
        search: RouteSearch | TerrainSearch
        if terrain is not None:
            search = TerrainSearch(terrain, grid, starts, goals, options)
            notes += _unreached_notes(vehicles, labels, search.costs)
        else:
            search = RouteSearch(grid, starts, goals, needs, options)
            notes += _reachability_notes(grid, search.smap, vehicles, labels, search.starts, search.costs)
        on_stage("search")
        flown_to = [labels.index(current[v]) if current.get(v) in labels else -1 for v in vehicles]
        costs = with_change_costs(search.costs, flown_to, options.switch_gain_m)
        costs = fit_costs(costs, [agents[v] for v in vehicles], [targets[one] for one in labels], flown_to)
        costs = pinned_costs(costs, starts, labels, needs)
        pairs = assign_agents(costs, needs)
        on_stage("assignment")
        for _ in range(_MAX_ASSIGNMENTS):
            keeping = {v: labels[pairs[i]] for i, v in enumerate(vehicles) if i in pairs}
            keeping = {v: label for v, label in keeping.items() if settled.get(v) == label}
            to_shape = [(i, j) for i, j in pairs.items() if vehicles[i] not in keeping]
            for i, j in to_shape:
                if (i, j) in found:
                    continue
                if isinstance(search, TerrainSearch):
                    found[i, j] = _shape_over_terrain(search, (i, j), vehicles[i], labels[j], starts[i].layer)
                else:
                    shape = partial(_shape_route, grid, vehicle=vehicles[i], label=labels[j])
                    planned = shape(search, (i, j), options=options)
                    aim = (starts[i], goals[j], needs[j])
                    found[i, j] = _fit_for_wind(grid, planned, shape, aim, options)
            shaped = [found[pair] for pair in to_shape]
            dead = [pair for pair in to_shape if found[pair].route is None]
            dead = [(i, j) for i, j in dead if current.get(vehicles[i]) != labels[j]]
            if not dead:
                break
            costs[tuple(np.transpose(dead))] = np.inf
            pairs = assign_agents(costs, needs)
        on_stage("shaping")
    routes = [one.route for one in shaped if one.route is not None]
    served = {route.target for route in routes} | set(keeping.values())
    busy = {route.vehicle for route in routes} | set(keeping)
    notes += [note for one in shaped if one.route is not None for note in one.notes]
    notes += [
        note for one in found.values() if one.route is None and one.label not in served for note in one.notes
    ]
    return PlanResult(
        tuple(routes),
        tuple(v for v in sorted(agents) if v not in busy),
        tuple(label for label in sorted(targets) if label not in served),
        tuple(notes),
        {one.vehicle: one.grid_length_m for one in shaped if one.route is not None},
        frozenset(one.vehicle for one in shaped if one.is_short),
        {one.vehicle: one.captured for one in shaped if one.captured is not None},
        frozenset(one.vehicle for one in shaped if one.route is None),
        frozenset(keeping),
    )


@dataclass(frozen=True, slots=True)
class _ShapedRoute:
    """Route of one agent to one target."""

    vehicle: int
    label: Label
    route: Route | None
    """None if no loiter circle at its end is clear."""
    grid_length_m: float
    notes: list[PlanNote]
    is_short: bool = False
    """True if it ends before the target."""
    captured: Route | None = None
    """Shorter route without an explicit first turn."""


def _shape_route(
    grid: Grid, search: RouteSearch, pair: tuple[int, int], vehicle: int, label: Label, options: PlanOptions
) -> _ShapedRoute:
    """Return the route of an agent to a target, with its terminal loiter."""
    i, j = pair
    start = search.agents[pair[0]]
    own = start.options or options
    aimed = search.route(i, j)
    notes = [_of_route(code, vehicle, label, parameters) for code, parameters in aimed.notes]
    planned = Route(vehicle, label, aimed.points_m, aimed.length_m)
    route, problem = _with_terminal_loiter(grid, planned, start, aimed.target_m, own)
    if problem:
        notes.append(_of_route(problem, vehicle, label))
    captured = None
    if route is not None and has_explicit_turn(start, route.points_m) and options.shape == "flyable":
        aimed = search.route(i, j, turns=False)
        plain = Route(vehicle, label, aimed.points_m, aimed.length_m)
        begin = replace(start, course_rad=None)
        ended, plain_problem = _with_terminal_loiter(grid, plain, begin, aimed.target_m, own)
        length_m = math.inf if ended is None or plain_problem else _captured_m(grid, ended, begin, own)
        if ended is not None and length_m < route.length_m:
            captured = replace(ended, length_m=length_m)
    return _ShapedRoute(
        vehicle, label, route, aimed.grid_length_m, notes, route is not None and problem is not None, captured
    )


def _shape_over_terrain(
    search: TerrainSearch, pair: tuple[int, int], vehicle: int, label: Label, layer: int
) -> _ShapedRoute:
    """Return the route of an agent to a target inside the flight band, with its loiter circle."""
    found = search.route(*pair, layer)
    if found is None:
        note = _of_route(NoticeCode.NO_ROUTE_IN_BAND, vehicle, label)
        return _ShapedRoute(vehicle, label, None, math.inf, [note])
    planned, target_m = found
    points_m = planned.points_m[1:]
    circle = planned.circle
    route = Route(
        vehicle,
        label,
        read_only(points_m),
        planned.length_m,
        wait_m=(circle.east_m, circle.north_m),
        heights_msl_m=read_only(np.append(planned.heights_msl_m[1:], circle.low_msl_m)),
        target_point=int(np.argmin(np.hypot(*(points_m - target_m).T))),
    )
    return _ShapedRoute(vehicle, label, route, float(search.costs[pair]), [])


def _fit_for_wind(
    grid: Grid,
    planned: _ShapedRoute,
    shape: Callable[..., _ShapedRoute],
    aim: tuple[AgentState, Point, TargetDemand],
    options: PlanOptions,
) -> _ShapedRoute:
    """Return the route of an agent to a target that costs least in wind (`gcs.planning.routes_in_wind`)."""
    start, target_m, demand = aim
    own = start.options or options
    is_windy = own.turns is not None and own.turns.wind_m_s > 0.0
    if not is_windy or planned.route is None or own.shape != "flyable" or not grid.blocked.any():
        return planned

    def rated(points_m: FloatArray, length_m: float, most_m: float) -> tuple[float, float]:
        """Return the clearance of flights in wind, and cost of a route; exact below `most_m`."""
        give_up_m = needed_clearance_m(most_m - length_m, own)
        clearance_m = clearance_in_wind_m(grid, start, points_m, own, give_up_m)
        return clearance_m, length_m + detour_worth_m(clearance_m, own)

    best = planned
    best_m, least_cost_m = rated(planned.route.points_m, planned.route.length_m, math.inf)
    for shares in WIND_SHARES:
        if keeps_enough(best_m, own):
            break
        agent = replace(start, options=widened(own, *shares))
        wide = widened(options, *shares)
        search = RouteSearch(grid, [agent], [target_m], [demand], wide)
        if not math.isfinite(search.costs[0, 0]):
            continue
        aimed = search.route(0, 0)
        clearance_m, cost_m = rated(aimed.points_m, aimed.length_m, least_cost_m)
        if cost_m >= least_cost_m:
            continue
        other = shape(search, (0, 0), options=wide)
        if other.route is None or other.is_short > best.is_short:
            continue
        if not np.array_equal(other.route.points_m, aimed.points_m):
            clearance_m, cost_m = rated(other.route.points_m, other.route.length_m, least_cost_m)
        if cost_m < least_cost_m:
            best = other
            best_m = clearance_m
            least_cost_m = cost_m
    notes = [note for note in best.notes if best is planned or note.code not in _OF_WIDER]
    if not keeps_enough(best_m, own) and all(
        note.code is not NoticeCode.ROUTE_NEAR_OBSTACLES for note in notes
    ):
        about = {"clearance_m": float(own.clearance_m)}
        notes.append(_of_route(NoticeCode.ROUTE_NEAR_OBSTACLES, best.vehicle, best.label, about))
    captured = best.captured
    if captured is not None and clearance_in_wind_m(grid, start, captured.points_m, own, best_m) < best_m:
        captured = None
    return replace(best, notes=notes, captured=captured)


def _with_terminal_loiter(
    grid: Grid, route: Route, start: AgentState, target_m: Point, options: PlanOptions
) -> tuple[Route | None, NoticeCode | None]:
    """Return a route whose end can be flown, None without one, and what the operator should know."""
    if options.loiter is None or options.shape != "flyable":
        return route, None
    end = plan_terminal_loiter(grid, start, route.points_m, target_m, options, options.loiter)
    if end.clearance_m < 0.0:
        return None, NoticeCode.NO_CLEAR_LOITER
    problem = None if end.passes_target else NoticeCode.LOITERS_SHORT
    if options.loiter.is_left:
        end = replace(end, wait_m=None)
    if end.points_m is route.points_m:
        return replace(route, wait_m=end.wait_m), problem
    path_m = np.vstack(((start.east_m, start.north_m), end.points_m))
    length_m = float(np.hypot(*np.diff(path_m, axis=0).T).sum())
    route = replace(route, points_m=read_only(end.points_m), length_m=length_m, wait_m=end.wait_m)
    return route, problem


def _captured_m(grid: Grid, route: Route, start: AgentState, options: PlanOptions) -> float:
    """Return the length of a route captured without an explicit turn; infinite if it is not clear."""
    motion = start.motion
    turns = options.turns
    lag_s = options.turn_lag_s
    if motion is None or turns is None:
        return math.inf
    horizon_s = turn_around_s(motion, options.turn_radius_m, lag_s)
    return capture_length_m(grid, motion, route.points_m, turns, horizon_s, lag_s, options.clearance_m)


def _of_target(code: NoticeCode, label: Label) -> PlanNote:
    return PlanNote(code, None, {"target": target_name(label)})


def _of_route(
    code: NoticeCode, vehicle: int, label: Label, parameters: Mapping[str, Parameter] = MappingProxyType({})
) -> PlanNote:
    return PlanNote(code, vehicle, {"target": target_name(label), **parameters})


def _on_earth(east_m: float, north_m: float) -> bool:
    """Return True if a position is finite and within one circumference of the Earth."""
    return abs(east_m) + abs(north_m) < 5e7


def _reachability_notes(
    grid: Grid,
    smap: SearchMap,
    vehicles: Sequence[int],
    labels: Sequence[Label],
    starts: Endpoints,
    lengths_m: FloatArray,
) -> list[PlanNote]:
    """Return notes on agents inside obstacles and on unreachable agents and targets."""
    if grid.blocked.all():
        return [PlanNote(NoticeCode.NO_FREE_CELL)]
    notes = []
    for i in np.flatnonzero(starts.inside).tolist():
        east, north = cells(smap, starts.nodes[i, :1])[0] * grid.spacing_m + np.array(grid.origin_m)
        where = {"east_m": float(east), "north_m": float(north)}
        notes.append(PlanNote(NoticeCode.INSIDE_OBSTACLE, vehicles[i], where))
    return notes + _unreached_notes(vehicles, labels, lengths_m)


def _unreached_notes(
    vehicles: Sequence[int], labels: Sequence[Label], lengths_m: FloatArray
) -> list[PlanNote]:
    """Return notes on agents and targets without any path."""
    reached = np.isfinite(lengths_m)
    notes = [
        PlanNote(NoticeCode.NO_PATH_TO_TARGETS, vehicles[i])
        for i in np.flatnonzero(~reached.any(axis=1)).tolist()
    ]
    notes += [
        _of_target(NoticeCode.NO_PATH_FROM_AGENTS, labels[j])
        for j in np.flatnonzero(~reached.any(axis=0)).tolist()
    ]
    return notes


def warm_up_calls() -> list[jit.Call]:
    """Return one call of every kernel, as typed in a plan. The slowest to compile stand at the ends."""
    grid = free_grid((2, 2), 10.0)
    blocked = grid.blocked
    smap = search_map(grid)
    xy = np.zeros((1, 2))
    vertices = np.array([[0.0, 0.0], [1.0, 1.0]])
    return [
        (clear_leg, blocked, 0.0, 0.0, 1.0, 1.0, 0.0, -1),
        (pull_string, blocked, 0.0, vertices, np.zeros(2), 0.0, 0.0, -1),
        (shorten, blocked, 0.0, vertices, np.zeros(2), -1, False, False),
        (connect_to_grid, blocked, smap.largest_component, smap.tight_nodes, smap.stride, xy),
        (clearances_along, blocked, np.ones(3), xy, 1.0),
        (is_adjacent_and_visible, blocked, 0.0, xy[0], xy[0]),
        (keeps_clearance, blocked, 0.0, vertices, -1, False),
        (legs_are_clear, blocked, vertices, -1),
        *canonical_ordering.warm_up_calls(),
        *clearance_nodes.warm_up_calls(),
        *cost_matrix.warm_up_calls(),
        *intercept.warm_up_calls(),
        *forward_simulation.warm_up_calls(),
        *loiter.warm_up_calls(),
        *layer_assignment.warm_up_calls(),
        (make_flyable, blocked, 0.0, vertices, np.zeros(2), 1.0, -1),
        (is_turn_safe, blocked, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, -1),
        (start_clearance, blocked, 0.0, 0.0, 0.0),
    ]


def warm_up() -> None:
    """Compile every kernel, or load it from the cache. Otherwise the first plan takes seconds longer."""
    jit.warm_up(__name__)
