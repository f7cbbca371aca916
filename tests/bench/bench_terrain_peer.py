"""RRT* over Dubins airplane paths between the loiter circles of `terrain_pairs`, beside the terrain planner.

    python tests/bench/bench_terrain_peer.py FILE --peer PROGRAM [--pairs FIRST LAST] [--limit-s 60]
    python tests/bench/bench_terrain_peer.py FILE

FILE collects the results of the peer, a JSON object with one entry for each pair; pairs that it has are not
run again. Without `--peer` the table of both planners is printed for the pairs in FILE. PROGRAM is built in
`terrain_peer` from OMPL 2.0 (see the README there). Times are CPU seconds of one process. Not counted are
reading the elevation and what the terrain planner prepares once for a map.

Both planners keep the band of `terrain_pairs`, the same turn radius and path angle, and minimise the length
of the projection on the ground. RRT* leaves the circle at the start on one of 72 tangents: its path is up to
12 m longer than from the best tangent. It enters the circle at the goal on any tangent. It checks the band
every 5 m and keeps no distance from its limits; the terrain planner keeps some decimetres. The paths of both
planners are then measured every metre, by the same function.
"""

from __future__ import annotations

import argparse
import json
import math
import struct
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
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

from gcs.model import FloatArray
from gcs.planning.terrain.band import Vertical, make_band
from gcs.planning.terrain.goal import goal_at
from gcs.planning.terrain.route import plan_route
from gcs.planning.terrain.terrain_map import BandCircle, TerrainMap, make_terrain_map
from gcs.terrain.elevation_grid import Elevation

RANGE_M = 600.0
"""Longest step of RRT*, as published."""


def write_ground(elevation: Elevation, path: Path) -> None:
    """Write the elevation as the peer reads it."""
    heights = elevation.heights_msl_m
    head = struct.pack("<2i3d", *heights.shape, *elevation.origin_m, elevation.spacing_m)
    path.write_bytes(head + heights.astype("<f8").tobytes())


def run_peer(
    program: Path, ground: Path, pair: Pair, seed: int, limit_s: float, range_m: float, sampler: str
) -> dict[str, Any]:
    """Return what the peer prints."""
    places = [
        value for end in (pair.start, pair.goal) for value in (end.east_m, end.north_m, end.height_msl_m)
    ]
    arguments = [program, ground, *places, limit_s, seed, range_m, sampler]
    done = subprocess.run([str(argument) for argument in arguments], check=True, capture_output=True)
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def off_circle(circle: Circle, end_m: FloatArray, next_m: FloatArray) -> tuple[float, float]:
    """Return how far the end of a path is from the circle, and its direction from the tangent (degrees).

    On an arc the step of 1 m to the next place is a chord, 0.4 degrees from the tangent.
    """
    out = end_m[:2] - (circle.east_m, circle.north_m)
    along = (next_m - end_m)[:2]
    sine = abs(out @ along) / np.linalg.norm(out) / np.linalg.norm(along)
    off_m = abs(np.linalg.norm(out) - TURN_RADIUS_M) + abs(end_m[2] - circle.height_msl_m)
    return float(off_m), math.degrees(math.asin(sine))


def check(elevation: Elevation, pair: Pair, path_m: FloatArray) -> dict[str, float]:
    """Measure a path in steps of about 1 m: its length, and the worst of each limit.

    Negative metres outside the band are inside it; gradient and curvature are shares of what is allowed.

    Parameters
    ----------
    path_m : ndarray, shape (k, 3)
        East, north, height above mean sea level.
    """
    agl_m = path_m[:, 2] - elevation.heights_at(path_m[:, :2])
    agl_m[np.isnan(agl_m)] = math.inf  # off the elevation
    is_new = np.linalg.norm(np.diff(path_m[:, :2], axis=0), axis=1) > 0.01
    path_m = path_m[np.concatenate(([True], is_new))]
    steps_m = np.diff(path_m, axis=0)
    along_m = np.linalg.norm(steps_m[:, :2], axis=1)
    courses = np.arctan2(steps_m[:, 1], steps_m[:, 0])
    turns = np.abs((np.diff(courses) + math.pi) % (2.0 * math.pi) - math.pi)
    chords_m = 0.5 * (along_m[1:] + along_m[:-1])
    off_ends = off_circle(pair.start, *path_m[:2]), off_circle(pair.goal, *path_m[:-3:-1])
    return {
        "length_m": float(along_m.sum()),
        "outside_band_m": float(np.maximum(MIN_AGL_M - agl_m, agl_m - MAX_AGL_M).max()),
        "gradient": float(np.abs(steps_m[:, 2] / along_m).max() / MAX_GRADIENT),
        "curvature": float((turns / chords_m).max() * TURN_RADIUS_M),
        "off_ends_m": max(off_m for off_m, _ in off_ends),
        "off_tangent_deg": max(off_deg for _, off_deg in off_ends),
    }


def sample_route(points_m: FloatArray, heights_msl_m: FloatArray) -> FloatArray:
    """Return the places (k, 3) of a route, about 1 m apart: turns of the radius between straight legs.

    The heights of the waypoints are those in the middle of their turns, linear along the path between them.
    """
    courses = np.arctan2(*np.diff(points_m, axis=0).T[::-1])
    turns = np.zeros(len(points_m))
    turns[1:-1] = (np.diff(courses) + math.pi) % (2.0 * math.pi) - math.pi
    backs_m = TURN_RADIUS_M * np.tan(0.5 * np.abs(turns))
    lines_m = np.linalg.norm(np.diff(points_m, axis=0), axis=1) - backs_m[:-1] - backs_m[1:]
    if lines_m.min() < -0.01:
        raise ValueError(f"turns overlap by {-lines_m.min():.2f} m")
    pieces = [points_m[:1]]
    stations_m = [0.0]
    for i, course in enumerate(courses):
        ahead = np.array([math.cos(course), math.sin(course)])
        count = math.ceil(max(lines_m[i], 0.0))
        along_m = backs_m[i] + lines_m[i] * np.arange(1, count + 1) / max(count, 1)
        pieces.append(points_m[i] + along_m[:, None] * ahead)
        turn = float(turns[i + 1])
        arc_m = TURN_RADIUS_M * abs(turn)
        stations_m.append(stations_m[-1] + 0.5 * TURN_RADIUS_M * abs(turns[i]) + lines_m[i] + 0.5 * arc_m)
        if turn == 0.0:
            continue
        left = math.copysign(1.0, turn) * np.array([-ahead[1], ahead[0]])
        angles = np.linspace(0.0, abs(turn), math.ceil(arc_m) + 1)[1:, None]
        begin = points_m[i + 1] - backs_m[i + 1] * ahead
        pieces.append(begin + TURN_RADIUS_M * (np.sin(angles) * ahead + (1.0 - np.cos(angles)) * left))
    places_m = np.concatenate(pieces)
    # Steps on arcs are chords: their stations are stretched to the length of the path.
    chords_m = np.concatenate(([0.0], np.linalg.norm(np.diff(places_m, axis=0), axis=1).cumsum()))
    heights = np.interp(chords_m * stations_m[-1] / chords_m[-1], stations_m, heights_msl_m)
    return np.column_stack((places_m, heights))


def plan_ours(terrain: TerrainMap, elevation: Elevation, pair: Pair) -> dict[str, Any]:
    """Return CPU seconds and the measures of the terrain planner's route, None without one."""
    start, goal = (
        BandCircle(end.east_m, end.north_m, TURN_RADIUS_M, end.height_msl_m, end.height_msl_m)
        for end in (pair.start, pair.goal)
    )
    begin = time.process_time()
    aim = goal_at(terrain, (goal,))
    route = plan_route(terrain, start, aim) if aim is not None else None
    spent_s = time.process_time() - begin
    if route is None:
        return {"cpu_s": spent_s, "check": None}
    path_m = sample_route(route.points_m, route.heights_msl_m)
    return {"cpu_s": spent_s, "check": check(elevation, pair, path_m)}


def spread(values: list[float], form: str) -> str:
    """Return median, 90th percentile and greatest of some values."""
    return ", ".join(format(value, form) for value in (*np.quantile(values, (0.5, 0.9)), max(values)))


def print_table(file: Path) -> None:
    """Print the results of both planners on the pairs in a file."""
    theirs = {int(i): found for i, found in json.loads(file.read_text()).items()}
    elevation = load_elevation()
    terrain = make_terrain_map(
        make_band(elevation, MIN_AGL_M, MAX_AGL_M), Vertical(MAX_GRADIENT, MAX_GRADIENT), TURN_RADIUS_M
    )
    plan_ours(terrain, elevation, pairs()[0])  # compiles
    ours = {i: plan_ours(terrain, elevation, pairs()[i]) for i in sorted(theirs)}
    print("| pair | ours: s | m | RRT*: first, s | first, m | best, m | ours / best |")
    print("|---" * 7 + "|")
    for i, found in ours.items():
        mine = found["check"]["length_m"] if found["check"] else math.nan
        first = theirs[i]["solutions"][0] if theirs[i]["check"] else (math.nan, math.nan)
        best = theirs[i]["check"]["length_m"] if theirs[i]["check"] else math.nan
        print(
            f"| {i} | {found['cpu_s']:.3f} | {mine:.0f} | {first[0]:.2f} | {first[1]:.0f} | {best:.0f} "
            f"| {mine / best:.3f} |"
        )
    both = [i for i in ours if ours[i]["check"] and theirs[i]["check"]]
    ratios = [ours[i]["check"]["length_m"] / theirs[i]["check"]["length_m"] for i in both]
    firsts_s = [theirs[i]["solutions"][0][0] for i in both]
    ours_s = [ours[i]["cpu_s"] for i in both]
    print(f"\n{len(ours)} pairs; median, 90 % and most where both found a path.")
    for name, results in (("ours", ours), ("RRT*", theirs)):
        print(f"Found by {name}: {sum(found['check'] is not None for found in results.values())}")
    print(f"Length, ours / RRT*: {spread(ratios, '.3f')}; above 1.02 in {sum(r > 1.02 for r in ratios)}")
    print(f"CPU seconds, ours: {spread(ours_s, '.3f')}; in all {sum(ours_s):.1f}")
    print(f"CPU seconds to the first path of RRT*: {spread(firsts_s, '.2f')}; in all {sum(firsts_s):.1f}")
    quick = sum(mine <= 0.1 * first for mine, first in zip(ours_s, firsts_s, strict=True))
    print(f"Ours within a tenth of that: {quick} of {len(both)}")
    for name, results in (("ours", ours), ("RRT*", theirs)):
        checks = [found["check"] for found in results.values() if found["check"]]
        worst = {key: max(one[key] for one in checks) for key in checks[0] if key != "length_m"}
        print(f"Worst, {name}: " + ", ".join(f"{key} {value:.3f}" for key, value in worst.items()))


def collect(options: argparse.Namespace) -> None:
    """Run the peer on the pairs that the file does not have."""
    elevation = load_elevation()
    results = json.loads(options.file.read_text()) if options.file.exists() else {}
    with tempfile.TemporaryDirectory() as folder:
        ground = Path(folder) / "ground.bin"
        write_ground(elevation, ground)
        for i in range(*options.pairs):
            if str(i) in results:
                continue
            pair = pairs()[i]
            found = run_peer(options.peer, ground, pair, i, options.limit_s, options.range_m, options.sampler)
            path_m = np.array(found.pop("path_m"))
            found["check"] = check(elevation, pair, path_m) if len(path_m) else None
            results[str(i)] = found
            options.file.write_text(json.dumps(results, indent=1))
            first = found["solutions"][0] if found["solutions"] else None
            print(i, f"iterations {found['iterations']}, first {first}, {found['check']}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--peer", type=Path)
    parser.add_argument("--pairs", type=int, nargs=2, default=(0, 30), metavar=("FIRST", "LAST"))
    parser.add_argument("--limit-s", type=float, default=60.0)
    parser.add_argument("--range-m", type=float, default=RANGE_M)
    parser.add_argument("--sampler", choices=("band", "box"), default="band")
    options = parser.parse_args()
    if options.peer:
        collect(options)
    else:
        print_table(options.file)


if __name__ == "__main__":
    main()
