"""The judge of paths over terrain: what it lets pass is called flyable in the comparison."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bench_terrain_peer import check, sample_route
from terrain_pairs import MAX_GRADIENT, TURN_RADIUS_M, Circle, Pair

from gcs.model import FloatArray
from gcs.terrain.elevation_grid import Elevation

FLAT = Elevation((-1000.0, -1000.0), 10.0, np.zeros((301, 301)))
PAIR = Pair(Circle(0.0, -TURN_RADIUS_M, 80.0), Circle(500.0 + TURN_RADIUS_M, 400.0, 90.0))
CORNER_M = np.array([[0.0, 0.0], [500.0, 0.0], [500.0, 400.0]])
"""East, a quarter turn to the left, then north: on the tangents of both circles."""


def corner_path(heights_msl_m: tuple[float, ...] = (80.0, 85.0, 90.0)) -> FloatArray:
    return sample_route(CORNER_M, np.array(heights_msl_m))


def test_route_is_as_long_as_its_legs_and_turn() -> None:
    found = check(FLAT, PAIR, corner_path())
    assert found["length_m"] == pytest.approx(900.0 + (0.5 * math.pi - 2.0) * TURN_RADIUS_M, abs=0.01)
    assert found["curvature"] == pytest.approx(1.0, abs=1e-3)
    assert found["off_ends_m"] < 1e-6
    assert found["off_tangent_deg"] < 1e-6


@pytest.mark.parametrize(("middle_m", "outside_m"), [(49.0, 1.0), (121.0, 1.0)])
def test_path_outside_the_band_is_seen(middle_m: float, outside_m: float) -> None:
    found = check(FLAT, PAIR, corner_path((80.0, middle_m, 90.0)))
    assert found["outside_band_m"] == pytest.approx(outside_m, abs=0.2)


def test_path_off_the_elevation_is_seen() -> None:
    small = Elevation((-1000.0, -1000.0), 10.0, np.zeros((301, 120)))
    assert check(small, PAIR, corner_path())["outside_band_m"] == math.inf


def test_steep_path_is_seen() -> None:
    steep_m = 60.0 + 2.0 * MAX_GRADIENT * (500.0 + (0.25 * math.pi - 1.0) * TURN_RADIUS_M)
    found = check(FLAT, PAIR, corner_path((60.0, steep_m, steep_m)))
    assert found["gradient"] == pytest.approx(2.0, abs=0.01)


def test_sharp_turn_is_seen() -> None:
    angles = np.linspace(0.0, math.pi, 200)
    turn_m = np.column_stack((60.0 * np.sin(angles), 60.0 * np.cos(angles), np.full(200, 80.0)))
    assert check(FLAT, PAIR, turn_m)["curvature"] == pytest.approx(TURN_RADIUS_M / 60.0, abs=1e-3)


def test_path_that_misses_the_circle_is_seen() -> None:
    found = check(FLAT, PAIR, corner_path((80.0, 85.0, 95.0)))
    assert found["off_ends_m"] == pytest.approx(5.0)
