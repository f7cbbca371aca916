"""Path of one vehicle over terrain: a search over poses, then shortening."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.model import FloatArray
from gcs.planning.terrain.corner_path import corners_of, shorten_path
from gcs.planning.terrain.pose_search import COURSES, cell_size_m, make_primitives, search_poses
from gcs.planning.terrain.terrain_map import BandCircle, BandPose, Goal, TerrainMap

_GAP_SHARE = 0.02


@dataclass(frozen=True, slots=True)
class Effort:
    """Effort of a search."""

    weight: float
    """Weight of the heuristic: 1 for the shortest paths, more to find one soon."""
    more_expansions: int
    """Expansions beyond the first path."""
    expansions: int
    """Expansions in all."""


@dataclass(frozen=True, eq=False)
class CornerPath:
    """Path of straight legs and turns, inside the band.

    Attributes
    ----------
    points : ndarray, shape (k, 2)
        In metres from node (0, 0) of the band.
    ends : ndarray, shape (2, 7)
        Start and goal as of `shorten_path`.
    length_m : float
    field_m : float
        Length of the path without turns, which is that of the goal's field.
    circle : BandCircle
        Circle that is entered.
    """

    points: FloatArray
    ends: FloatArray
    length_m: float
    field_m: float
    circle: BandCircle


def find_path(
    terrain: TerrainMap, start: BandPose | BandCircle, goal: Goal, effort: Effort
) -> CornerPath | None:
    """Search a path and shorten it; None if none is found."""
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
    pieces, length_m, field_m, _ = search_poses(
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
        np.array([effort.expansions, effort.more_expansions]),
        effort.weight,
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
        return CornerPath(points, ends, length_m, field_m, goal.circles[last])
    return CornerPath(shorter, shorter_ends, shorter_m, field_m, goal.circles[last])


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
