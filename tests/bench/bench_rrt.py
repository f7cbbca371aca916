"""RRT* against the planner's string pulling: length at equal time, and time to equal length.

    python tests/bench/bench_rrt.py

RRT* (Karaman & Frazzoli 2011) with a goal bias of 5 %, rewiring within the shrinking radius, buckets for
neighbours, the same exact sight test, and a straight last leg wherever it is clear: no turns, no clearance;
both solve the same problem. Compiled like ours; CPU time, one thread. "Never" is not within `LIMIT_S`.
"""

from __future__ import annotations

import math
import time

import numpy as np
from bench_visibility import pair
from numba import njit

from gcs.planning.map.line_of_sight import clear_leg, to_cells
from gcs.planning.planner_inputs import AgentState, PlanOptions
from gcs.planning.team_routes import plan_routes
from gcs.planning.warm_up import warm_up

LIMIT_S = 1.0
CHUNK = 250
_BUCKET = 4.0
_STEP = 6.0
_MOST_NEAR = 400


@njit(cache=True)
def grow(blocked, nodes, parent, cost, head, link, count, goal, best, last, draws):  # type: ignore[no-untyped-def]
    """Take a sample for each of `draws` (k, 3) in [0, 1); return node count, best length, its last node."""
    rows, cols = blocked.shape
    free = rows * cols - blocked.sum()
    tall, wide = head.shape
    near, gaps = np.empty(_MOST_NEAR, np.int64), np.empty(_MOST_NEAR)
    for k in range(draws.shape[0]):
        x, y = draws[k, 0] * cols - 0.5, draws[k, 1] * rows - 0.5
        if draws[k, 2] < 0.05:
            x, y = goal[0], goal[1]
        row, col, ring, nearest, gap = int((y + 0.5) / _BUCKET), int((x + 0.5) / _BUCKET), 0, -1, np.inf
        while ring < max(tall, wide) and (ring - 1) * _BUCKET < gap:
            for r in range(max(0, row - ring), min(tall, row + ring + 1)):
                for c in range(max(0, col - ring), min(wide, col + ring + 1)):
                    if max(abs(r - row), abs(c - col)) != ring:
                        continue
                    i = head[r, c]
                    while i >= 0:
                        d = math.hypot(nodes[i, 0] - x, nodes[i, 1] - y)
                        if d < gap:
                            gap, nearest = d, i
                        i = link[i]
            ring += 1
        if gap < 1e-6:
            continue
        if gap > _STEP:
            x = nodes[nearest, 0] + _STEP / gap * (x - nodes[nearest, 0])
            y = nodes[nearest, 1] + _STEP / gap * (y - nodes[nearest, 1])
        if not clear_leg(blocked, nodes[nearest, 0], nodes[nearest, 1], x, y, 0.0, -1):
            continue
        # 2 (1 + 1/2)^(1/2) (free / pi)^(1/2): the least constant that the optimum is reached with.
        radius = min(_STEP, math.sqrt(6.0 * free / math.pi * math.log(count + 1.0) / (count + 1.0)))
        row, col = int((y + 0.5) / _BUCKET), int((x + 0.5) / _BUCKET)
        span, found = math.ceil(radius / _BUCKET), 0
        for r in range(max(0, row - span), min(tall, row + span + 1)):
            for c in range(max(0, col - span), min(wide, col + span + 1)):
                i = head[r, c]
                while i >= 0:
                    d = math.hypot(nodes[i, 0] - x, nodes[i, 1] - y)
                    if d <= radius and found < _MOST_NEAR:
                        near[found], gaps[found] = i, d
                        found += 1
                    i = link[i]
        here = cost[nearest] + math.hypot(nodes[nearest, 0] - x, nodes[nearest, 1] - y)
        origin = nearest
        for n in range(found):
            i = near[n]
            if cost[i] + gaps[n] < here and clear_leg(blocked, nodes[i, 0], nodes[i, 1], x, y, 0.0, -1):
                here, origin = cost[i] + gaps[n], i
        if here + math.hypot(goal[0] - x, goal[1] - y) >= best:
            continue  # no way by here is any better
        new = count
        nodes[new, 0], nodes[new, 1], parent[new], cost[new] = x, y, origin, here
        link[new], head[row, col] = head[row, col], new
        count += 1
        for n in range(found):
            i = near[n]
            if here + gaps[n] < cost[i] - 1e-12 and clear_leg(
                blocked, x, y, nodes[i, 0], nodes[i, 1], 0.0, -1
            ):
                parent[i], cost[i] = new, here + gaps[n]
        if clear_leg(blocked, x, y, goal[0], goal[1], 0.0, -1):
            best, last = here + math.hypot(goal[0] - x, goal[1] - y), new
    # What was rewired upstream shortens the way to the best node, too.
    if last >= 0:
        length, i = math.hypot(goal[0] - nodes[last, 0], goal[1] - nodes[last, 1]), last
        while parent[i] >= 0:
            length += math.hypot(nodes[i, 0] - nodes[parent[i], 0], nodes[i, 1] - nodes[parent[i], 1])
            i = parent[i]
        best = min(best, length)
    return count, best, last


def rrt_star(blocked, start, goal, rng, aim, limit_s):  # type: ignore[no-untyped-def]
    """Grow until the way is no longer than `aim` cells; return [(CPU seconds, length)] as it improves."""
    rows, cols = blocked.shape
    most = 400_000
    nodes, parent = np.empty((most, 2)), np.full(most, -1)
    cost, link = np.zeros(most), np.full(most, -1)
    head = np.full((int(rows / _BUCKET) + 2, int(cols / _BUCKET) + 2), -1)
    nodes[0] = start
    head[int((start[1] + 0.5) / _BUCKET), int((start[0] + 0.5) / _BUCKET)] = 0
    count, best, last, history = 1, math.inf, -1, []
    begin = time.process_time()
    while count < most - CHUNK:
        count, length, last = grow(
            blocked,
            nodes,
            parent,
            cost,
            head,
            link,
            count,
            np.array(goal),
            best,
            last,
            rng.random((CHUNK, 3)),
        )
        spent_s = time.process_time() - begin
        if length < best:
            best = length
            history.append((spent_s, best))
        if best <= aim or spent_s > limit_s:
            break
    return history


def length_at(history: list[tuple[float, float]], at_s: float) -> float:
    return min((length for spent_s, length in history if spent_s <= at_s), default=math.inf)


def row(nodes: int, count: int, threshold: float) -> str:
    ours_s, multiples, never, excess = [], [], 0, {1: [], 10: [], 100: []}
    for seed in range(count):
        grid, start, goal = pair(nodes, threshold, seed)
        options = PlanOptions(shape="pulled")
        times = []
        for _ in range(3):
            plan_routes(type(grid)(grid.origin_m, grid.spacing_m, grid.blocked), {}, {}, {}, options)
            begin = time.process_time()
            result = plan_routes(grid, {1: AgentState(*start)}, {(0, 0): goal}, {}, options)
            times.append(time.process_time() - begin)
        if not result.routes:
            continue
        aim, spent_s = result.routes[0].length_m / grid.spacing_m, float(np.median(times))
        places = to_cells(grid, start), to_cells(grid, goal)
        history = rrt_star(grid.blocked, *places, np.random.default_rng(seed), aim, LIMIT_S)
        reached = [at_s for at_s, length in history if length <= aim + 1e-9]
        never += not reached
        ours_s.append(spent_s)
        multiples += [reached[0] / spent_s] if reached else []
        for times_ours, found in excess.items():
            found.append(length_at(history, times_ours * spent_s) / aim - 1.0)
    cells = [f"{nodes}^2, {threshold:.0%}", f"{1e3 * np.median(ours_s):.2f}"]
    cells += [f"{np.median(found):+.1%} ({np.isinf(found).sum()})" for found in excess.values()]
    cells += [f"{np.median(multiples):.0f}" if multiples else "-", f"{never} of {len(ours_s)}"]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    warm_up()
    rrt_star(np.zeros((9, 9), dtype=bool), (1.0, 1.0), (7.0, 7.0), np.random.default_rng(0), 0.0, 0.1)
    print(
        "| nodes, obstacles | ours, ms | RRT* longer at equal time (none found) | at 10 times | at 100 times",
        end="",
    )
    print(f" | multiple of our time to equal length, where reached | not within {LIMIT_S:g} s CPU |")
    print("|---" * 7 + "|")
    for nodes, count in ((51, 6), (151, 3)):
        for threshold in (0.02, 0.1, 0.2, 0.3):
            print(row(nodes, count, threshold), flush=True)


if __name__ == "__main__":
    main()
