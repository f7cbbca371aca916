"""What searches in one flight band share: its surfaces, the limits of moves, and the fields of goals."""

from __future__ import annotations

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
    """Loiter circle that a route leaves or enters on a tangent, in either direction."""

    east_m: float
    north_m: float
    radius_m: float
    """0: a point that is passed on any course."""
    low_msl_m: float
    high_msl_m: float
    """Heights of which the route may choose."""


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
    """Loiter circle and the lengths of paths to it."""

    circle: BandCircle
    field: HeightField


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


def goal_at(terrain: TerrainMap, circle: BandCircle) -> Goal:
    """Return a goal with its field; some 20 ms for 25 square kilometres."""
    vertical = terrain.vertical
    moves = terrain.moves
    seeds = _seeds(terrain, circle)
    counts, labels = fill_field(
        moves.limits, moves.spacing_m, vertical.climb_gradient, vertical.sink_gradient, seeds
    )
    return Goal(circle, HeightField(moves.spacing_m, counts, labels))


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


def path_lengths(terrain: TerrainMap, starts: list[BandPose | BandCircle], goal: Goal) -> FloatArray:
    """Return the length of the path from each start to a goal; inf without one. Turns are left out."""
    east, north = terrain.band.origin_m
    places = np.array(
        [(one.east_m - east, one.north_m - north, one.low_msl_m, one.high_msl_m) for one in starts]
    ).reshape(-1, 4)
    field = goal.field
    gradient = min(terrain.vertical.climb_gradient, terrain.vertical.sink_gradient)
    return field_lengths(field.counts, field.labels, field.spacing_m, places, gradient)
