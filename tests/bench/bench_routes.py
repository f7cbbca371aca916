"""Routes bench: how much shorter taut and flyable routes are than the grid's, and with how many corners.

    python tests/bench/bench_routes.py

Maps: the paper's random obstacles at 40 m spacing; each pair from west, heading east, to the east edge.
Times are CPU time of one whole flyable plan, kernels compiled.
"""

from __future__ import annotations

import time

import numpy as np

from gcs.planning.grid import Grid, Point, free_grid, random_obstacles
from gcs.planning.routes import plan_routes, warm_up
from gcs.planning.task import AgentStart, PlanOptions

SHAPES = ("grid", "pulled", "flyable")
CASES = ((0.0, 20.0), (0.0, 40.0), (20.0, 40.0), (40.0, 40.0), (40.0, 57.0))


def pair(nodes: int, threshold: float, seed: int) -> tuple[Grid, Point, Point]:
    side_m, rng = 40.0 * (nodes - 1), np.random.default_rng(seed)
    start, goal = (0.02 * side_m, side_m * rng.random()), (0.95 * side_m, side_m * rng.random())
    grid = random_obstacles(free_grid((nodes, nodes), 40.0), threshold, rng, [start, goal], 120.0)
    return grid, start, goal


def row(nodes: int, count: int, threshold: float, clearance_m: float, radius_m: float) -> str:
    sums, found, notes, short, legs, spent_s = np.zeros((3, 2)), 0, np.zeros(2), 0, 0, 0.0
    for seed in range(count):
        grid, start, goal = pair(nodes, threshold, seed)
        results = []
        for shape in SHAPES:
            options = PlanOptions(shape=shape, clearance_m=clearance_m, turn_radius_m=radius_m)
            begin = time.process_time()
            results.append(plan_routes(grid, {1: AgentStart(*start, np.pi / 2)}, {(0, 0): goal}, {}, options))
            took_s = time.process_time() - begin
        if not all(result.routes for result in results):
            continue
        found, spent_s = found + 1, spent_s + took_s
        for i, result in enumerate(results):
            sums[i] += result.routes[0].length_m, len(result.routes[0].points_m) - 1
        said = " ".join(results[-1].notes)
        notes += "turn on" in said, "corners" in said
        inner = np.diff(np.vstack([start, results[-1].routes[0].points_m]), axis=0)[1:-1]
        short, legs = short + int((np.hypot(*inner.T) < radius_m - 1e-6).sum()), legs + len(inner)
    saved, corners = 1.0 - sums[1:, 0] / sums[0, 0], sums[1:, 1] / sums[0, 1]
    cells = [f"{nodes}^2, {threshold:.0%}", f"{clearance_m:.0f} m", f"{radius_m:.0f} m"]
    for i in range(2):
        cells += [f"{saved[i]:.1%}", f"{corners[i]:.0%}"]
    cells += [f"{short / max(legs, 1):.1%}", *(f"{share:.0%}" for share in notes / found)]
    return "| " + " | ".join([*cells, f"{1e3 * spent_s / found:.2f}"]) + " |"


def main() -> None:
    warm_up()
    names = ["nodes, obstacles", "clearance", "radius", "pulled: shorter", "corners", "flyable: shorter"]
    names += ["corners", "legs under the radius", "routes with a sharp start", "a sharp corner", "ms"]
    print("| " + " | ".join(names) + " |\n" + "|---" * len(names) + "|")
    for nodes, count in ((51, 60), (500, 4)):
        for threshold in (0.05, 0.1, 0.2, 0.3):
            for clearance_m, radius_m in CASES:
                print(row(nodes, count, threshold, clearance_m, radius_m), flush=True)


if __name__ == "__main__":
    main()
