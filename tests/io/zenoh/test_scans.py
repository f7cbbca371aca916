"""A radar's scan must arrive as what it measured, and nonsense must be refused with the field at fault."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.errors import WireError
from gcs.geo import LocalFrame
from gcs.io.record_json import decode, encode
from gcs.io.zenoh.key_expressions import scan_key
from gcs.io.zenoh.scans import decode_scan, encode_scan
from gcs.model import Polar, Scan, Sensor, Viewpoint, read_only
from gcs.tracking.models.sensor_geometry import map_coordinates, polar_sensor, sensor_coordinates

FRAME = LocalFrame(33.2, -87.6, 70.0)
POLAR = Polar(-300.0, 1000.0, 4.0, 0.005, (50.0, 2600.0), (1.5, 0.8), 1e-3)
RADAR = polar_sensor("radar-2", 0.9, POLAR)
KEY = scan_key("m", "radar-2")


def message(**changes):
    raw = json.loads(encode_scan(Scan(0, 5, RADAR, read_only([[100.0, 900.0]])), FRAME))
    for path, value in changes.items():
        where, _, field = path.rpartition("__")
        place = raw[where] if where else raw
        if value is None:
            del place[field]
        else:
            place[field] = value
    return json.dumps(raw).encode()


@given(st.lists(st.tuples(st.floats(0.1, 2600.0), st.floats(-math.pi, math.pi)), max_size=20))
def test_ranges_and_bearings_arrive_as_they_were_measured(z):
    z = np.reshape(z, (-1, 2))
    back = decode_scan(
        KEY, encode_scan(Scan(1, 2, RADAR, read_only(map_coordinates(POLAR, z))), FRAME), 7, FRAME
    )
    assert (back.t_ns, back.measured_t_ns, back.sensor.polar) == (7, 2, POLAR)
    off = sensor_coordinates(RADAR, back.z_m) - z
    np.testing.assert_allclose(off[:, 0], 0.0, atol=1e-8)
    np.testing.assert_allclose(np.sin(off[:, 1] / 2.0), 0.0, atol=1e-8)


def test_a_radars_scan_is_recorded_and_read_again_bit_for_bit():
    scan = Scan(1, 2, RADAR, read_only([[100.1, 900.3]]))
    back = decode("x", encode(scan), Scan)
    assert back.sensor.polar == POLAR
    assert np.array_equal(back.z_m, scan.z_m)


def test_a_recorded_position_sensor_of_before_has_no_polar():
    raw = json.loads(encode(Scan(1, 2, RADAR, read_only([[1.0, 2.0]]))))
    del raw["sensor"]["polar"]
    assert decode("x", json.dumps(raw).encode(), Scan).sensor.polar is None


def test_what_may_be_left_out_means_all_around_and_from_nought():
    payload = message(
        sensor__least_range_m=None, sensor__sector_centre_rad=None, sensor__sector_width_rad=None
    )
    polar = decode_scan(KEY, payload, 0, FRAME).sensor.polar
    assert (polar.range_m[0], polar.bearing_rad) == (0.0, (0.0, pytest.approx(math.pi)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sensor__kind": "sonar"}, "sensor.kind"),
        ({"sensor__place_m": None}, "place_m"),
        ({"sensor__range_std_m": -1.0}, "sensor.range_std_m"),
        ({"sensor__bearing_std_rad": 9.0}, "sensor.bearing_std_rad"),
        ({"sensor__least_range_m": 3000.0}, "most_range_m"),
        ({"sensor__sector_width_rad": 0.0}, "sensor.sector_width_rad"),
        ({"sensor__name": "other"}, "sensor.name"),
        ({"z_range_bearing": None}, "z_range_bearing"),
        ({"z_range_bearing": [[-1.0, 0.0]]}, "z_range_bearing"),
        ({"z_range_bearing": [[1.0, 99.0]]}, "z_range_bearing"),
        ({"origin__lat_deg": 34.0}, "origin"),
    ],
)
def test_a_radars_mistake_names_the_field(changes, words):
    with pytest.raises(WireError, match=words):
        decode_scan(KEY, message(**changes), 0, FRAME)


def test_the_box_around_a_sector_holds_all_of_it():
    rng = np.random.default_rng(0)
    for centre, half in [(0.0, 0.3), (math.pi, 1.0), (1.5, 0.8), (-2.0, math.pi)]:
        polar = Polar(10.0, -20.0, 4.0, 0.01, (100.0, 900.0), (centre, half), 1e-3)
        west, south, east, north = polar_sensor("r", 0.9, polar).field_of_view_m
        z = rng.uniform((100.0, centre - half), (900.0, centre + half), (20_000, 2))
        places = map_coordinates(polar, z)
        assert ((west, south) <= places.min(axis=0)).all()
        assert (places.max(axis=0) <= (east, north)).all()
        assert places.max(axis=0) == pytest.approx((east, north), abs=10.0)


def test_the_documented_radar_example_is_read():
    text = (Path(__file__).parents[3] / "docs" / "sensors.md").read_text(encoding="utf-8")
    example = next(block for block in text.split("```json")[1:] if "z_range_bearing" in block).split("```")[0]
    scan = decode_scan(KEY, example.encode(), 0, FRAME)
    assert scan.z_m.shape == (2, 2)


# ------------------------------------------------------------ heights


POSITION = Sensor("radar-2", 0.9, 1e-6, read_only(np.eye(2)), (0.0, 0.0, 2000.0, 2000.0))
PLACES = read_only([[100.0, 900.0], [300.0, 700.0]])


@pytest.mark.parametrize("sensor", [RADAR, POSITION, replace(RADAR, polar=replace(POLAR, is_slant=True))])
@pytest.mark.parametrize("is_agl", [True, False])
@pytest.mark.parametrize("heights_m", [None, read_only([812.5, 1400.0])])
def test_heights_arrive_and_are_recorded_as_they_were_published(sensor, is_agl, heights_m):
    place_m = (-300.0, 1000.0) if sensor.polar else (7.0, 8.0)
    sensor = replace(sensor, viewpoint=Viewpoint(*place_m, 30.0, is_agl))
    sent = Scan(1, 2, sensor, PLACES, heights_m)
    for back in (decode_scan(KEY, encode_scan(sent, FRAME), 7, FRAME), decode("x", encode(sent), Scan)):
        assert (back.sensor.viewpoint, back.sensor.polar) == (sensor.viewpoint, sensor.polar)
        np.testing.assert_allclose(back.z_m, PLACES)
        assert (back.heights_msl_m is None) == (heights_m is None)
        if heights_m is not None:
            assert back.heights_msl_m.tolist() == heights_m.tolist()


def test_a_scan_recorded_before_sensors_had_heights_is_read():
    raw = json.loads(encode(Scan(1, 2, RADAR, PLACES)))
    for field in ("viewpoint", "visibility"):
        del raw["sensor"][field]
    del raw["sensor"]["polar"]["is_slant"]
    del raw["heights_msl_m"]
    back = decode("x", json.dumps(raw).encode(), Scan)
    assert (back.sensor.viewpoint, back.heights_msl_m, back.sensor.polar) == (None, None, POLAR)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"z_range_bearing": [[1.0, 0.5, 3.0, 4.0]]}, "at most length 3"),
        ({"z_range_bearing": [[1.0]]}, "z_range_bearing"),
        ({"z_range_bearing": [[1.0, 0.5, 1e9]]}, "z_range_bearing"),
        ({"z_range_bearing": [[1.0, 0.5, 3.0], [1.0, 0.5]]}, "a height in every detection, or in none"),
        ({"sensor__alt_msl_m": 5.0, "sensor__height_agl_m": 5.0}, "not both"),
        ({"sensor__alt_msl_m": "high"}, "sensor.alt_msl_m"),
        ({"sensor__range": "slant"}, 'sensor.range: "slant" needs'),
        ({"sensor__range": "direct"}, "sensor.range"),
    ],
)
def test_a_mistake_in_heights_names_the_field(changes, words):
    with pytest.raises(WireError, match=words):
        decode_scan(KEY, message(**changes), 0, FRAME)


def test_a_position_sensor_with_a_height_needs_a_place():
    raw = json.loads(encode_scan(Scan(0, 5, POSITION, PLACES), FRAME))
    raw["sensor"]["height_agl_m"] = 20.0
    with pytest.raises(WireError, match=r"sensor\.place_m"):
        decode_scan(KEY, json.dumps(raw).encode(), 0, FRAME)
