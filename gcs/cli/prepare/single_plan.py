"""Plan of `gcs plan`: one plan without a flight, drawn and printed.

Agents are at the starts of the mission and targets at its target births, unless positions are given. Given
agents are numbered from 1. Targets are T0.0, T0.1 and so on: the names of tracks that are born there in the
first scan.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from gcs.cli.prepare.plan_files import write_plan_files
from gcs.cli.warm_up_progress import PLANNING, TERRAIN, load_kernels
from gcs.config import Config, load
from gcs.core.airspace.obstacle_map import mission_map
from gcs.core.replanning.mission_inputs import mission_inputs
from gcs.core.replanning.return_routes import NO_APPROACH, landing_of, return_over_terrain
from gcs.errors import ConfigError, RecordingError
from gcs.mavlink.autopilots import ARDUPLANE, AutopilotProfile
from gcs.mistake_codes import MistakeCode
from gcs.model import NoticeCode, target_name, vehicle_name
from gcs.planning.forward_simulation import LoiterCircle
from gcs.planning.manoeuvres.landing import LandingSpec, ReturnRoute, plan_return_route
from gcs.planning.map.grid import Grid, Point
from gcs.planning.plan_notes import PlanNote
from gcs.planning.plan_result import PlanResult
from gcs.planning.planner import plan_mission
from gcs.planning.planner_inputs import AgentState, MissionInputs
from gcs.planning.team_routes import Stage
from gcs.report.plots.plan_figure import PlanDrawing, draw_plan


@dataclass(frozen=True, slots=True)
class Task:
    """Inputs of a plan, with the mission file and its landings."""

    config: Config
    mission: MissionInputs
    landings: Mapping[int, LandingSpec]
    """Landings of agents at their starts; none for agents that loiter at the ends of their routes."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """Files that a plan is written to."""

    plot: Path | None = None
    plan_files: Path | None = None
    """Folder of the `.plan` files."""
    profile: AutopilotProfile = ARDUPLANE
    """Autopilot of the `.plan` files."""


def run_plan(task: Task, outputs: Outputs, console: Console, *, as_json: bool) -> int:
    """Plan, print and write; return the exit code: 1 when an agent that could have a route has none.

    Raises
    ------
    GcsError
        When a file cannot be written.
    """
    load_kernels(console, PLANNING, *([] if task.mission.terrain is None else [TERRAIN]))
    result, timings_ms = _plan(task)
    return_routes = _return_routes(task, result)
    problems = {vehicle: one.problem for vehicle, one in return_routes.items() if one.problem}
    landing = (route.vehicle for route in result.routes if route.vehicle in task.landings)
    problems |= {vehicle: NO_APPROACH for vehicle in landing if vehicle not in return_routes}
    notes = [PlanNote(NoticeCode.RETURN_ROUTE_PROBLEM, v, {"problem": text}) for v, text in problems.items()]
    result = replace(result, notes=(*result.notes, *notes))
    paths = [] if outputs.plot is None else [outputs.plot]
    if outputs.plot is not None:
        _draw(outputs.plot, task, result, return_routes)
    if outputs.plan_files is not None:
        paths += write_plan_files(
            outputs.plan_files,
            task.config,
            outputs.profile,
            task.mission.agents,
            result.routes,
            return_routes,
        )
    _print_plan(task, result, timings_ms, console)
    for path in paths:
        console.print(f"written: {path}", highlight=False, markup=False, soft_wrap=True)
    if as_json:
        print(json.dumps(_as_dict(task, result, timings_ms, return_routes)), flush=True)  # noqa: T201  the output of --json
    routes_expected = min(len(task.mission.agents), len(task.mission.targets))
    return 0 if routes_expected and len(result.routes) == routes_expected else 1


def planning_task(
    scenario: str, agent_texts: Sequence[str] | None, target_texts: Sequence[str] | None, seed: int
) -> Task:
    """Return the planning task of the arguments.

    Raises
    ------
    ConfigError
        When an argument or a file is invalid.
    """
    config = load(scenario)
    mission = mission_inputs(config, mission_map(config, seed))
    if agent_texts is not None:
        starts = _positions(agent_texts, "--agents", mission.grid)
        agents = {
            number: AgentState(*place, None, config.airframe.speed_m_s)
            for number, place in enumerate(starts, start=1)
        }
        mission = replace(mission, agents=agents, preferred_layers={n: n - 1 for n in agents})
    if target_texts is not None:
        targets = _positions(target_texts, "--targets", mission.grid)
        mission = replace(mission, targets={(0, number): place for number, place in enumerate(targets)})
    landings = {
        vehicle: landing
        for vehicle, airframe in config.airframes_of_agents.items()
        if (landing := landing_of(airframe)) is not None
    }
    return Task(config, mission, landings)


def _positions(given: Sequence[str], option: str, grid: Grid) -> list[Point]:
    """Return positions on the map from texts such as "1.5,2"."""
    places = []
    for text in given:
        try:
            x, y = (float(part) for part in text.split(","))
        except ValueError:
            raise ConfigError(
                option, text, MistakeCode.WRONG_TYPE, "expected x,y: two numbers with a comma and no space"
            ) from None
        if not grid.contains((x, y)):
            rows, cols = grid.shape
            west, south = grid.point_of((0, 0))
            east, north = grid.point_of((rows - 1, cols - 1))
            raise ConfigError(
                option,
                text,
                MistakeCode.OUTSIDE_MAP,
                f"lies off the map, x {west:g} ... {east:g}, y {south:g} ... {north:g}",
            )
        places.append((x, y))
    return places


def _plan(task: Task) -> tuple[PlanResult, dict[str, float]]:
    """Plan, and measure the time of each stage."""
    timings_ms: dict[str, float] = dict.fromkeys(("search", "assignment", "shaping"), 0.0)
    began = time.perf_counter()

    def done(stage: Stage) -> None:
        nonlocal began
        now = time.perf_counter()
        timings_ms[stage] += (now - began) * 1e3
        began = now

    result = plan_mission(task.mission, on_stage=done)
    near = [
        PlanNote(
            NoticeCode.NO_LAYER_LEFT,
            None,
            {"vehicles": conflict.vehicles, "distance_m": conflict.distance_m, "after_s": conflict.after_s},
        )
        for conflict in result.conflicts
    ]
    return replace(result, notes=(*result.notes, *near)), timings_ms


def _return_routes(task: Task, result: PlanResult) -> dict[int, ReturnRoute]:
    """Plan the return routes of agents to their starts, for missions that end with a landing.

    Over terrain agents without a clear approach have none.
    """
    found = {}
    for route in (one for one in result.routes if one.vehicle in task.landings):
        start = task.mission.agents[route.vehicle]
        home_m = (start.east_m, start.north_m)
        options = start.options or task.mission.options
        landing = task.landings[route.vehicle]
        planned = (
            plan_return_route(task.mission.grid, start, route.points_m, home_m, options, landing)
            if task.mission.terrain is None
            else return_over_terrain(task.mission, route, home_m)
        )
        if planned is not None:
            found[route.vehicle] = planned
    return found


def _as_dict(
    task: Task, result: PlanResult, timings_ms: dict[str, float], return_routes: Mapping[int, ReturnRoute]
) -> dict[str, Any]:
    """Return the plan for JSON; the points of a route begin with the agent's position."""
    return {
        "routes": [
            {
                "agent": route.vehicle,
                "target": list(route.target),
                "length_m": route.length_m,
                "grid_length_m": result.grid_lengths_m[route.vehicle],
                "layer": route.layer,
                "points_m": [result.paths_m[route.vehicle][0].tolist(), *route.points_m.tolist()],
                "wait_m": route.wait_m,
                "home_m": return_routes[route.vehicle].points_m.tolist()
                if route.vehicle in return_routes
                else None,
            }
            for route in result.routes
        ],
        "terrain": task.config.ground,
        "total_length_m": result.total_length_m,
        "unassigned_agents": list(result.unassigned_vehicles),
        "unassigned_targets": [list(target) for target in result.unassigned_targets],
        "timings_ms": timings_ms,
        "notes": [note.line for note in result.notes],
    }


def _draw(path: Path, task: Task, result: PlanResult, return_routes: Mapping[int, ReturnRoute]) -> None:
    loiter = task.mission.options.loiter if task.mission.options.shape == "flyable" else None
    title = f"{task.config.name}: {len(result.routes)} routes, {result.total_length_m:,.0f} m"
    drawing = PlanDrawing(
        title,
        task.mission.grid,
        task.mission.grid.inflate(task.mission.options.clearance_m),
        starts={vehicle: (agent.east_m, agent.north_m) for vehicle, agent in task.mission.agents.items()},
        targets={target_name(target): place for target, place in task.mission.targets.items()},
        routes={
            r.vehicle: (result.paths_m[r.vehicle][0].tolist(), *r.points_m.tolist()) for r in result.routes
        },
        circles={}
        if loiter is None
        else {
            r.vehicle: LoiterCircle((float(r.flown_m[-1, 0]), float(r.flown_m[-1, 1])), loiter.radius_m)
            for r in result.routes
        },
        homes={
            r.vehicle: (r.points_m[-1].tolist(), *return_routes[r.vehicle].points_m.tolist())
            for r in result.routes
            if r.vehicle in return_routes
        },
        terrain=task.mission.terrain,
        heights_msl_m={
            r.vehicle: np.append(
                task.mission.agents[r.vehicle].height_msl_m, r.heights_msl_m[: len(r.points_m)]
            )
            for r in result.routes
            if r.heights_msl_m is not None
        },
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draw_plan(drawing, path)
    except OSError as error:
        raise RecordingError(str(path), f"cannot be written: {error.strerror}") from None


def _print_plan(task: Task, result: PlanResult, timings_ms: dict[str, float], console: Console) -> None:
    grid = task.mission.grid
    console.print(
        f"{task.config.name}: {grid.shape[1]} x {grid.shape[0]} nodes, {grid.spacing_m:g} m apart, "
        f"{grid.blocked.mean():.1%} blocked; terrain {task.config.ground}",
        highlight=False,
    )
    table = Table()
    for heading in ("agent", "target", "length", "on the grid", "legs", "layer"):
        table.add_column(heading, justify="right")
    for route in result.routes:
        table.add_row(
            vehicle_name(route.vehicle),
            target_name(route.target),
            f"{route.length_m:,.1f} m",
            f"{result.grid_lengths_m[route.vehicle]:,.1f} m",
            str(len(route.points_m)),
            str(route.layer),
        )
    if len(result.routes) > 1:
        on_grid_m = math.fsum(result.grid_lengths_m.values())
        table.add_section()
        table.add_row("all", "", f"{result.total_length_m:,.1f} m", f"{on_grid_m:,.1f} m", "", "")
    if result.routes:
        console.print(table)
    for names, title in (
        ([vehicle_name(v) for v in result.unassigned_vehicles], "agents without a route"),
        ([target_name(target) for target in result.unassigned_targets], "targets without an agent"),
    ):
        if names:
            console.print(f"{title}: {', '.join(names)}", highlight=False)
    for note in result.notes:
        console.print(f"[yellow]note:[/] {note.line}", highlight=False)
    stages = [f"{stage} {ms:.2f} ms" for stage, ms in timings_ms.items()]
    console.print(", ".join(stages), highlight=False, style="dim")
