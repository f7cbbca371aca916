"""Pairs of loiter circles on the Davos tile, the same for every planner that is compared.

The problem is that of Lim, Achermann, Girod, Lawrance and Siegwart, "Safe low-altitude navigation in steep
terrain with fixed-wing aerial vehicles" (RA-L 2024): a turn radius of 66.67 m, a path angle of at most
0.15 rad, 50 to 120 m above the ground, circles at both ends. The vehicle leaves the circle at the start on
any tangent, in either direction, at the height of the circle. It enters the circle at the goal on any
tangent, in either direction, at the height of that circle.

The floor and the ceiling are vertical: the ground below plus 50 m and plus 120 m, bilinear between the
nodes. (The paper offsets both surfaces by a sphere.) A path may not leave the nodes. Its length is that of
its projection on the ground.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio

from gcs.model import FloatArray
from gcs.terrain.elevation_grid import Elevation

TILE = Path(__file__).parents[3] / "shared/data/terrain/davos.tif"
TURN_RADIUS_M = 66.67
MAX_GRADIENT = math.tan(0.15)
MIN_AGL_M = 50.0
MAX_AGL_M = 120.0
MIN_ROOM_M = 10.0
"""Room in height that each circle has."""
MIN_DISTANCE_M = 500.0
"""Distance between the two centres."""
SEED = 28
COUNT = 200


@dataclass(frozen=True, slots=True)
class Circle:
    """Loiter circle of radius `TURN_RADIUS_M`."""

    east_m: float
    north_m: float
    height_msl_m: float


@dataclass(frozen=True, slots=True)
class Pair:
    """Circle that is left, and circle that is entered."""

    start: Circle
    goal: Circle


@functools.cache
def load_elevation(path: Path = TILE) -> Elevation:
    """Return the ground of the tile; east 0, north 0 is its south-western node."""
    with rasterio.open(path) as tile:
        heights = tile.read(1).astype(np.float64)
        spacing_m = float(tile.transform.a)
    return Elevation((0.0, 0.0), spacing_m, np.flipud(heights))


def _ring(east_m: float, north_m: float) -> FloatArray:
    """Return 84 points of a circle, 5 m apart."""
    angles = np.linspace(0.0, 2.0 * math.pi, 84, endpoint=False)
    return np.column_stack(
        (east_m + TURN_RADIUS_M * np.cos(angles), north_m + TURN_RADIUS_M * np.sin(angles))
    )


def circle_at(elevation: Elevation, east_m: float, north_m: float) -> Circle | None:
    """Return the circle in the middle of its room in height; None without `MIN_ROOM_M` of it."""
    ground = elevation.heights_at(_ring(east_m, north_m))
    low = float(ground.max()) + MIN_AGL_M
    high = float(ground.min()) + MAX_AGL_M
    # NaN at the edge of the tile is no room either.
    return Circle(east_m, north_m, 0.5 * (low + high)) if high - low >= MIN_ROOM_M else None


@functools.cache
def pairs(count: int = COUNT, path: Path = TILE) -> tuple[Pair, ...]:
    """Return random pairs, the same at every call."""
    elevation = load_elevation(path)
    rows, cols = elevation.heights_msl_m.shape
    extent_m = np.array([cols - 1, rows - 1]) * elevation.spacing_m
    rng = np.random.default_rng(SEED)
    found: list[Pair] = []
    while len(found) < count:
        ends = [circle_at(elevation, *(rng.random(2) * extent_m).round(1).tolist()) for _ in range(2)]
        start = ends[0]
        goal = ends[1]
        if start is None or goal is None:
            continue
        if math.hypot(goal.east_m - start.east_m, goal.north_m - start.north_m) >= MIN_DISTANCE_M:
            found.append(Pair(start, goal))
    return tuple(found)
