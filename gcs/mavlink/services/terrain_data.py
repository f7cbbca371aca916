"""Terrain for autopilots: TERRAIN_REQUEST of a vehicle, answered with TERRAIN_DATA.

https://mavlink.io/en/services/terrain.html. A request names the south-west corner of a grid, the distance of
its nodes and a mask of 56 blocks. A block has 4 x 4 heights, block number 8 r + c lies r blocks north and c
blocks east, and in it the node x north and y east has the place 4 x + y.

ArduPilot (AP_Terrain) numbers its nodes from whole degrees south-west of them. East of there it measures
along the parallel half-way between the whole degree and the node. So nodes of one column do not have one
longitude: in a grid of 100 m at 47° they differ by up to 18 m, and each is computed here as there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.geo import LocalFrame
from gcs.mavlink.frames.codec import Message
from gcs.model import NS_PER_S
from gcs.terrain.elevation_grid import Elevation

_METRES_PER_UNIT: Final = 0.011131884502145034
"""Length of 1e-7 degrees of latitude: ArduPilot's LOCATION_SCALING_FACTOR."""
_DEGREE: Final = 10_000_000
_BLOCK: Final = 4
_BLOCKS_EAST: Final = 8
_ALL_BLOCKS: Final = (1 << 56) - 1
_PERIOD_NS: Final = NS_PER_S // 10
_MAX_BURST: Final = 5
_MIN_SCALE: Final = 0.01


@dataclass(slots=True)
class TerrainRecord:
    """Newest request of a vehicle for terrain, and how far it is answered."""

    lat: int = 0
    """Latitude of the grid's corner in 1e-7 degrees."""
    lon: int = 0
    spacing_m: int = 0
    mask: int = 0
    """Blocks that are not answered yet, one bit for each."""
    next_ns: int = 0
    """Time of the next answer."""
    is_told: bool = False
    """True if the operator was notified that it asks for terrain that is not known."""


class TerrainServer:
    """Answers requests for terrain from an elevation model, ten blocks a second to each vehicle."""

    def __init__(self, elevation: Elevation, frame: LocalFrame) -> None:
        self._elevation = elevation
        self._frame = frame

    def receive(self, record: TerrainRecord, message: Message) -> None:
        """Process a TERRAIN_REQUEST; it takes the place of the one before."""
        is_on_earth = abs(message.lat) <= 90 * _DEGREE and abs(message.lon) <= 180 * _DEGREE
        if message.grid_spacing == 0 or not is_on_earth:
            return
        record.lat = message.lat
        record.lon = message.lon
        record.spacing_m = message.grid_spacing
        record.mask = message.mask & _ALL_BLOCKS

    def poll(self, record: TerrainRecord, t_ns: int) -> tuple[list[Message], tuple[float, float] | None]:
        """Return the answers that are due, and the first place in degrees that is asked for and not known."""
        messages: list[Message] = []
        unknown = None
        record.next_ns = max(record.next_ns, t_ns - (_MAX_BURST - 1) * _PERIOD_NS)
        while record.mask and record.next_ns <= t_ns:
            block = (record.mask & -record.mask).bit_length() - 1
            record.mask &= record.mask - 1
            places = node_places_deg(record.lat, record.lon, record.spacing_m, block)
            heights = self._elevation.heights_at(np.array([self._frame.to_local(*place) for place in places]))
            missing = np.flatnonzero(np.isnan(heights))
            if missing.size:
                if not record.is_told:
                    unknown = places[int(missing[0])]
                record.is_told = True
                continue
            record.next_ns += _PERIOD_NS
            data = np.rint(heights).astype(int).tolist()
            messages.append(
                dialect.MAVLink_terrain_data_message(record.lat, record.lon, record.spacing_m, block, data)
            )
        return messages, unknown


def node_places_deg(lat: int, lon: int, spacing_m: int, block: int) -> list[tuple[float, float]]:
    """Return latitude and longitude of the 16 nodes of a block, in degrees, as AP_Terrain places them.

    Parameters
    ----------
    lat, lon : int
        Corner of the grid, in 1e-7 degrees.
    spacing_m : int
        Distance of nodes.
    block : int
        Number of the block, 0 ... 55.
    """
    whole_lat = lat // _DEGREE * _DEGREE
    whole_lon = lon // _DEGREE * _DEGREE
    north = round((lat - whole_lat) * _METRES_PER_UNIT / spacing_m)
    east = round((lon - whole_lon) * _METRES_PER_UNIT * _scale(0.5 * (lat + whole_lat)) / spacing_m)
    row = north + block // _BLOCKS_EAST * _BLOCK
    col = east + block % _BLOCKS_EAST * _BLOCK
    places = []
    for x in range(row, row + _BLOCK):
        node_lat = whole_lat + x * spacing_m / _METRES_PER_UNIT
        per_unit_m = _METRES_PER_UNIT * _scale(0.5 * (node_lat + whole_lat))
        places += [
            (node_lat / _DEGREE, (whole_lon + y * spacing_m / per_unit_m) / _DEGREE)
            for y in range(col, col + _BLOCK)
        ]
    return places


def _scale(lat: float) -> float:
    """Return the ratio of a degree of longitude to one of latitude, at a latitude in 1e-7 degrees."""
    return max(math.cos(math.radians(lat / _DEGREE)), _MIN_SCALE)
