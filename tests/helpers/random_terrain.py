"""Small random terrain for tests of routes in a flight band."""

from __future__ import annotations

import math

import numpy as np

from gcs.model import FloatArray
from gcs.planning.terrain.band import FlightBand, Vertical
from gcs.planning.terrain.height_profile import sample_path
from gcs.planning.terrain.route import TerrainRoute
from gcs.terrain.elevation_grid import Elevation

SPACING_M = 10.0
RADIUS_M = 25.0
VERTICAL = Vertical(0.15, 0.12)
MIN_AGL_M = 40.0
MAX_AGL_M = 90.0


def hills(seed: int, size: int = 60, relief_m: float = 40.0) -> Elevation:
    """Return waves with random directions, 150 to 500 m long."""
    rng = np.random.default_rng(seed)
    north, east = np.mgrid[0:size, 0:size] * SPACING_M
    heights = np.zeros((size, size))
    for _ in range(5):
        course = rng.uniform(0.0, 2.0 * math.pi)
        wave_m = rng.uniform(150.0, 500.0)
        phase = 2.0 * math.pi * (east * math.sin(course) + north * math.cos(course)) / wave_m
        heights += rng.uniform(0.0, relief_m) * np.cos(phase + rng.uniform(0.0, 2.0 * math.pi))
    return Elevation((0.0, 0.0), SPACING_M, 500.0 + heights)


def flown(
    route: TerrainRoute, step_m: float = 0.5, radius_m: float = RADIUS_M
) -> tuple[FloatArray, FloatArray]:
    """Return places (k, 3: east, north, length) and heights (k,) along a route with its turns."""
    places, _, knots = sample_path(np.array(route.points_m), radius_m, step_m)
    return places, np.interp(places[:, 2], places[knots, 2], route.heights_msl_m)


def departure_m(band: FlightBand, places: FloatArray, heights: FloatArray) -> float:
    """Return how far a flight is below the floor or above the ceiling at most."""
    limits = band.limits_at(places[:, :2])
    return float(np.maximum(limits[:, 0] - heights, heights - limits[:, 1]).max())
