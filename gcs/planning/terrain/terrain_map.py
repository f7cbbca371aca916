"""What searches in one flight band share: its surfaces, the limits of moves, and the fields of goals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.model import Float32Array, FloatArray, Int32Array
from gcs.planning.map.grid import Point
from gcs.planning.terrain.band import FlightBand, Vertical
from gcs.planning.terrain.height_field import MoveMap, field_lengths, fill_field, make_move_map

_SEARCH_SLACK_M = 1.5
_SHORTENING_SLACK_M = 0.75
_PROFILE_SLACK_M = 0.25
"""Distance from floor and ceiling: paths are sampled more closely with every stage."""
_SEED_SPACINGS = 1.5
_DETOUR = 3.0
_DETOUR_M = 2000.0
"""Greatest length of a path behind a place that is passed: multiple of the distance, and more."""


@dataclass(frozen=True, slots=True)
class BandPose:
    """Position, course and height where a route begins."""

    east_m: float
    north_m: float
    course_rad: float | None
    """Clockwise from north; None: any."""
    low_msl_m: float
    high_msl_m: float
    """Heights of which the route may choose. The true height in flight; it may be outside the band."""


@dataclass(frozen=True, slots=True)
class BandCircle:
    """Loiter circle that a route leaves or enters on a tangent."""

    east_m: float
    north_m: float
    radius_m: float
    low_msl_m: float
    high_msl_m: float
    """Heights of which the route may choose."""
    is_clockwise: bool | None = None
    """None: either."""


@dataclass(frozen=True, eq=False)
class TerrainMap:
    """Flight band, prepared for searches with one turn radius and `Vertical`."""

    band: FlightBand
    vertical: Vertical
    turn_radius_m: float
    moves: MoveMap
    search_band: FlightBand
    shortening_band: FlightBand
    profile_band: FlightBand

    @property
    def rates(self) -> FloatArray:
        """Climb gradient, sink gradient and entry depth, for kernels."""
        vertical = self.vertical
        return np.array([vertical.climb_gradient, vertical.sink_gradient, self.band.entry_depth_m])


@dataclass(frozen=True, eq=False)
class Goal:
    """Loiter circles where a route may end, and a place that it passes before.

    Attributes
    ----------
    circles : tuple of BandCircle
    place_m : tuple of float or None
        Place that is passed within `reach_m` before a circle is entered.
    reach_m : float
    spacing_m : float
        Distance of neighbouring nodes of the fields.
    counts : ndarray of int32, shape (f, rows, cols)
        Number of labels of each node: with a place before and behind it, else of the whole way.
    labels : ndarray of float32, shape (f, rows, cols, MAX_LABELS, 3)
        Length, least and greatest height, the shortest first.
    """

    circles: tuple[BandCircle, ...]
    place_m: Point | None
    reach_m: float
    spacing_m: float
    counts: Int32Array
    labels: Float32Array


def make_terrain_map(band: FlightBand, vertical: Vertical, turn_radius_m: float) -> TerrainMap:
    """Prepare a band for searches; about 0.1 s for 25 square kilometres."""
    search_band = band.narrowed(_SEARCH_SLACK_M)
    moves = make_move_map(search_band, vertical)
    return TerrainMap(
        band,
        vertical,
        turn_radius_m,
        moves,
        search_band,
        band.narrowed(_SHORTENING_SLACK_M),
        band.narrowed(_PROFILE_SLACK_M),
    )


def goal_at(
    terrain: TerrainMap,
    circles: Sequence[BandCircle],
    place_m: Point | None = None,
    reach_m: float = 0.0,
) -> Goal:
    """Return a goal with its fields; some 20 ms for 25 square kilometres, more with a place to pass."""
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
