"""`gcs plan`: the planner alone, on a mission's map or a Moving AI one: who flies where, how far, how fast.

Nothing flies. The agents stand where the mission starts and the targets where they may appear, unless places
are given. Agents keep their system ids, or are numbered from 1 when they are given; targets are numbered from
1 in their order.
"""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from gcs.cli.warm_up_progress import PLANNING, load_kernels
from gcs.config import load
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.core.replanning.altitude_layers import lane_count
from gcs.core.replanning.options import plan_options
from gcs.core.replanning.return_routes import landing_of
from gcs.errors import ConfigError, RecordingError
from gcs.files import read_text
from gcs.model import Route
from gcs.planning.deconfliction import PlannedFlight, assign_layers
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.movingai import MAX_BYTES, read_map
from gcs.planning.options import AgentState, PlanOptions
from gcs.planning.planner import PlanResult, Stage, plan_routes
from gcs.planning.terminal.landing import LandingSpec, ReturnRoute, plan_return_route
from gcs.planning.vehicle_model import LoiterCircle
from gcs.report.plots.plan import Drawing, draw_plan

_PICTURES = (".png", ".pdf", ".svg")


@dataclass(frozen=True, slots=True)
class PlanArguments:
    """What the command line says."""

    scenario: str | None
    agents: Sequence[str] | None
    """x,y each, in metres, or in cells of a Moving AI map; None: the scenario's."""
    targets: Sequence[str] | None
    map_file: Path | None
    seed: int
    plot: Path | None
    as_json: bool


@dataclass(frozen=True, slots=True)
class Task:
    """What there is to plan."""

    name: str
    grid: Grid
    agents: dict[int, AgentState]
    targets: dict[tuple[int, int], Point]
    """By (0, number)."""
    options: PlanOptions
    y_down: bool
    """As maps of the Moving AI format are drawn."""
    lanes: int = 1
    separation_m: float = 0.0
    landing: LandingSpec | None = None
    """How agents fly home to their starts; None when they wait at the ends of their routes."""


def run_plan(arguments: PlanArguments, console: Console) -> int:
    """Plan, print and draw; return the exit code: 1 when somebody stays without a route who might have one.

    Raises
    ------
    GcsError
        When an argument or a file is not what it should be, or the picture cannot be written.
    """
    if arguments.plot is not None and arguments.plot.suffix.lower() not in _PICTURES:
        raise ConfigError(str(arguments.plot), "", f"expected a name that ends in {', '.join(_PICTURES)}")
    task = _task(arguments)
    load_kernels(console, PLANNING)
    result, timings_ms = _plan(task)
    homes = _ways_home(task, result)
    result = replace(result, notes=(*result.notes, *_home_notes(homes)))
    if arguments.plot is not None:
        _draw(arguments.plot, task, result, homes)
    _show(task, result, timings_ms, arguments.plot, console)
    if arguments.as_json:
        plain = _plain(task, result, timings_ms, homes)
        print(json.dumps(plain), flush=True)  # noqa: T201  the promised last line
    wanted = min(len(task.agents), len(task.targets))
    return 0 if wanted and len(result.routes) == wanted else 1


def _task(arguments: PlanArguments) -> Task:
    """Gather what there is to plan."""
    if arguments.scenario is None and arguments.map_file is None:
        raise ConfigError("gcs plan", "", "expected a SCENARIO, or a map with --map FILE.map")
    agents: dict[int, AgentState] = {}
    targets: list[Point] = []
    options, name, y_down = PlanOptions(shape="pulled"), "", False
    apart: dict[str, Any] = {}
    speed_m_s = 15.0
    if arguments.scenario is not None:
        config = load(arguments.scenario)
        options, name, grid = plan_options(config), config.name, mission_grid(config, arguments.seed)
        speed_m_s = config.airframe.speed_m_s
        apart = {
            "lanes": lane_count(config),
            "separation_m": config.planning.separation_m,
            "landing": landing_of(config),
        }
        agents = {
            a.system_id: AgentState(
                a.east_m, a.north_m, math.radians(a.course_deg), config.speed_m_s(a.vehicle)
            )
            for a in config.agents
        }
        targets = [(birth.east_m, birth.north_m) for birth in config.births]
    if arguments.map_file is not None:
        name, grid, agents, targets, y_down = arguments.map_file.name, _read(arguments.map_file), {}, [], True
    if arguments.agents is not None:
        starts = _places(arguments.agents, "--agents", grid)
        agents = {n: AgentState(*place, None, speed_m_s) for n, place in enumerate(starts, start=1)}
    if arguments.targets is not None:
        targets = _places(arguments.targets, "--targets", grid)
    numbered = {(0, number): place for number, place in enumerate(targets, start=1)}
    return Task(name, grid, agents, numbered, options, y_down, **apart)


def _read(path: Path) -> Grid:
    try:
        return read_map(read_text(path, MAX_BYTES), str(path))
    except OSError as error:
        raise ConfigError(str(path), "", f"cannot be read as a map: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(str(path), "", f"cannot be read as a map: {error}") from None


def _places(given: Sequence[str], option: str, grid: Grid) -> list[Point]:
    """Read places, x,y each, that must lie on the map."""
    places = []
    for text in " ".join(given).replace(";", " ").split():
        try:
            x, y = (float(part) for part in text.split(","))
        except ValueError:
            raise ConfigError(option, text, "expected x,y: two numbers with a comma and no space") from None
        if not grid.contains((x, y)):
            rows, cols = grid.shape
            (west, south), (east, north) = grid.point_of((0, 0)), grid.point_of((rows - 1, cols - 1))
            raise ConfigError(
                option, text, f"lies off the map, x {west:g} ... {east:g}, y {south:g} ... {north:g}"
            )
        places.append((x, y))
    return places


def _plan(task: Task) -> tuple[PlanResult, dict[str, float]]:
    """Plan, and measure the stages."""
    timings_ms: dict[str, float] = dict.fromkeys(("search", "assignment", "shaping"), 0.0)
    began = time.perf_counter()

    def done(stage: Stage) -> None:
        nonlocal began
        now = time.perf_counter()
        timings_ms[stage] += (now - began) * 1e3
        began = now

    result = plan_routes(task.grid, task.agents, task.targets, {}, task.options, done)
    notes = [re.sub(r"target T0\.(\d+)", r"target \1", note) for note in result.notes]
    own = {vehicle: number for number, vehicle in enumerate(task.agents)}
    flights = [
        PlannedFlight(
            route.vehicle,
            np.vstack((_start(task, route.vehicle), route.flown_m)),
            task.agents[route.vehicle].speed_m_s,
            own[route.vehicle],
        )
        for route in result.routes
    ]
    lanes, conflicts = assign_layers(flights, task.lanes, task.separation_m)
    notes += [
        f"agents {conflict.vehicles[0]} and {conflict.vehicles[1]} come within {conflict.distance_m:.0f} m "
        f"of each other at one altitude after {conflict.after_s:.0f} s"
        for conflict in conflicts
    ]
    routes = tuple(replace(route, lane=lanes[route.vehicle]) for route in result.routes)
    return replace(result, routes=routes, notes=tuple(notes)), timings_ms


def _ways_home(task: Task, result: PlanResult) -> dict[int, ReturnRoute]:
    """Plan the ways of agents back to where they start, when they land at the end."""
    landing = task.landing
    if landing is None:
        return {}
    return {
        route.vehicle: plan_return_route(
            task.grid, start, route.points_m, (start.east_m, start.north_m), task.options, landing
        )
        for route in result.routes
        for start in (task.agents[route.vehicle],)
    }


def _home_notes(homes: Mapping[int, ReturnRoute]) -> list[str]:
    return [f"agent {vehicle}: {home.problem}" for vehicle, home in homes.items() if home.problem]


def _plain(
    task: Task, result: PlanResult, timings_ms: dict[str, float], homes: Mapping[int, ReturnRoute]
) -> dict[str, Any]:
    """Return the plan as JSON has it; a route's points begin with the agent's own place."""
    return {
        "routes": [
            {
                "agent": route.vehicle,
                "target": route.target[1],
                "length_m": route.length_m,
                "grid_length_m": result.grid_lengths_m[route.vehicle],
                "lane": route.lane,
                "points_m": [_start(task, route.vehicle), *route.points_m.tolist()],
                "wait_m": route.wait_m,
                "home_m": homes[route.vehicle].points_m.tolist() if route.vehicle in homes else None,
            }
            for route in result.routes
        ],
        "total_length_m": result.total_length_m,
        "unassigned_agents": list(result.unassigned_vehicles),
        "unassigned_targets": [number for _, number in result.unassigned_targets],
        "timings_ms": timings_ms,
        "notes": list(result.notes),
    }


def _start(task: Task, vehicle: int) -> list[float]:
    agent = task.agents[vehicle]
    return [agent.east_m, agent.north_m]


def _circle(route: Route, radius_m: float) -> LoiterCircle:
    east_m, north_m = route.flown_m[-1].tolist()
    return LoiterCircle((east_m, north_m), radius_m)


def _draw(path: Path, task: Task, result: PlanResult, homes: Mapping[int, ReturnRoute]) -> None:
    loiter = task.options.loiter if task.options.shape == "flyable" else None
    title = f"{task.name}: {len(result.routes)} routes, {result.total_length_m:,.0f} m"
    drawing = Drawing(
        title,
        task.grid,
        task.grid.inflate(task.options.clearance_m),
        starts={vehicle: (agent.east_m, agent.north_m) for vehicle, agent in task.agents.items()},
        targets={number: place for (_, number), place in task.targets.items()},
        routes={r.vehicle: (_start(task, r.vehicle), *r.points_m.tolist()) for r in result.routes},
        circles={} if loiter is None else {r.vehicle: _circle(r, loiter.radius_m) for r in result.routes},
        homes={
            r.vehicle: (r.points_m[-1].tolist(), *homes[r.vehicle].points_m.tolist())
            for r in result.routes
            if r.vehicle in homes
        },
        y_down=task.y_down,
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draw_plan(drawing, path)
    except OSError as error:
        raise RecordingError(str(path), f"cannot be written: {error.strerror}") from None


def _show(
    task: Task, result: PlanResult, timings_ms: dict[str, float], plot: Path | None, console: Console
) -> None:
    rows, cols = task.grid.shape
    blocked = task.grid.blocked.mean()
    console.print(
        f"{task.name}: {cols} x {rows} nodes, {task.grid.spacing_m:g} m apart, {blocked:.1%} blocked",
        highlight=False,
    )
    table = Table()
    for heading in ("agent", "target", "length", "on the grid", "legs", "lane"):
        table.add_column(heading, justify="right")
    for route in result.routes:
        table.add_row(
            str(route.vehicle),
            str(route.target[1]),
            f"{route.length_m:,.1f} m",
            f"{result.grid_lengths_m[route.vehicle]:,.1f} m",
            str(len(route.points_m)),
            str(route.lane),
        )
    if len(result.routes) > 1:
        on_grid_m = math.fsum(result.grid_lengths_m.values())
        table.add_section()
        table.add_row("all", "", f"{result.total_length_m:,.1f} m", f"{on_grid_m:,.1f} m", "", "")
    if result.routes:
        console.print(table)
    for names, who in (
        ([str(v) for v in result.unassigned_vehicles], "agents without a route"),
        ([str(number) for _, number in result.unassigned_targets], "targets without an agent"),
    ):
        if names:
            console.print(f"{who}: {', '.join(names)}", highlight=False)
    for note in result.notes:
        console.print(f"[yellow]note:[/] {note}", highlight=False)
    stages = ", ".join(f"{stage} {ms:.2f} ms" for stage, ms in timings_ms.items())
    console.print(f"{stages}", highlight=False, style="dim")
    if plot is not None:
        console.print(f"picture: {plot}", highlight=False, markup=False, soft_wrap=True)
