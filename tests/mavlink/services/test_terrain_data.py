"""An ArduPlane would get wrong heights of the ground, or more of them than its radio carries."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.geo import LocalFrame
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.services.terrain_data import TerrainRecord, TerrainServer, node_places_deg
from gcs.model import NS_PER_S
from gcs.terrain.elevation_grid import Elevation

FRAME = LocalFrame(46.8, 9.8, 1500.0)
UNIT_M = 0.011131884502145034
ALL = (1 << 56) - 1


def hills(size_m=8000.0):
    at = np.arange(0.0, size_m + 1.0, 20.0) - size_m / 2.0
    east, north = np.meshgrid(at, at)
    return Elevation((-size_m / 2.0, -size_m / 2.0), 20.0, 1500.0 + 0.1 * east - 0.2 * north)


def corner_of(lat_deg, lon_deg, spacing_m):
    """Return the grid around a place, as AP_Terrain::calculate_grid_info numbers it."""
    lat, lon = round(lat_deg * 1e7), round(lon_deg * 1e7)
    ref_lat, ref_lon = math.floor(lat / 1e7) * 10**7, math.floor(lon / 1e7) * 10**7
    north_m = (lat - ref_lat) * UNIT_M
    east_m = (lon - ref_lon) * UNIT_M * math.cos(math.radians((lat + ref_lat) / 2e7))
    row, col = int(north_m / spacing_m) // 24 * 24, int(east_m / spacing_m) // 28 * 28
    lat_units = int(row * spacing_m / UNIT_M)
    scale = math.cos(math.radians((ref_lat + lat_units / 2) / 1e7))
    return ref_lat + lat_units, ref_lon + int(col * spacing_m / UNIT_M / scale)


def ap_indices(lat_deg, lon_deg, spacing_m):
    """Return row and column of a place from its whole degree, as calculate_grid_info computes them."""
    ref_lat, ref_lon = math.floor(lat_deg), math.floor(lon_deg)
    north_m = (lat_deg - ref_lat) * 1e7 * UNIT_M
    east_m = (lon_deg - ref_lon) * 1e7 * UNIT_M * math.cos(math.radians((lat_deg + ref_lat) / 2))
    return north_m / spacing_m, east_m / spacing_m


@given(st.floats(-60, 60), st.floats(-179, 179), st.sampled_from([30, 100, 150]), st.integers(0, 55))
def test_nodes_lie_where_the_autopilot_looks_them_up(lat_deg, lon_deg, spacing_m, block):
    corner = corner_of(lat_deg, lon_deg, spacing_m)
    places = node_places_deg(*corner, spacing_m, block)
    whole = math.floor(corner[0] / 1e7), math.floor(corner[1] / 1e7)
    rows, cols = zip(*(ap_indices(*place, spacing_m) for place in places), strict=True)
    if all((math.floor(lat), math.floor(lon)) == whole for lat, lon in places):
        np.testing.assert_allclose(rows, np.repeat(np.rint(rows[0]) + np.arange(4), 4), atol=1e-3)
        np.testing.assert_allclose(cols, np.tile(np.rint(cols[0]) + np.arange(4), 4), atol=1e-3)


def test_a_block_has_the_heights_of_its_nodes():
    server, record = TerrainServer(hills(), FRAME), TerrainRecord()
    lat, lon = corner_of(46.8, 9.8, 100)
    server.receive(record, dialect.MAVLink_terrain_request_message(lat, lon, 100, 1 << 13))
    (message,), unknown = server.poll(record, NS_PER_S)
    assert unknown is None
    (frame,) = scan(Encoder().pack(message, 0)).frames
    found = frame.message()
    assert (found.lat, found.lon, found.grid_spacing, found.gridbit) == (lat, lon, 100, 13)
    for place, height_m in zip(node_places_deg(lat, lon, 100, 13), found.data, strict=True):
        east_m, north_m = FRAME.to_local(*place)
        assert height_m == pytest.approx(1500.0 + 0.1 * east_m - 0.2 * north_m, abs=0.51)
    assert server.poll(record, 2 * NS_PER_S) == ([], None)


def test_ten_blocks_a_second_are_sent_until_all_are():
    server, record = TerrainServer(hills(), FRAME), TerrainRecord()
    lat, lon = corner_of(46.8, 9.8, 100)
    server.receive(record, dialect.MAVLink_terrain_request_message(lat, lon, 100, ALL))
    sent = []
    times = []
    for tick in range(200):
        messages, _ = server.poll(record, NS_PER_S + tick * NS_PER_S // 20)
        sent += [message.gridbit for message in messages]
        times += [tick / 20] * len(messages)
    assert sorted(sent) == list(range(56))
    assert sum(at < 1.0 for at in times) <= 15
    assert 5.0 < times[-1] < 6.0


def test_a_newer_request_takes_the_place_of_the_one_before():
    server, record = TerrainServer(hills(), FRAME), TerrainRecord()
    lat, lon = corner_of(46.8, 9.8, 100)
    server.receive(record, dialect.MAVLink_terrain_request_message(lat, lon, 100, ALL))
    server.receive(record, dialect.MAVLink_terrain_request_message(lat, lon, 30, 2))
    messages, _ = server.poll(record, NS_PER_S)
    assert [(message.grid_spacing, message.gridbit) for message in messages] == [(30, 1)]


def test_places_outside_the_elevation_model_are_not_answered_and_said_once():
    server, record = TerrainServer(hills(2000.0), FRAME), TerrainRecord()
    lat, lon = corner_of(46.8, 9.8, 100)
    told = []
    sent = 0
    for tick in range(300):
        if tick % 40 == 0:
            server.receive(record, dialect.MAVLink_terrain_request_message(lat, lon, 100, ALL))
        messages, unknown = server.poll(record, NS_PER_S + tick * NS_PER_S // 20)
        sent += len(messages)
        told += [] if unknown is None else [unknown]
    assert 0 < sent < 8 * 56
    assert len(told) == 1
    east_m, north_m = FRAME.to_local(*told[0])
    assert max(abs(east_m), abs(north_m)) > 1000.0


@pytest.mark.parametrize("request_", [(0, 0, 0, ALL), (2**31 - 1, 0, 100, ALL), (0, -(2**31), 100, ALL)])
def test_senseless_requests_are_ignored(request_):
    server, record = TerrainServer(hills(), FRAME), TerrainRecord()
    server.receive(record, dialect.MAVLink_terrain_request_message(*request_))
    assert record.mask == 0
