"""What searches in one flight band share: its surfaces, the limits of moves, and the fields of goals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.model import Float32Array, FloatArray, Int32Array
from gcs.planning.map.grid import Point
from gcs.planning.terrain.band import FlightBand, Vertical
from gcs.planning.terrain.height_field import MoveMap, make_move_map

_SEARCH_SLACK_M = 1.5
_SHORTENING_SLACK_M = 0.75
_PROFILE_SLACK_M = 0.25
"""Distance from floor and ceiling: paths are sampled more closely with every stage."""


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
