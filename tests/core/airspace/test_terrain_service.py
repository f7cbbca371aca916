"""An ArduPlane that asks for terrain would hear nothing, or hear it without an elevation model."""

from __future__ import annotations

import json

import numpy as np
from helpers.noticed import noticed
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import parse
from gcs.core.engine import Engine
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.model import NS_PER_S, Datagram, NoticeCode, Send, Tick
from gcs.terrain.elevation_grid import Elevation
from gcs.terrain.elevation_text import ElevationModel, encode_model

LINK, PEER = "udpin:0.0.0.0:14550", "10.0.0.5:50"
MISSION = """
name = "hills"
[frame]
lat_deg = 46.8
lon_deg = 9.8
alt_msl_m = 1500.0
[[agents]]
system_id = 1
east_m = 1000.0
north_m = 1000.0
"""
LEVEL = Elevation((-500.0, -500.0), 100.0, np.full((31, 31), 1500.0))
"""The ground of the map and 500 m around it."""
TERRAIN = f"\n[terrain]\nfile = {json.dumps(encode_model(ElevationModel('hills.tif', 100.0, LEVEL)))}\n"


class Flight:
    """An engine, and a vehicle that is heard."""

    def __init__(self, text: str) -> None:
        self.engine, self.t_ns = Engine(parse(text, "x"), 1), NS_PER_S
        self.effects: list = []
        self.say(dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3))

    def say(self, message) -> None:
        self.effects += self.engine.step(Datagram(self.t_ns, LINK, PEER, Encoder(1, 1)(message)))

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            self.t_ns += NS_PER_S // 20
            self.say(dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3))
            self.effects += self.engine.step(Tick(self.t_ns))

    def blocks(self) -> list:
        sent = [frame for one in self.effects if isinstance(one, Send) for frame in scan(one.data).frames]
        return [frame.message() for frame in sent if frame.message_id == dialect.MAVLINK_MSG_ID_TERRAIN_DATA]


def request(spacing_m: int = 30):
    """Return a request for the grid whose corner lies at the map's."""
    return dialect.MAVLink_terrain_request_message(468_000_000, 98_000_000, spacing_m, (1 << 56) - 1)


def test_a_vehicle_gets_the_terrain_that_it_asks_for():
    flight = Flight(MISSION + TERRAIN)
    flight.say(request())
    flight.wait(7.0)
    assert sorted(block.gridbit for block in flight.blocks()) == list(range(56))
    assert {height for block in flight.blocks() for height in block.data} == {1500}
    assert noticed(flight.effects, NoticeCode.TERRAIN_UNKNOWN) == []


def test_ground_that_is_not_known_is_said_once():
    flight = Flight(MISSION + TERRAIN)
    for _ in range(3):
        flight.say(request(spacing_m=100))
        flight.wait(7.0)
    assert 0 < len({block.gridbit for block in flight.blocks()}) < 56
    (notice,) = noticed(flight.effects, NoticeCode.TERRAIN_UNKNOWN)
    assert notice.vehicle == 1


def test_a_silent_vehicle_gets_nothing():
    flight = Flight(MISSION + TERRAIN)
    flight.say(request())
    for second in range(60):
        flight.effects += flight.engine.step(Tick(flight.t_ns + second * NS_PER_S))
    assert len(flight.blocks()) < 56


def test_without_terrain_nothing_is_sent():
    flight = Flight(MISSION)
    flight.say(request())
    flight.wait(3.0)
    assert flight.blocks() == []
