"""An order from outside is read strictly: a misspelt key may change what it means."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.errors import WireError
from gcs.geo import LocalFrame
from gcs.io.zenoh.key_expressions import order_key
from gcs.io.zenoh.order_messages import decode_order
from gcs.model import NoFlyZone, Order, VerticalLimits

FRAME = LocalFrame(33.2, -87.6, 70.0)
KEY = order_key("m")


def read(**fields):
    return decode_order(KEY, json.dumps({"order_id": "a-1", **fields}).encode(), 5, FRAME)


def test_an_order_names_its_vehicles_once_each_and_in_order() -> None:
    assert read(action="hold", vehicles=[3, 1, 3]) == Order(5, "a-1", "hold", (1, 3))
    assert read(action="return", vehicles="all") == Order(5, "a-1", "return", None)


@pytest.mark.parametrize("target", ["T0.10", "0.10", [0, 10]])
def test_a_target_is_named_as_it_is_shown_or_as_records_have_it(target) -> None:
    assert read(action="ignore", target=target).target == (0, 10)


def test_places_in_degrees_become_local_metres() -> None:
    lat, lon = FRAME.to_geodetic(500.0, 900.0)
    area = read(
        action="no-fly-zone", no_fly_zone={"name": "fire", "frame": "wgs84", "circle": [lat, lon, 80.0]}
    )
    assert area.no_fly_zone is not None
    assert area.no_fly_zone.disc_m == pytest.approx((500.0, 900.0, 80.0), abs=1e-3)
    square = [[0, 0], [100, 0], [100, 100]]
    local = read(action="no-fly-zone", no_fly_zone={"name": "fire", "polygon": square})
    assert local.no_fly_zone == NoFlyZone("fire", None, ((0.0, 0.0), (100.0, 0.0), (100.0, 100.0)))


def test_a_zone_has_the_heights_that_it_is_given() -> None:
    zone = {"name": "fire", "circle": [0, 0, 80], "ceiling_m": 300, "reference": "msl"}
    area = read(action="no-fly-zone", no_fly_zone=zone).no_fly_zone
    assert area == NoFlyZone("fire", (0.0, 0.0, 80.0), (), VerticalLimits(None, 300.0, "msl"))
    area = read(action="no-fly-zone", no_fly_zone={"name": "fire", "circle": [0, 0, 80]}).no_fly_zone
    assert area == NoFlyZone("fire", (0.0, 0.0, 80.0))


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            {"action": "explode", "vehicles": "all"},
            'one of "hold", "resume", .*"status", got',
        ),
        ({"action": "arm"}, "for whom"),
        ({"action": "hold", "vehicles": []}, "vehicles"),
        ({"action": "hold", "vehicles": [0]}, "vehicles"),
        ({"action": "hold", "vehicles": "some"}, "vehicles"),
        ({"action": "hold", "vehicle": [1], "vehicles": "all"}, "unknown field"),
        ({"action": "confirm"}, "which plan"),
        ({"action": "no-fly-zone"}, "no_fly_zone"),
        ({"action": "hold", "vehicles": "all", "no_fly_zone": {"name": "x"}}, "no_fly_zone"),
        (
            {"action": "no-fly-zone", "no_fly_zone": {"name": "x", "polygon": [[0, 0], [1, 1]]}},
            "no_fly_zone.polygon: expected at least three different corners, got 2",
        ),
        ({"action": "no-fly-zone", "no_fly_zone": {"name": "x", "circle": [0, 0, -1]}}, "circle"),
        (
            {"action": "no-fly-zone", "no_fly_zone": {"name": "x", "frame": "ecef", "circle": [9, 0, 1]}},
            'no_fly_zone.frame: expected one of "local", "wgs84", got',
        ),
        (
            {"action": "no-fly-zone", "no_fly_zone": {"name": "x", "frame": "wgs84", "circle": [99, 0, 1]}},
            "lat_deg",
        ),
        (
            {"action": "no-fly-zone", "no_fly_zone": {"name": "x", "circle": [9, 0, 1], "ceiling_m": 60}},
            "no_fly_zone.reference: is missing",
        ),
        (
            {
                "action": "no-fly-zone",
                "no_fly_zone": {"name": "x", "circle": [9, 0, 1], "ceiling_m": 60, "reference": "agl"},
            },
            'no_fly_zone.reference: expected one of "home", "msl", "ground", got',
        ),
        (
            {"action": "no-fly-zone", "no_fly_zone": {"name": "x", "frame": "wgs84", "circle": [0, 0, 1]}},
            "km from",
        ),
    ],
)
def test_a_wrong_order_is_refused_with_its_defect(fields, words) -> None:
    with pytest.raises(WireError, match=words):
        read(**fields)


@given(st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_garbage_is_an_error_of_ours(payload: bytes) -> None:
    with pytest.raises(WireError):
        decode_order(KEY, payload, 0, FRAME)
