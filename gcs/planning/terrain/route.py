"""Terrain route of one vehicle: waypoints with heights from a start to a loiter circle.

1. `pose_search` finds a path, with several weights of its heuristic; `corner_path` shortens each.
2. `height_profile` gives the shortest one heights near the wanted share of the band.
3. Corners that the heights do not need are left out. A turn in which the terrain bends more than one
   waypoint can follow is split in two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.model import FloatArray, IntArray, read_only
from gcs.planning.terrain.band import NO_BAND_M, FlightBand
from gcs.planning.terrain.height_profile import choose_knots, plan_heights, sample_path
from gcs.planning.terrain.path_search import CornerPath, Effort, find_path
from gcs.planning.terrain.terrain_map import BandCircle, BandPose, Goal, TerrainMap

_EFFORTS = (
    Effort(1.1, 2_000, 30_000),
    Effort(1.3, 1_000, 20_000),
    Effort(1.02, 10_000, 15_000),
    Effort(1.0, 10_000, 10_000),
)
_PASSING_EFFORTS = (Effort(1.2, 1_000, 20_000), Effort(3.0, 2_000, 60_000))
_SHORT_SHARE = 1.01
"""Length, as a multiple of that without turns, from which no other search is worth its time."""
_MORE_EFFORTS = (Effort(3.0, 2_000, 60_000), Effort(1.4, 2_000, 100_000))
"""Searches where the others found no route, one after the other."""
_QUICK_EFFORTS = (Effort(1.2, 1_000, 20_000),)
_PROFILE_STEP_M = 1.0
_SPARE_M = 6.0
"""Distance that profiles keep from floor and ceiling, so that they need fewer waypoints."""
_TRIAL_STEP_M = 4.0
_FIT_M = 1e-6
_SLIGHT_M = (40.0, 15.0, 6.0, 2.0, 0.5)
"""Distance of a corner from the line past it up to which it is left out, if that is possible."""
_MAX_SPLITS = 60
_MIN_SPLIT_RAD = 0.15
"""Smallest turn that is split for its corner: the next corners would be no farther inside."""


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
    terrain: TerrainMap,
    start: BandPose | BandCircle,
    goal: Goal,
    share: float = 0.5,
    *,
    with_all_corners: bool = False,
    is_quick: bool = False,
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
    with_all_corners : bool
        True if corners that the heights do not need stay, and heights need no room beside a line.
    is_quick : bool
        True for one short search only.
    """
    paths: list[CornerPath] = []
    efforts = _EFFORTS if goal.place_m is None else _PASSING_EFFORTS
    for effort in _QUICK_EFFORTS if is_quick else efforts:
        path = find_path(terrain, start, goal, effort)
        if path is not None:
            paths.append(path)
            if goal.place_m is not None or path.length_m <= _SHORT_SHARE * path.field_m:
                break
    for path in sorted(paths, key=lambda path: path.length_m):
        route = _with_heights(terrain, path, goal, share, with_all_corners)
        if route is not None:
            return route
    for effort in () if is_quick else _MORE_EFFORTS:
        path = find_path(terrain, start, goal, effort)
        route = None if path is None else _with_heights(terrain, path, goal, share, with_all_corners)
        if route is not None:
            return route
    return None


def _with_heights(
    terrain: TerrainMap, path: CornerPath, goal: Goal, share: float, with_all_corners: bool
) -> TerrainRoute | None:
    """Return a path with a height at each waypoint; None if it leaves the band."""
    points = _with_corners_inside(terrain.profile_band, path.points, terrain.turn_radius_m)
    fewer = points if with_all_corners else _without_slight_corners(terrain, path, goal, points)
    spare_m = 0.0 if with_all_corners else _SPARE_M
    route = _along(terrain, path, fewer, share, spare_m)
    if route is not None or len(fewer) == len(points):
        return route
    return _along(terrain, path, points, share, spare_m)


def _without_slight_corners(
    terrain: TerrainMap, path: CornerPath, goal: Goal, points: FloatArray
) -> FloatArray:
    """Return a path without corners that are hardly aside of the line past them, if heights remain for it.

    The first and the last leg keep their courses, and the corner next to a place that is passed stays.
    """
    kept = np.zeros(len(points), dtype=np.bool_)
    kept[[0, 1, -2, -1]] = True
    if goal.place_m is not None:
        places_m = points + np.array(terrain.profile_band.origin_m)
        kept[np.argmin(np.hypot(*(places_m - goal.place_m).T))] = True
    at = np.arange(len(points))
    for aside_m in _SLIGHT_M:
        slight = _asides_m(points[at]) < aside_m
        tried = [one for one in at[1:-1][slight].tolist() if not kept[one]]
        # First every other one, since the corners beside a dropped one are farther aside then.
        for some in (tried[::2], tried[1::2]):
            at = _without(terrain, path, points, at, some)
    return points[at]


def _without(
    terrain: TerrainMap, path: CornerPath, points: FloatArray, at: IntArray, dropped: list[int]
) -> IntArray:
    """Return the indices of points without as many of some as the heights allow, tried in halves."""
    if not dropped:
        return at
    fewer = at[~np.isin(at, dropped)]
    if _has_heights(terrain, path, points[fewer]):
        return fewer
    half = len(dropped) // 2
    if not half:
        return at
    return _without(
        terrain, path, points, _without(terrain, path, points, at, dropped[:half]), dropped[half:]
    )


def _asides_m(points: FloatArray) -> FloatArray:
    """Return the distance of each inner point from the line past it."""
    along = points[2:] - points[:-2]
    off = points[1:-1] - points[:-2]
    asides_m: FloatArray = np.abs(off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0])
    return asides_m / np.maximum(np.hypot(*along.T), 1e-9)


def _has_heights(terrain: TerrainMap, path: CornerPath, points: FloatArray) -> bool:
    """Return True if the turns at points fit on their legs, and the path has heights inside the band."""
    radius_m = terrain.turn_radius_m
    legs = np.diff(points, axis=0)
    tangents_m = np.zeros(len(points))
    tangents_m[1:-1] = radius_m * np.tan(0.5 * _turns(legs))
    if (np.hypot(*legs.T) < tangents_m[:-1] + tangents_m[1:] - _FIT_M).any():
        return False
    band = terrain.profile_band
    places, _, _ = sample_path(points, radius_m, _TRIAL_STEP_M)
    heights, _ = plan_heights(band.surfaces_msl_m, band.spacing_m, terrain.rates, places, path.ends, 0.5, 0.0)
    return bool(heights.size)


def _turns(legs: FloatArray) -> FloatArray:
    """Return the angles between legs, not negative."""
    courses = np.arctan2(legs[:, 1], legs[:, 0])
    turns: FloatArray = np.abs((np.diff(courses) + math.pi) % (2.0 * math.pi) - math.pi)
    return turns


def _along(
    terrain: TerrainMap, path: CornerPath, points: FloatArray, share: float, spare_m: float
) -> TerrainRoute | None:
    """Return the route along points, with more of them where the band needs it; None without heights."""
    band = terrain.profile_band
    for _ in range(_MAX_SPLITS):
        places, corners, middles = sample_path(points, terrain.turn_radius_m, _PROFILE_STEP_M)
        heights, limits = plan_heights(
            band.surfaces_msl_m, band.spacing_m, terrain.rates, places, path.ends, share, spare_m
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


def _with_corners_inside(band: FlightBand, points: FloatArray, radius_m: float) -> FloatArray:
    """Return a path whose corners are split where they lie off the map, or over blocked cells.

    Its turns are inside, and stay the same; but no waypoint of a mission may lie outside.
    """
    for _ in range(_MAX_SPLITS):
        inner = band.limits_at(points + np.array(band.origin_m))[1:-1]
        turns = _turns(np.diff(points, axis=0))
        turns[inner[:, 0] < NO_BAND_M] = 0.0
        if not turns.size or turns.max() < _MIN_SPLIT_RAD:
            break
        points = _split_corner(points, int(np.argmax(turns)) + 1, radius_m)
    return points


def _split_corner(points: FloatArray, i: int, radius_m: float) -> FloatArray:
    """Return a path with a corner split in two around the same arc."""
    ux, uy = (points[i] - points[i - 1]).tolist()
    vx, vy = (points[i + 1] - points[i]).tolist()
    turn = math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)
    back_m = radius_m * (math.tan(0.5 * abs(turn)) - math.tan(0.25 * abs(turn)))
    before = points[i - 1] - points[i]
    behind = points[i + 1] - points[i]
    pair = points[i] + back_m * np.stack((before / np.hypot(*before), behind / np.hypot(*behind)))
    return np.concatenate((points[:i], pair, points[i + 1 :]))
