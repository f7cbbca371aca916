"""Visibility-graph bench: how short a route could be at best, and with how few corners.

    python tests/bench/bench_visibility.py [--pairs 20]

Maps: the paper's random obstacles at 40 m spacing; each pair from west, heading east, to the east edge.

The reference is A* on the visibility graph of the whole map: every convex corner of every blocked cell, with
a clearance rounded by it and wrapped by `_WRAPS` points of the circumscribed polygon (longer than the arc by
tan(t)/t - 1 = 0.3 % at t = 5.6 degrees, of the arcs alone). Its edges are the legs that are tangent at both
ends and keep the clearance exactly. Nothing any-angle that keeps the clearance is shorter, but for that.
Corners of the reference are the corners of obstacles that it wraps, each counted once however many points
wrap it. Slow and plain, on purpose.

Lengths of flyable routes are those along legs and arcs, as they are flown, the first turn too; the grid's are
its legs'. "Not flown" is the share of corners whose arc does not fit the legs or comes nearer than the
clearance.

"None" are pairs that no route with the clearance joins; "gives up" those where the grid's cheapest way comes
nearer than the clearance, and "for" by how much longer the reference's path, which keeps it, is than that.
Both are left out of the rest.
"""

from __future__ import annotations

import argparse
import math

import numba
import numpy as np

from gcs.model import NoticeCode
from gcs.planning.map.grid import Grid, Point, free_grid, random_obstacles
from gcs.planning.map.line_of_sight import clear_leg, leg_clearance, to_cells
from gcs.planning.path.corner_smoothing import turn_fits
from gcs.planning.plan_result import PlanResult
from gcs.planning.planner_inputs import AgentState, PlanOptions
from gcs.planning.team_routes import plan_routes
from gcs.planning.warm_up import warm_up

_WRAPS = 8
_AWAY = 1e-6
"""In cells, as `gcs.planning.path.string_pulling` bends off a corner without a clearance."""


def pair(nodes: int, threshold: float, seed: int) -> tuple[Grid, Point, Point]:
    side_m, rng = 40.0 * (nodes - 1), np.random.default_rng(seed)
    start, goal = (0.02 * side_m, side_m * rng.random()), (0.95 * side_m, side_m * rng.random())
    grid = random_obstacles(free_grid((nodes, nodes), 40.0), threshold, rng, [start, goal], 120.0)
    return grid, start, goal


def corners(grid: Grid, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Points that wrap the convex corners: x, y and the edges' directions, (n, 6); and their corner (n,)."""
    free = np.pad(~grid.blocked, 1, constant_values=True)
    found, owners = [], []
    for owner, (row, col) in enumerate(np.argwhere(grid.blocked)):
        for sx, sy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            r, c = row + 1, col + 1
            if not (free[r + sy, c] and free[r, c + sx] and free[r + sy, c + sx]):
                continue
            x, y = col + 0.5 * sx, row + 0.5 * sy
            if reach <= 0.0:
                found.append((x + _AWAY * sx, y + _AWAY * sy, -sx, 0.0, 0.0, -sy))
                owners.append(4 * owner + (sx > 0) + 2 * (sy > 0))
                continue
            step = 0.5 * math.pi / _WRAPS
            for k in range(_WRAPS):
                # Tangents touch the arc at k and k + 1 steps; they meet half-way, farther out.
                a, b, mid = k * step, (k + 1) * step, (k + 0.5) * step
                far = reach / math.cos(0.5 * step)
                edges = (-sx * -math.sin(a), -sy * math.cos(a), sx * -math.sin(b), sy * math.cos(b))
                found.append((x + far * sx * math.cos(mid), y + far * sy * math.sin(mid), *edges))
                owners.append(4 * owner + (sx > 0) + 2 * (sy > 0))
    return np.array(found).reshape(-1, 6), np.array(owners, dtype=np.int64)


@numba.njit(cache=True)
def shortest(blocked, reach, points, x0, y0, x1, y1):  # type: ignore[no-untyped-def]
    """A* with edges checked when they might be the best: length, and the path's points, last first."""
    size = points.shape[0]
    cost, came, done = np.full(size, np.inf), np.full(size, -1), np.zeros(size, np.bool_)
    ahead = np.empty(size)
    for i in range(size):
        ahead[i] = math.hypot(x1 - points[i, 0], y1 - points[i, 1])
    best, last, at = np.inf, -1, -1
    if clear_leg(blocked, x0, y0, x1, y1, reach, -1):
        return math.hypot(x1 - x0, y1 - y0), np.empty(0, np.int64)
    while True:
        here, x, y = (0.0, x0, y0) if at < 0 else (cost[at], points[at, 0], points[at, 1])
        if (
            at >= 0
            and here + ahead[at] < best
            and tangent(points, at, x1 - x, y1 - y)
            and clear_leg(blocked, x, y, x1, y1, reach, -1)
        ):
            best, last = here + ahead[at], at
        for j in range(size):
            dx, dy = points[j, 0] - x, points[j, 1] - y
            leg = math.hypot(dx, dy)
            if (
                not done[j]
                and here + leg < cost[j]
                and here + leg + ahead[j] < best
                and (at < 0 or tangent(points, at, dx, dy))
                and tangent(points, j, dx, dy)
                and clear_leg(blocked, x, y, points[j, 0], points[j, 1], reach, -1)
            ):
                cost[j], came[j] = here + leg, at
        at, least = -1, best
        for j in range(size):
            if not done[j] and cost[j] + ahead[j] < least:
                at, least = j, cost[j] + ahead[j]
        if at < 0:
            break
        done[at] = True
    way = []
    while last >= 0:
        way.append(last)
        last = came[last]
    return best, np.array(way, np.int64)


@numba.njit(cache=True)
def tangent(points, i, dx, dy):  # type: ignore[no-untyped-def]
    """Whether a leg leaves the obstacle of a point on one side."""
    first = dx * points[i, 3] - dy * points[i, 2]
    second = dx * points[i, 5] - dy * points[i, 4]
    return first * second >= -1e-9


def reference(grid: Grid, start: Point, goal: Point, clearance_m: float) -> tuple[float, int]:
    """Length in metres of the shortest way with the clearance, inf if there is none, and its legs."""
    reach = clearance_m / grid.spacing_m
    points, owners = corners(grid, reach)
    rows, cols = grid.shape
    on_map = (np.abs(points[:, :2] - (0.5 * (cols - 1), 0.5 * (rows - 1))) <= (0.5 * cols, 0.5 * rows)).all(1)
    points, owners = points[on_map], owners[on_map]
    roomy = [clear_leg(grid.blocked, *p[[0, 1, 0, 1]].tolist(), reach, -1) for p in points]
    points, owners = points[roomy], owners[roomy]
    length, way = shortest(grid.blocked, reach, points, *to_cells(grid, start), *to_cells(grid, goal))
    return length * grid.spacing_m, 1 + int(np.count_nonzero(np.diff(owners[way], prepend=-1)))


@numba.njit
def unflown(blocked, points, reach, radius):  # type: ignore[no-untyped-def]
    """How many corners no arc of the radius fits, or none that keeps the clearance; short legs; near legs."""
    size = points.shape[0]
    rooms, corners, short, near = np.empty(size - 1), 0, 0, 0
    for i in range(size - 1):
        ax, ay, bx, by = points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1]
        rooms[i] = reach
        near += leg_clearance(blocked, ax, ay, bx, by, reach, -1) < reach - 1e-6
        short += 0 < i < size - 2 and math.hypot(bx - ax, by - ay) < radius - 1e-6
    for i in range(1, size - 1):
        corners += not turn_fits(blocked, points, rooms, i, radius, -1)
    return np.array([corners, short, near])


def row(nodes: int, count: int, threshold: float, clearance_m: float) -> str:
    """Sums over pairs: grid, reference, pulled, flyable; lengths and corners."""
    sums, none, gave_up, kept, dearer = np.zeros((4, 4)), 0, 0, 0, []
    lacks = np.zeros(3, dtype=np.int64)
    for seed in range(count):
        grid, start, goal = pair(nodes, threshold, seed)
        best_m, legs = reference(grid, start, goal, clearance_m)
        if not math.isfinite(best_m):
            none += 1
            continue
        results: list[PlanResult] = []
        for shape in ("grid", "pulled", "flyable"):
            options = PlanOptions(shape=shape, clearance_m=clearance_m, turn_radius_m=40.0)
            agents = {1: AgentState(*start, np.pi / 2)}
            results.append(plan_routes(grid, agents, {(0, 0): goal}, {}, options))
        if any(note.code is NoticeCode.ROUTE_NEAR_OBSTACLES for note in results[0].notes):
            gave_up += 1
            dearer.append(best_m / results[0].routes[0].length_m - 1.0)
            continue
        kept += 1
        found = [(best_m, best_m, max(legs - 1, 0), 0)]
        for one in results:
            points = np.vstack((start, one.routes[0].points_m)) / grid.spacing_m
            lack = unflown(grid.blocked, points, clearance_m / grid.spacing_m, 40.0 / grid.spacing_m)
            along_m = grid.spacing_m * float(np.hypot(*np.diff(points, axis=0).T).sum())
            found.append((one.routes[0].length_m, along_m, len(points) - 2, lack[0]))
        sums += found
        lacks += lack
    cells = [f"{nodes}^2, {threshold:.0%}", f"{clearance_m:.0f} m", str(kept), str(gave_up)]
    cells += [f"{np.median(dearer):.1%}" if dearer else "", str(none)]
    for i in (0, 2, 3) if kept else ():
        cells += [f"{1.0 - sums[i, 0] / sums[1, 0]:.1%}", f"{sums[i, 2] / sums[1, 2]:.0%}"]
        cells += [f"{sums[i, 3] / sums[i, 2]:.0%}"] * (i > 0)
    if kept:
        cells += [f"{1.0 - sums[3, 1] / sums[1, 1]:.1%}", f"{lacks[1]}, {lacks[2]}"]
        cells += [f"{sums[i, 0] / sums[0, 0] - 1.0:.1%}" for i in (2, 3)]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--nodes", type=int, default=51)
    arguments = parser.parse_args()
    warm_up()
    names = [
        "nodes, obstacles",
        "clearance",
        "pairs",
        "gives up",
        "for",
        "none",
        "reference: shorter",
        "corners",
    ]
    names += ["pulled: shorter", "corners", "not flown", "flyable, R = 40 m: shorter", "corners", "not flown"]
    names += ["shorter along legs", "legs under R, nearer", "pulled over the reference", "flyable"]
    print("| " + " | ".join(names) + " |\n" + "|---" * len(names) + "|")
    for clearance_m in (0.0, 20.0, 40.0):
        for threshold in (0.05, 0.1, 0.2, 0.3):
            print(row(arguments.nodes, arguments.pairs, threshold, clearance_m), flush=True)


if __name__ == "__main__":
    main()
