"""Planner bench: whole plans, string pulling and switch hysteresis.

    python tests/bench/bench_planning.py [--swarm]

Times are medians of CPU time on one thread, in milliseconds, kernels compiled. Maps: the paper's random
obstacles.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from gcs.planning.layer_assignment import PlannedFlight, assign_layers
from gcs.planning.map.grid import Grid, Point, free_grid, random_obstacles
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.planner_inputs import AgentState, LoiterSpec, PlanOptions
from gcs.planning.search.neighbours import search_map
from gcs.planning.team_routes import Stage, plan_routes
from gcs.planning.warm_up import warm_up

LOITER = LoiterSpec(
    radius_m=40.0, reach_radius_m=40.0, turn_lag_s=1.0, turns=TurnAnticipation(40.0, 15.0, 10.0)
)


def median_ms(work: Callable[[], object], repeats: int) -> float:
    """CPU time of one call."""
    work()
    times = []
    for _ in range(repeats):
        begin = time.process_time_ns()
        work()
        times.append(time.process_time_ns() - begin)
    return float(np.median(times)) / 1e6


def mission(
    nodes: int, n_agents: int, n_targets: int, threshold: float, seed: int = 3
) -> tuple[Grid, dict, dict]:
    """Agents at the left edge, targets at the right, obstacles nowhere near either."""
    side_m = 40.0 * (nodes - 1)
    agents = {v + 1: (3.0, side_m * (v + 1) / (n_agents + 1)) for v in range(n_agents)}
    targets = {(0, j): (0.95 * side_m, side_m * (j + 1) / (n_targets + 1)) for j in range(n_targets)}
    places: list[Point] = [*agents.values(), *targets.values()]
    grid = random_obstacles(
        free_grid((nodes, nodes), 40.0), threshold, np.random.default_rng(seed), places, 120.0
    )
    return grid, {v: AgentState(*p, np.pi / 2) for v, p in agents.items()}, targets


def anywhere(nodes: int, n_agents: int, n_targets: int, threshold: float) -> tuple[Grid, dict, dict]:
    """Agents and targets all over the map."""
    side_m, rng = 40.0 * (nodes - 1), np.random.default_rng(3)
    places = [tuple(place) for place in rng.uniform(0.0, side_m, (n_agents + n_targets, 2)).tolist()]
    grid = random_obstacles(free_grid((nodes, nodes), 40.0), threshold, rng, places, 120.0)
    agents = {v: AgentState(*place, np.pi / 2) for v, place in enumerate(places[:n_agents])}
    return grid, agents, {(0, j): place for j, place in enumerate(places[n_agents:])}


def swarm() -> None:
    """100 agents x 100 targets on 500 x 500, flyable: what each stage takes, the map's preparation too."""
    print("\n100 x 100 on 500 x 500, flyable; CPU time, ms, median of 5 plans")
    print("| obstacles | clearance | map, once | search | assignment | shaping | separation | a plan |")
    print("|---|---|---|---|---|---|---|---|")
    for name, layout in (("edge to edge", mission), ("anywhere", anywhere)):
        for threshold in (0.1, 0.2):
            for clearance_m in (0.0, 25.0):
                grid, agents, targets = layout(500, 100, 100, threshold)
                options = PlanOptions(shape="flyable", clearance_m=clearance_m, loiter=LOITER)
                begin = time.process_time()
                search_map(grid, clearance_m, shifts_nodes=True)
                map_ms = 1e3 * (time.process_time() - begin)
                took = np.median([stages(grid, agents, targets, options) for _ in range(5)], axis=0)
                cells = [f"{one:.0f}" for one in (map_ms, *took, took.sum())]
                what = f"{threshold:.0%}, {name} | {clearance_m:.0f} m"
                print("| " + " | ".join([what, *cells]) + " |", flush=True)


def stages(grid: Grid, agents: dict, targets: dict, options: PlanOptions) -> list[float]:
    """CPU time, in ms, of search, assignment, shaping and separation of one plan."""
    ends = [time.process_time()]

    def done(_stage: Stage) -> None:
        ends.append(time.process_time())

    result = plan_routes(grid, agents, targets, {}, options, done)
    flights = []
    for layer, route in enumerate(result.routes):
        at = agents[route.vehicle]
        points_m = np.vstack(((at.east_m, at.north_m), route.points_m))
        flights.append(PlannedFlight(route.vehicle, points_m, at.speed_m_s, layer % 10))
    assign_layers(flights, 10, 60.0)
    ends.append(time.process_time())
    return [1e3 * one for one in np.diff(ends)]


def whole_plans() -> None:
    print("\nwhole plans: costs, assignment, routes                     obstacles   ms    length km  corners")
    for name, size, repeats in (
        ("4 x 5 on 51 x 51", (51, 4, 5), 100),
        ("50 x 60 on 151 x 151", (151, 50, 60), 10),
    ):
        for threshold in (0.1, 0.2):
            grid, agents, targets = mission(*size, threshold)
            for options in (
                PlanOptions(),
                PlanOptions(shape="pulled"),
                PlanOptions(shape="pulled", clearance_m=25.0),
            ):
                ms = median_ms(lambda: plan_routes(grid, agents, targets, {}, options), repeats)  # noqa: B023
                result = plan_routes(grid, agents, targets, {}, options)
                corners = sum(len(route.points_m) - 1 for route in result.routes)
                what = f"{name}  {options.shape} {options.clearance_m:.0f} m"
                print(
                    f"  {what:<55} {threshold:6.1f} {ms:9.2f} {result.total_length_m / 1e3:9.2f} {corners:8d}"
                )


def pulling() -> None:
    print("\nstring pulling, 40 pairs on 151 x 151: saved length, corners left, of the grid's")
    for threshold in (0.05, 0.1, 0.2, 0.3):
        sums = np.zeros((2, 2))
        for seed in range(40):
            grid, agents, targets = mission(151, 1, 1, threshold, seed)
            for i, options in enumerate((PlanOptions(), PlanOptions(shape="pulled"))):
                for route in plan_routes(grid, agents, targets, {}, options).routes:
                    sums[i] += route.length_m, len(route.points_m) - 1
        print(
            f"  {threshold:4.0%} obstacles {1 - sums[1, 0] / sums[0, 0]:8.1%} {sums[1, 1] / sums[0, 1]:8.0%}"
        )


def hysteresis() -> None:
    print("\nhysteresis, 20 agents x 20 drifting targets, 200 plans with 10 m of noise: switches, length")
    for gain_m in (0.0, 50.0, 100.0):
        rng = np.random.default_rng(5)
        grid, _, _ = mission(101, 1, 1, 0.1)
        at, aim = rng.uniform(0, 4000, (20, 2)), rng.uniform(0, 4000, (20, 2))
        drift = rng.normal(0, 5, (20, 2))
        current: dict[int, tuple[int, int]] = {}
        switches, length_m = 0, 0.0
        for _ in range(200):
            seen, goal = at + rng.normal(0, 10, at.shape), aim + rng.normal(0, 10, aim.shape)
            agents = {v: AgentState(*seen[v]) for v in range(20)}
            targets = {(0, j): (float(goal[j, 0]), float(goal[j, 1])) for j in range(20)}
            result = plan_routes(grid, agents, targets, current, PlanOptions(switch_gain_m=gain_m))
            now = {route.vehicle: route.target for route in result.routes}
            switches += sum(current.get(v, label) != label for v, label in now.items())
            length_m += result.total_length_m
            current = now
            aim = np.clip(aim + drift, 0, 4000)
            drift = drift + rng.normal(0, 1, drift.shape)
        print(f"  {gain_m:5.0f} m {switches:6d} {length_m / 1e3:10.1f} km")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--swarm", action="store_true", help="only 100 agents and 100 targets on 500 x 500")
    only_swarm = parser.parse_args().swarm
    begin = time.perf_counter()
    warm_up()
    print(f"warm-up {time.perf_counter() - begin:.2f} s")
    swarm()
    if only_swarm:
        raise SystemExit
    whole_plans()
    pulling()
    hysteresis()
