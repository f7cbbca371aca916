"""What searches in one flight band share: its surfaces, the limits of moves, and the fields of goals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.model import FloatArray
from gcs.planning.terrain.band import FlightBand, Vertical
from gcs.planning.terrain.height_field import HeightField, MoveMap, field_lengths, fill_field, make_move_map

_SEARCH_SLACK_M = 1.5
_SHORTENING_SLACK_M = 0.75
_PROFILE_SLACK_M = 0.25
"""Distance from floor and ceiling: paths are sampled more closely with every stage."""
_SEED_SPACINGS = 1.5


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
    """0: a point that is passed on any course."""
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
    """Loiter circle and the lengths of paths to it, or a point to pass on the way to one.

    Attributes
    ----------
    circle : BandCircle
        A point to pass has no radius.
    field : HeightField
        Lengths to `circle`.
    behind : tuple of Goal
        For a point: loiter circles to go on to, the nearest one first.
    """

    circle: BandCircle
    field: HeightField
    behind: tuple[Goal, ...] = ()


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
    terrain: TerrainMap, circle: BandCircle, behind: tuple[Goal, ...] = (), most_m: float = math.inf
) -> Goal:
    """Return a goal with its field for lengths up to `most_m`; some 20 ms for 25 square kilometres."""
    vertical = terrain.vertical
    moves = terrain.moves
    seeds = _seeds(terrain, circle)
    counts, labels = fill_field(
        moves.limits, moves.spacing_m, vertical.climb_gradient, vertical.sink_gradient, seeds, most_m
    )
    return Goal(circle, HeightField(moves.spacing_m, counts, labels), behind)


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


def cost_matrix(
    terrain: TerrainMap, starts: Sequence[BandPose | BandCircle], goals: Sequence[Goal | None]
) -> FloatArray:
    """Return the lengths (n, m) of paths from starts to goals; inf without one. Turns are left out."""
    lengths = [_lengths_to(terrain, starts, goal) for goal in goals]
    return np.array(lengths).reshape(len(goals), len(starts)).T


def _lengths_to(
    terrain: TerrainMap, starts: Sequence[BandPose | BandCircle], goal: Goal | None
) -> FloatArray:
    """Return the length of the path from each start to a goal and to the circle behind it."""
    if goal is None:
        return np.full(len(starts), np.inf)
    east, north = terrain.band.origin_m
    places = np.array(
        [(one.east_m - east, one.north_m - north, one.low_msl_m, one.high_msl_m) for one in starts]
    ).reshape(-1, 4)
    field = goal.field
    gradient = min(terrain.vertical.climb_gradient, terrain.vertical.sink_gradient)
    lengths = field_lengths(field.counts, field.labels, field.spacing_m, places, gradient)
    if goal.behind:
        lengths = lengths + min(float(_lengths_to(terrain, [goal.circle], one)[0]) for one in goal.behind)
    return lengths
