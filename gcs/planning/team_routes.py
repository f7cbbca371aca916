"""Assignment of targets to the agents of a team, and a route for each assigned agent.

`plan_routes` is one plan, whatever is flown already: search, assignment, shaping. A pair whose route has no
clear end is excluded, and the rest is assigned again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from gcs.model import Label, NoticeCode
from gcs.planning.assignment import assign_agents, fit_costs, pinned_costs, with_change_costs
from gcs.planning.map.grid import Grid, Point
from gcs.planning.pair_route import ShapedRoute, fit_for_wind, shape_over_terrain, shape_route
from gcs.planning.plan_notes import PlanNote, of_target
from gcs.planning.plan_result import PlanResult
from gcs.planning.planner_inputs import AgentState, PlanOptions, TargetDemand
from gcs.planning.reachability import reachability_notes, unreached_notes
from gcs.planning.route_search import RouteSearch
from gcs.planning.terrain.ground import Terrain
from gcs.planning.terrain.terrain_search import TerrainSearch

_MAX_ASSIGNMENTS = 4
"""Assignments of one plan. A pair whose route has no clear end is excluded from the next one."""
Stage: TypeAlias = Literal["search", "assignment", "shaping"]


def ignore_stage(_stage: Stage) -> None:
    """Ignore the end of a stage."""


def plan_routes(
    grid: Grid,
    agents: Mapping[int, AgentState],
    targets: Mapping[Label, Point],
    current: Mapping[int, Label],
    options: PlanOptions,
    on_stage: Callable[[Stage], None] = ignore_stage,
    demands: Mapping[Label, TargetDemand] = MappingProxyType({}),
    terrain: Terrain | None = None,
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
        Ground that routes keep above; None: the ground is flat. Over terrain agents are assigned by where
        targets are now.
    """
    notes: list[PlanNote] = []
    vehicles = [v for v in sorted(agents) if _on_earth(agents[v].east_m, agents[v].north_m)]
    labels = [label for label in sorted(targets) if _on_earth(*targets[label])]
    notes += [PlanNote(NoticeCode.AGENT_NOT_ON_EARTH, v) for v in sorted(set(agents) - set(vehicles))]
    notes += [
        of_target(NoticeCode.TARGET_NOT_ON_EARTH, label) for label in sorted(set(targets) - set(labels))
    ]
    missing = [NoticeCode.NO_AGENTS] * (not agents) + [NoticeCode.NO_TARGETS] * (not targets)
    notes += [PlanNote(code) for code in missing]
    notes += [
        of_target(NoticeCode.TARGET_OUTSIDE_MAP, label)
        for label in labels
        if not grid.contains(targets[label])
    ]
    found: dict[tuple[int, int], ShapedRoute] = {}
    shaped: list[ShapedRoute] = []
    keeping: dict[int, Label] = {}
    if vehicles and labels:
        needs = [demands.get(label, TargetDemand()) for label in labels]
        starts = [agents[v] for v in vehicles]
        goals = [grid.nearest_inside(targets[label]) for label in labels]
        search: RouteSearch | TerrainSearch
        if terrain is not None:
            velocities_m_s = [one.velocity_m_s for one in needs]
            search = TerrainSearch(terrain, grid, starts, goals, options, velocities_m_s)
            notes += unreached_notes(vehicles, labels, search.costs)
        else:
            search = RouteSearch(grid, starts, goals, needs, options)
            notes += reachability_notes(grid, search.smap, vehicles, labels, search.starts, search.costs)
        on_stage("search")
        flown_to = [labels.index(current[v]) if current.get(v) in labels else -1 for v in vehicles]
        costs = with_change_costs(search.costs, flown_to, options.switch_gain_m)
        costs = fit_costs(costs, [agents[v] for v in vehicles], [targets[one] for one in labels], flown_to)
        costs = pinned_costs(costs, starts, labels, needs)
        pairs = assign_agents(costs, needs)
        on_stage("assignment")
        for _ in range(_MAX_ASSIGNMENTS):
            keeping = {v: labels[pairs[i]] for i, v in enumerate(vehicles) if i in pairs}
            keeping = {v: label for v, label in keeping.items() if agents[v].settled == label}
            to_shape = [(i, j) for i, j in pairs.items() if vehicles[i] not in keeping]
            for i, j in to_shape:
                if (i, j) in found:
                    continue
                if isinstance(search, TerrainSearch):
                    found[i, j] = shape_over_terrain(search, (i, j), vehicles[i], labels[j], starts[i].layer)
                else:
                    shape = partial(shape_route, grid, vehicle=vehicles[i], label=labels[j])
                    planned = shape(search, (i, j), options=options)
                    aim = (starts[i], goals[j], needs[j])
                    found[i, j] = fit_for_wind(grid, planned, shape, aim, options)
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


def _on_earth(east_m: float, north_m: float) -> bool:
    """Return True if a position is finite and within one circumference of the Earth."""
    return abs(east_m) + abs(north_m) < 5e7
