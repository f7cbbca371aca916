"""Goals of terrain routes: loiter circles, places to pass before them, lengths of paths to them.

A goal belongs to a target and serves all vehicles: its fields (`height_field`) are the heuristic of their
searches and a column of the cost matrix.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gcs.model import Float32Array, FloatArray, Int32Array
from gcs.planning.map.grid import Point
from gcs.planning.terrain.height_field import field_lengths, fill_field
from gcs.planning.terrain.path_search import Effort, find_path
from gcs.planning.terrain.terrain_map import BandCircle, BandPose, Goal, TerrainMap

_SEED_SPACINGS = 1.5
_DETOUR = 3.0
_DETOUR_M = 2000.0
"""Greatest length of a path behind a place that is passed: multiple of the distance, and more."""
_BEHIND_EFFORT = Effort(1.1, 1_000, 20_000)


def goal_at(
    terrain: TerrainMap,
    circles: Sequence[BandCircle],
    place_m: Point | None = None,
    reach_m: float = 0.0,
) -> Goal | None:
    """Return a goal with its fields; None if no path leads from the place to a circle.

    Takes some 15 ms for 25 square kilometres, 25 ms with a place to pass.
    """
    moves = terrain.moves
    limits = moves.limits
    rates = (terrain.vertical.climb_gradient, terrain.vertical.sink_gradient)
    seeds = np.concatenate([_seeds(terrain, circle) for circle in circles])
    if place_m is None:
        counts, labels = fill_field(limits, moves.spacing_m, *rates, seeds, math.inf)
        return Goal(tuple(circles), None, 0.0, moves.spacing_m, counts[None], labels[None])
    most_m = max(math.dist(place_m, (one.east_m, one.north_m)) for one in circles) * _DETOUR
    behind, behind_labels = fill_field(limits, moves.spacing_m, *rates, seeds, most_m + _DETOUR_M)
    near = _nodes_near(terrain, place_m, reach_m, behind, behind_labels)
    if not near.size:
        return None
    # Fields know no turns: what the turn at the place costs is added to the lengths before it.
    behind_goal = Goal(tuple(circles), None, 0.0, moves.spacing_m, behind[None], behind_labels[None])
    low, high = terrain.search_band.limits_at(np.array([place_m]))[0].tolist()
    turned = find_path(terrain, BandPose(*place_m, None, low, high), behind_goal, _BEHIND_EFFORT)
    if turned is None:
        return None
    near[:, 2] += max(turned.length_m - turned.field_m, 0.0)
    counts, labels = fill_field(limits, moves.spacing_m, *rates, near, math.inf)
    return Goal(
        tuple(circles),
        place_m,
        reach_m,
        moves.spacing_m,
        np.stack((counts, behind)),
        np.stack((labels, behind_labels)),
    )


def _seeds(terrain: TerrainMap, circle: BandCircle) -> FloatArray:
    """Return the nodes near a circle: row, column, distance, least and greatest height."""
    moves = terrain.moves
    rows, cols = moves.limits.shape[:2]
    x = circle.east_m - terrain.band.origin_m[0] - moves.spacing_m * np.arange(cols)[None, :]
    y = circle.north_m - terrain.band.origin_m[1] - moves.spacing_m * np.arange(rows)[:, None]
    apart_m = np.abs(np.hypot(x, y) - circle.radius_m)
    at = np.argwhere(apart_m <= _SEED_SPACINGS * moves.spacing_m)
    length_m = apart_m[tuple(at.T)]
    limits = moves.band.limits_at(at[:, ::-1] * moves.spacing_m + np.array(terrain.band.origin_m))
    low = np.maximum(circle.low_msl_m - terrain.vertical.climb_gradient * length_m, limits[:, 0])
    high = np.minimum(circle.high_msl_m + terrain.vertical.sink_gradient * length_m, limits[:, 1])
    seeds: FloatArray = np.column_stack((at, length_m, low, high))[low <= high]
    return seeds


def _nodes_near(
    terrain: TerrainMap, place_m: Point, reach_m: float, counts: Int32Array, labels: Float32Array
) -> FloatArray:
    """Return the labels of the nodes around a place: row, column, length, least and greatest height."""
    moves = terrain.moves
    rows, cols = counts.shape
    x = place_m[0] - terrain.band.origin_m[0] - moves.spacing_m * np.arange(cols)[None, :]
    y = place_m[1] - terrain.band.origin_m[1] - moves.spacing_m * np.arange(rows)[:, None]
    at = np.argwhere(np.hypot(x, y) <= reach_m + moves.spacing_m)
    found = [
        (row, col, *labels[row, col, k].tolist()) for row, col in at.tolist() for k in range(counts[row, col])
    ]
    return np.array(found).reshape(-1, 5)


def cost_matrix(
    terrain: TerrainMap, starts: Sequence[BandPose | BandCircle], goals: Sequence[Goal | None]
) -> FloatArray:
    """Return the lengths (n, m) of paths from starts to goals; inf without one. Turns are left out."""
    east, north = terrain.band.origin_m
    places = np.array(
        [(one.east_m - east, one.north_m - north, one.low_msl_m, one.high_msl_m) for one in starts]
    ).reshape(-1, 4)
    gradient = min(terrain.vertical.climb_gradient, terrain.vertical.sink_gradient)
    lengths = np.full((len(starts), len(goals)), np.inf)
    for j, goal in enumerate(goals):
        if goal is not None:
            lengths[:, j] = field_lengths(goal.counts, goal.labels, goal.spacing_m, places, gradient)
    return lengths
