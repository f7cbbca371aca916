"""A sensor would be believed where a mountain hides everything, or blamed for what it cannot see."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.ridged import ground, ridge
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.terrain.elevation_grid import Elevation
from gcs.terrain.line_of_sight import line_of_sight, visible_share

PLACE = (500.0, 500.0)


def test_on_level_ground_nothing_is_hidden():
    lines = line_of_sight(ground(lambda east, _: 0.0 * east + 70.0), PLACE, 75.0, 1000.0)
    assert not lines.shadow_agl_m.any()


def test_a_ridge_hides_what_is_below_the_line_over_its_crest():
    """From 10 m above the valley, 500 m before a crest of 150 m: the line rises by 140 m in 500 m."""
    lines = line_of_sight(ridge(), PLACE, 110.0, 1500.0)
    behind = np.array([[1200.0, 500.0], [1500.0, 500.0], [1900.0, 500.0]])
    expected = 10.0 + 140.0 / 500.0 * (behind[:, 0] - 500.0)
    np.testing.assert_allclose(lines.shadows_at(behind), expected, rtol=0.02)
    before = np.array([[700.0, 500.0], [990.0, 500.0], [100.0, 900.0]])
    assert (lines.shadows_at(before) < 1.0).all()


def test_beyond_the_elevation_model_nothing_is_in_the_way():
    lines = line_of_sight(ridge(), (2300.0, 500.0), 110.0, 5000.0)
    assert lines.shadows_at(np.array([[4000.0, 500.0]])) == 0.0


def test_a_band_is_seen_in_the_part_above_the_line():
    seen = line_of_sight(ridge(), PLACE, 110.0, 1500.0).visibility(200.0, 400.0)
    places = np.array([[700.0, 500.0], [1500.0, 500.0], [1900.0, 500.0]])
    line_m = 10.0 + 0.28 * 1000.0
    assert visible_share(seen, places) == pytest.approx([1.0, (400.0 - line_m) / 200.0, 0.0], abs=0.06)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_shadows_are_those_of_a_line_read_metre_by_metre(seed):
    rng = np.random.default_rng(seed)
    nodes = rng.uniform(0.0, 60.0, (12, 12))
    model = Elevation((0.0, 0.0), 100.0, nodes)
    place = rng.uniform(300.0, 800.0, 2)
    alt_m = model.height_msl_m(*place) + rng.uniform(2.0, 40.0)
    lines = line_of_sight(model, tuple(place.tolist()), alt_m, 600.0)
    n_bearings, n_ranges = lines.shadow_agl_m.shape
    for _ in range(20):
        b = int(rng.integers(n_bearings))
        k = int(rng.integers(1, n_ranges))
        bearing = 2.0 * math.pi * b / n_bearings
        r = np.append(np.arange(1.0, k * lines.range_step_m, 1.0), k * lines.range_step_m)
        heights = model.heights_at(place + np.outer(r, [math.sin(bearing), math.cos(bearing)]))
        if np.isnan(heights).any():
            continue
        horizon = ((heights[:-1] - alt_m) / r[:-1]).max(initial=-np.inf)
        exact = max(alt_m + horizon * r[-1] - heights[-1], 0.0)
        # Read every 100 m here: a crest between two reads is lower by at most the bend of the ground.
        assert lines.shadow_agl_m[b, k] <= exact + 0.01
