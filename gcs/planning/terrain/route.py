"""Route of one vehicle over terrain: waypoints with heights from a start to a loiter circle.

1. `pose_search` finds a path, with several weights of its heuristic; `corner_path` shortens each.
2. `height_profile` gives the shortest one heights near the wanted share of the band.
3. A turn in which the terrain bends more than one waypoint can follow is split in two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.model import FloatArray, read_only
from gcs.planning.terrain.corner_path import corners_of, shorten_path
from gcs.planning.terrain.height_profile import choose_knots, plan_heights, sample_path
from gcs.planning.terrain.pose_search import COURSES, cell_size_m, make_primitives, search_poses
from gcs.planning.terrain.terrain_map import BandCircle, BandPose, Goal, TerrainMap

_WEIGHTS = ((1.1, 2_000, 50_000), (1.02, 20_000, 20_000))
"""Searches: weight of the heuristic, expansions beyond the first path and in all."""
_MORE_WEIGHTS = ((1.2, 2_000, 100_000), (1.4, 1_000, 300_000), (1.05, 20_000, 300_000))
"""Searches where the others found no path, one after the other."""
_GAP_SHARE = 0.02
_PROFILE_STEP_M = 1.0
_MAX_SPLITS = 60


@dataclass(frozen=True, eq=False)
class TerrainRoute:
    """Route inside the flight band.

    Attributes
    ----------
    points_m : ndarray, shape (k, 2)
        East and north: where the route begins, then its waypoints. The last one is on the loiter circle.
    heights_msl_m : ndarray, shape (k,)
        Heights of the points, linear along the path between them.
    circle : BandCircle
        Loiter circle at the end, at the height of the last point.
    length_m : float
        Length along legs and turns.
    """

    points_m: FloatArray
    heights_msl_m: FloatArray
    circle: BandCircle
    length_m: float


def plan_route(
    terrain: TerrainMap, start: BandPose | BandCircle, goal: Goal, share: float = 0.5
) -> TerrainRoute | None:
    """Return a short route inside the band; None if none is found.

    Parameters
    ----------
    terrain : TerrainMap
    start : BandPose or BandCircle
        A start below the floor climbs into the band at once, one above the ceiling descends.
    goal : Goal
    share : float
        Wanted share of the band, from 0 at its floor to 1 at its ceiling.
    """
    for weights in (_WEIGHTS, *((weight,) for weight in _MORE_WEIGHTS)):
        paths = [path for weight in weights if (path := _path(terrain, start, goal, weight)) is not None]
        for path in sorted(paths, key=lambda path: path.length_m):
            route = _with_heights(terrain, path, share)
            if route is not None:
                return route
    return None


@dataclass(frozen=True, eq=False)
class _CornerPath:
    """Points in metres from node (0, 0), and the ends as of `shorten_path`."""

    points: FloatArray
    ends: FloatArray
    length_m: float
    circle: BandCircle


def _path(
    terrain: TerrainMap, start: BandPose | BandCircle, goal: Goal, weight: tuple[float, int, int]
) -> _CornerPath | None:
    """Search a path and shorten it."""
    band = terrain.search_band
    radius_m = terrain.turn_radius_m
    step_m = 0.5 * band.spacing_m
    starts, course0, sides = _start_poses(terrain, start)
    size_m = np.array(band.surfaces_msl_m.shape[:2]) * band.spacing_m
    samples, shapes = make_primitives(radius_m, step_m)
    goal_ends = [_end_row(terrain, circle) for circle in goal.circles]
    via = np.array([0.0, 0.0, -1.0])
    if goal.place_m is not None:
        via = np.array([*np.subtract(goal.place_m, band.origin_m), goal.reach_m])
    pieces, length_m, _ = search_poses(
        band.surfaces_msl_m,
        np.array([band.spacing_m, goal.spacing_m, cell_size_m(radius_m, size_m), radius_m, step_m]),
        terrain.rates,
        goal.counts,
        goal.labels,
        samples,
        shapes,
        starts,
        course0,
        via,
        np.array([[*end[[0, 1, 2, 4, 5]], end[3] * end[6]] for end in goal_ends]),
        np.array([weight[2], weight[1]]),
        weight[0],
        _GAP_SHARE,
    )
    if not math.isfinite(length_m):
        return None
    first = int(pieces[0, 0])
    last = int(pieces[0, 1])
    begin = (starts[first, 0], starts[first, 1], course0 + 2.0 * math.pi * starts[first, 2] / COURSES)
    ends = np.stack((_end_row(terrain, start, sides[first]), goal_ends[last]))
    ends[1, 3] = pieces[0, 2]
    points, pin = corners_of(pieces[1:], begin, radius_m)
    frame = np.array([band.spacing_m, radius_m, 0.25 * band.spacing_m])
    shorter, shorter_ends, shorter_m, _ = shorten_path(
        terrain.shortening_band.surfaces_msl_m, frame, terrain.rates, points, ends, pin, via
    )
    if not math.isfinite(shorter_m):
        return _CornerPath(points, ends, length_m, goal.circles[last])
    return _CornerPath(shorter, shorter_ends, shorter_m, goal.circles[last])


def _end_row(terrain: TerrainMap, end: BandPose | BandCircle, side: float = 1.0) -> FloatArray:
    """Return an end as of `shorten_path`."""
    east, north = terrain.band.origin_m
    radius_m = end.radius_m if isinstance(end, BandCircle) else 0.0
    is_fixed = 0.0
    if isinstance(end, BandCircle) and end.is_clockwise is not None:
        side = -1.0 if end.is_clockwise else 1.0
        is_fixed = 1.0
    return np.array(
        [end.east_m - east, end.north_m - north, radius_m, side, end.low_msl_m, end.high_msl_m, is_fixed]
    )


def _start_poses(terrain: TerrainMap, start: BandPose | BandCircle) -> tuple[FloatArray, float, list[float]]:
    """Return the poses where a search begins (`search_poses`), the first course, and the side of each."""
    x, y, radius_m, only_side, low, high, is_fixed = _end_row(terrain, start).tolist()
    if isinstance(start, BandPose):
        course0 = 0.0 if start.course_rad is None else 0.5 * math.pi - start.course_rad
        count = COURSES if start.course_rad is None else 1
        return np.array([(x, y, k, low, high) for k in range(count)]), course0, [1.0] * count
    rows = []
    sides = []
    for k in range(COURSES):
        course = 2.0 * math.pi * k / COURSES
        for side in (only_side,) if is_fixed else (1.0, -1.0):
            rows.append(
                (
                    x + side * radius_m * math.sin(course),
                    y - side * radius_m * math.cos(course),
                    k,
                    low,
                    high,
                )
            )
            sides.append(side)
    return np.array(rows), 0.0, sides


def _with_heights(terrain: TerrainMap, path: _CornerPath, share: float) -> TerrainRoute | None:
    """Return a path with a height at each waypoint; None if it leaves the band."""
    band = terrain.profile_band
    points = path.points
    for _ in range(_MAX_SPLITS):
        places, corners, middles = sample_path(points, terrain.turn_radius_m, _PROFILE_STEP_M)
        heights, limits = plan_heights(
            band.surfaces_msl_m, band.spacing_m, terrain.rates, places, path.ends, share
        )
        if not heights.size:
            return None
        knots, sharp = choose_knots(places[:, 2], corners, heights, limits, middles.astype(np.int64))
        if sharp < 0:
            break
        points = _split_corner(points, sharp, terrain.turn_radius_m)
    else:
        return None
    waypoints = places[knots, :2]
    waypoints[np.searchsorted(knots, middles)] = points
    end_msl_m = float(heights[-1])
    circle = path.circle
    is_clockwise = bool(path.ends[1, 3] < 0.0)
    return TerrainRoute(
        read_only(waypoints + np.array(band.origin_m)),
        read_only(heights[knots]),
        BandCircle(circle.east_m, circle.north_m, circle.radius_m, end_msl_m, end_msl_m, is_clockwise),
        float(places[-1, 2]),
    )


def _split_corner(points: FloatArray, i: int, radius_m: float) -> FloatArray:
    """Return a path with a corner split in two around the same arc."""
    turn = math.atan2(
        float(np.cross(points[i] - points[i - 1], points[i + 1] - points[i])),
        float((points[i] - points[i - 1]) @ (points[i + 1] - points[i])),
    )
    back_m = radius_m * (math.tan(0.5 * abs(turn)) - math.tan(0.25 * abs(turn)))
    before = points[i - 1] - points[i]
    behind = points[i + 1] - points[i]
    pair = points[i] + back_m * np.stack((before / np.hypot(*before), behind / np.hypot(*behind)))
    return np.concatenate((points[:i], pair, points[i + 1 :]))
