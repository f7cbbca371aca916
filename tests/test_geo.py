"""The local frame is the place on Earth that it says, and angles wrap."""

import math

import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.geo import LocalFrame, bearing_rad, wrap_pi

FRAME = LocalFrame(33.2, -87.6, 70.0)


@given(st.floats(-6000, 6000), st.floats(-6000, 6000))
def test_there_and_back_is_the_same_place(east_m: float, north_m: float) -> None:
    assert FRAME.to_local(*FRAME.to_geodetic(east_m, north_m)) == pytest.approx((east_m, north_m), abs=0.01)


def test_one_degree_north_is_a_degree_of_the_meridian() -> None:
    _, north_m = FRAME.to_local(33.21, -87.6)
    assert north_m == pytest.approx(1109.1, abs=0.5)  # 110.91 km a degree at 33.2 degrees on WGS84


@given(st.floats(-85, 85), st.floats(-180, 180), st.floats(-1, 1), st.floats(-1, 1))
def test_the_local_frame_is_pymap3ds(
    lat_deg: float, lon_deg: float, north_deg: float, east_deg: float
) -> None:
    there = lat_deg + north_deg, lon_deg + east_deg
    enu = pymap3d.geodetic2enu(*there, 70.0, lat_deg, lon_deg, 70.0)
    assert LocalFrame(lat_deg, lon_deg, 70.0).to_local(*there) == pytest.approx(enu[:2], abs=1e-6)


@given(st.floats(-89, 89), st.floats(-180, 180), st.floats(-20e3, 20e3), st.floats(-20e3, 20e3))
def test_the_way_back_is_pymap3ds(lat_deg: float, lon_deg: float, east_m: float, north_m: float) -> None:
    there = pymap3d.enu2geodetic(east_m, north_m, 0.0, lat_deg, lon_deg, 70.0)
    assert LocalFrame(lat_deg, lon_deg, 70.0).to_geodetic(east_m, north_m) == pytest.approx(
        (float(there[0]), float(there[1])), abs=1e-11, rel=0.0
    )


@given(st.floats(-1e4, 1e4))
def test_a_wrapped_angle_points_the_same_way(angle: float) -> None:
    wrapped = wrap_pi(angle)
    assert -math.pi <= wrapped < math.pi + 1e-9
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-8)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-8)


def test_bearings_are_clockwise_from_north() -> None:
    assert bearing_rad(0, 0, 0, 1) == 0.0
    assert bearing_rad(0, 0, 1, 0) == pytest.approx(math.pi / 2)
    assert bearing_rad(0, 0, -1, 0) == pytest.approx(-math.pi / 2)
