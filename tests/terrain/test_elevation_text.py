"""A recording would lose the ground that its mission was planned on, or a damaged one would end a program."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gcs.errors import TerrainFileError
from gcs.terrain.elevation_grid import Elevation
from gcs.terrain.elevation_text import ElevationModel, decode_model, encode_model

HEIGHTS = arrays(np.float64, st.tuples(st.integers(2, 9), st.integers(2, 9)), elements=st.floats(-500, 9000))


FLAT = np.zeros((4, 5))


def model(heights=FLAT):
    return ElevationModel("hills.tif", 9.99, Elevation((-20.0, 30.0), 10.0, heights), ("cut short",))


@given(HEIGHTS)
def test_heights_come_back_to_half_a_decimetre(heights):
    given = model(heights)
    found = decode_model(encode_model(given))
    np.testing.assert_allclose(found.elevation.heights_msl_m, heights, atol=0.0501)
    assert found.elevation.origin_m == given.elevation.origin_m
    assert (found.file, found.resolution_m, found.remarks) == ("hills.tif", 9.99, ("cut short",))


def test_smooth_ground_takes_little_space():
    east, north = np.meshgrid(np.arange(500), np.arange(500))
    heights = 1500.0 + 200.0 * np.sin(east / 40.0) * np.cos(north / 60.0)
    assert len(encode_model(model(heights))) < 500 * 500


@pytest.mark.parametrize(
    "change",
    [
        {"shape": [4, 6]},
        {"shape": [4_000_000, 4_000_000]},
        {"shape": [1, 20]},
        {"heights": "AAAA"},
        {"heights": "no base64"},
        {"spacing_m": 0.0},
        {"more": 1},
    ],
)
def test_a_damaged_text_is_refused(change):
    text = json.dumps(json.loads(encode_model(model())) | change)
    with pytest.raises(TerrainFileError, match="a damaged elevation model"):
        decode_model(text)


def test_heights_out_of_range_are_refused():
    with pytest.raises(TerrainFileError, match="out of range"):
        decode_model(encode_model(model(np.full((3, 3), 20_000.0))))
