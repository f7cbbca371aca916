"""Detours: the flight band without the places where other vehicles will be, over, under and beside them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from gcs.model import Float32Array, FloatArray, IntArray
from gcs.planning.map.grid import Point
from gcs.planning.terrain.band import NO_BAND_M, FlightBand


@dataclass(frozen=True, slots=True)
class AvoidedFlight:
    """Part of the flight of another vehicle, and the distances that a route keeps from it."""

    places_m: FloatArray
    """(k, 3), east, north and height above mean sea level, closely spaced."""
    distance_m: float
    height_m: float
    """Difference in height from which the route may pass over or under it."""


def band_beside(band: FlightBand, avoided: Iterable[AvoidedFlight]) -> FlightBand:
    """Return the band without the places of other flights.

    Each is passed over if that leaves at least as many nodes open as to pass under it.
    """
    surfaces = band.surfaces_msl_m.copy()
    for flight in avoided:
        over = surfaces.copy()
        under = surfaces.copy()
        for east_m, north_m, height_msl_m in flight.places_m.tolist():
            rows, cols = _nodes_within(band, (east_m, north_m), flight.distance_m)
            over[rows, cols, 0] = np.maximum(over[rows, cols, 0], height_msl_m + flight.height_m)
            under[rows, cols, 1] = np.minimum(under[rows, cols, 1], height_msl_m - flight.height_m)
        surfaces = over if _open_nodes(over) >= _open_nodes(under) else under
    surfaces[surfaces[..., 0] >= surfaces[..., 1], :2] = (NO_BAND_M, -NO_BAND_M)
    surfaces.flags.writeable = False
    return replace(band, surfaces_msl_m=surfaces)


def _nodes_within(band: FlightBand, place_m: Point, distance_m: float) -> tuple[IntArray, IntArray]:
    """Return rows and columns of the nodes that are nearer to a place than a distance."""
    reach = distance_m / band.spacing_m
    col, row = ((np.array(place_m) - band.origin_m) / band.spacing_m).tolist()
    rows, cols = (
        np.arange(max(math.ceil(at - reach), 0), min(math.floor(at + reach) + 1, count))
        for at, count in zip((row, col), band.surfaces_msl_m.shape, strict=False)
    )
    near_rows, near_cols = np.nonzero(np.hypot(rows[:, None] - row, cols - col) < reach)
    return rows[near_rows], cols[near_cols]


def _open_nodes(surfaces: Float32Array) -> int:
    return int(np.count_nonzero(surfaces[..., 0] < surfaces[..., 1]))
