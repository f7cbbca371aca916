"""Routes inside a flight band over the Davos tile: found, time, length; and the plan of a whole swarm.

    python tests/bench/bench_terrain_routes.py [pairs]

The pairs are those of `terrain_pairs`. Each route includes the field of its goal, and is checked every 0.5 m:
inside the band, gradients kept, ends kept. The swarm has 50 vehicles on circles
and 50 targets anywhere, with a tracking margin of 10 m. CPU time, one thread.
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np
from scipy.optimize import linear_sum_assignment
from terrain_pairs import (
    MAX_AGL_M,
    MAX_GRADIENT,
    MIN_AGL_M,
    TURN_RADIUS_M,
    Circle,
    Pair,
    load_elevation,
    pairs,
)

from gcs.planning.terrain.band import FlightBand, Vertical, make_band
from gcs.planning.terrain.goal import cost_matrix, goal_at
from gcs.planning.terrain.height_profile import sample_path
from gcs.planning.terrain.loiter_circles import CircleMap, circle_at, goal_at_target, make_circle_map
from gcs.planning.terrain.route import TerrainRoute, plan_route
from gcs.planning.terrain.terrain_map import BandCircle, TerrainMap, make_terrain_map

VERTICAL = Vertical(MAX_GRADIENT, MAX_GRADIENT)
SWARM = 50
SWARM_MARGIN_M = 10.0
REACH_M = 60.0


def end_of(circle: Circle) -> BandCircle:
    """Return a circle that is left or entered in either direction, at its height."""
    return BandCircle(circle.east_m, circle.north_m, TURN_RADIUS_M, circle.height_msl_m, circle.height_msl_m)


def route_between(terrain: TerrainMap, pair: Pair) -> TerrainRoute | None:
    """Return the route between the circles of a pair."""
    return plan_route(terrain, end_of(pair.start), goal_at(terrain, [end_of(pair.goal)]))


def departure_m(band: FlightBand, route: TerrainRoute, pair: Pair) -> float:
    """Return how far a route leaves the band, or misses the height of one of its circles."""
    places, _, knots = sample_path(np.array(route.points_m), TURN_RADIUS_M, 0.5)
    along = places[:, 2]
    heights = np.interp(along, along[knots], route.heights_msl_m)
    assert (np.abs(np.diff(route.heights_msl_m) / np.diff(along[knots])) < MAX_GRADIENT + 1e-6).all()
    for circle, place in ((pair.start, places[0]), (pair.goal, places[-1])):
        assert abs(math.dist((circle.east_m, circle.north_m), place[:2]) - TURN_RADIUS_M) < 1e-6
    limits = band.limits_at(places[:, :2])
    inside = float(np.maximum(limits[:, 0] - heights, heights - limits[:, 1]).max())
    ends = (abs(heights[0] - pair.start.height_msl_m), abs(heights[-1] - pair.goal.height_msl_m))
    return max(inside, *ends)


def bench_pairs(count: int) -> None:
    """Print what is found of the pairs, how fast, and how long it is."""
    begin = time.process_time()
    band = make_band(load_elevation(), MIN_AGL_M, MAX_AGL_M)
    terrain = make_terrain_map(band, VERTICAL, TURN_RADIUS_M)
    route_between(terrain, pairs()[0])
    print(f"kernels loaded, {time.process_time() - begin:.2f} s")
    begin = time.process_time()
    terrain = make_terrain_map(make_band(load_elevation(), MIN_AGL_M, MAX_AGL_M), VERTICAL, TURN_RADIUS_M)
    print(f"band and moves of the tile: {1e3 * (time.process_time() - begin):.0f} ms")
    times_ms = []
    lengths_m = []
    points = []
    worst_m = -math.inf
    for number, pair in enumerate(pairs()[:count]):
        begin = time.process_time()
        route = route_between(terrain, pair)
        times_ms.append(1e3 * (time.process_time() - begin))
        if route is None:
            print(f"pair {number}: no route")
            continue
        lengths_m.append(route.length_m)
        points.append(len(route.points_m))
        worst_m = max(worst_m, departure_m(band, route, pair))
    median, p99, most = np.percentile(times_ms, [50, 99, 100])
    print(f"found {len(lengths_m)} of {count}; {median:.1f} ms median, {p99:.1f} ms p99, {most:.1f} ms most")
    print(
        f"mean length {np.mean(lengths_m):.1f} m; {np.median(points):.0f} points median, {max(points)} most"
    )
    print(f"farthest outside the band, or from a circle's height: {worst_m:.2f} m")


def _random_ends(circles: CircleMap, rng: np.random.Generator) -> list[BandCircle]:
    extent_m = np.array(circles.heights_msl_m.shape[1::-1]) * circles.band.spacing_m
    found: list[BandCircle] = []
    while len(found) < SWARM:
        east, north = (rng.random(2) * extent_m).tolist()
        circle = circle_at(circles, (east, north))
        if circle is not None:
            found.append(circle)
    return found


def bench_swarm() -> None:
    """Print the time of a whole plan: cost matrix, assignment, routes."""
    band = make_band(load_elevation(), MIN_AGL_M, MAX_AGL_M, margin_m=SWARM_MARGIN_M)
    terrain = make_terrain_map(band, VERTICAL, TURN_RADIUS_M)
    circles = make_circle_map(band, TURN_RADIUS_M)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        starts = _random_ends(circles, rng)
        extent_m = np.array(band.surfaces_msl_m.shape[1::-1]) * band.spacing_m - 200.0
        targets = [tuple(row) for row in (100.0 + rng.random((SWARM, 2)) * extent_m).tolist()]
        begin = time.process_time()
        goals = [goal_at_target(terrain, circles, target, REACH_M) for target in targets]
        costs = cost_matrix(terrain, starts, goals)
        costed = time.process_time()
        rows, cols = linear_sum_assignment(np.where(np.isfinite(costs), costs, 1e9))
        goals_of = [goals[j] for j in cols]
        routes = [
            None if goal is None else plan_route(terrain, starts[i], goal)
            for i, goal in zip(rows, goals_of, strict=True)
        ]
        end = time.process_time()
        around = sum(goal is not None and goal.place_m is None for goal in goals)
        found = sum(route is not None for route in routes)
        print(
            f"{SWARM} x {SWARM}, seed {seed}: {end - begin:.2f} s, of that {costed - begin:.2f} s for the"
            f" cost matrix; {found} routes; {around} targets have a circle around them"
        )


if __name__ == "__main__":
    bench_pairs(int(sys.argv[1]) if len(sys.argv) > 1 else len(pairs()))
    bench_swarm()
