"""Reported positions are where the vehicle is."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.geo import LocalFrame
from sim_vehicles.vehicle.geodesy import Geodesy


@settings(max_examples=30)
@given(
    st.floats(-85, 85), st.floats(-180, 180), st.floats(-5000, 5000), st.floats(-5000, 5000),
    st.lists(st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000)), min_size=1, max_size=4),
)  # fmt: skip
def test_within_a_centimetre_of_the_exact_conversion(lat, lon, east, north, moves):
    geodesy = Geodesy(LocalFrame(lat, lon, 70.0))
    geodesy.to_geodetic(east, north)
    for de, dn in moves:
        place = geodesy.to_geodetic(east + de, north + dn)
        back = geodesy.to_local(*place)
        assert math.dist(back, (east + de, north + dn)) < 0.01


def test_longitude_stays_within_its_range_across_the_antimeridian():
    geodesy = Geodesy(LocalFrame(10.0, 179.999, 0.0))
    geodesy.to_geodetic(0.0, 0.0)
    _, lon = geodesy.to_geodetic(500.0, 0.0)
    assert lon == pytest.approx(-179.9964, abs=1e-3)
