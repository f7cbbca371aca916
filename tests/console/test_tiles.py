"""An operator in the field, without internet, would have no map under the swarm."""

from __future__ import annotations

import math
import re
import sqlite3
import struct
import time
import zlib
from pathlib import Path

import pytest
from playwright.sync_api import expect

from gcs.config import load
from gcs.console.web.tiles import Tiles
from gcs.errors import ConsoleError


def mbtiles(path: Path, form: str = "png") -> Path:
    """Write a file with one tile: zoom 2, column 1, third row from the north."""
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE metadata (name text, value text)")
        file.execute("CREATE TABLE tiles (zoom_level int, tile_column int, tile_row int, tile_data blob)")
        file.execute("INSERT INTO metadata VALUES ('format', ?)", (form,))
        file.execute("INSERT INTO tiles VALUES (2, 1, 1, x'0102')")
    file.close()
    return path


def test_rows_of_a_tile_are_counted_from_the_north(tmp_path):
    tiles = Tiles(mbtiles(tmp_path / "a map?.mbtiles"))
    assert tiles.info.max_zoom == 2
    assert tiles.tile(2, 1, 2) == b"\x01\x02"
    assert tiles.tile(2, 1, 1) is None
    assert tiles.tile(99, 0, 0) is None
    assert tiles.tile(2, 10**30, 0) is None


@pytest.mark.parametrize("form", ["pbf", ""])
def test_vector_tiles_are_refused_before_a_run_starts(tmp_path, form):
    with pytest.raises(ConsoleError, match="raster"):
        Tiles(mbtiles(tmp_path / "vector.mbtiles", form))


def test_another_file_is_refused_with_its_name(tmp_path):
    (tmp_path / "notes.txt").write_text("no map" * 1000)
    with pytest.raises(ConsoleError, match=r"notes\.txt cannot be read as MBTiles"):
        Tiles(tmp_path / "notes.txt")
    with pytest.raises(ConsoleError, match="missing"):
        Tiles(tmp_path / "missing.mbtiles")


def png(*rgb: int) -> bytes:
    """Return a picture of one pixel."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head, data = struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0), zlib.compress(bytes((0, *rgb)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


@pytest.mark.real_time
def test_tiles_are_drawn_where_they_are_on_the_earth(fly, page, tmp_path):
    """Tiles are red west of a meridian through the mission's area, and blue east of it."""
    zoom, frame = 15, load("prescribed").local_frame
    column = math.floor((frame.lon_deg + 180.0) / 360.0 * 2**zoom) + 1
    meridian_m, _ = frame.to_local(frame.lat_deg, column / 2**zoom * 360.0 - 180.0)
    row = (1.0 - math.asinh(math.tan(math.radians(frame.lat_deg))) / math.pi) / 2.0 * 2**zoom
    with sqlite3.connect(mbtiles(tmp_path / "map.mbtiles")) as file:
        file.execute("DELETE FROM tiles")
        for across in range(-3, 3):
            for south in range(2**zoom - 1 - int(row) - 3, 2**zoom - 1 - int(row) + 4):
                tile = (zoom, column + across, south, png(255, 0, 0) if across < 0 else png(0, 0, 255))
                file.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", tile)
    with fly(tiles=Tiles(tmp_path / "map.mbtiles")) as flight:
        page.goto(flight.url)
        expect(page.locator("#vehicles tbody tr")).to_have_count(4)
        canvas = page.locator("#map canvas")
        colour = "(canvas, [x, y]) => [...canvas.getContext('2d').getImageData(x, y, 1, 1).data]"
        until_s, tint = time.monotonic() + 20.0, 0
        while abs(tint) < 30:
            assert time.monotonic() < until_s, "no tile was drawn"
            red, _, blue, _ = canvas.evaluate(colour, [203, 203])
            tint = red - blue
        found = set()
        for x in range(103, 600, 25):
            canvas.hover(position={"x": x, "y": 203})
            place = re.search(r"E (-?\d+)", page.locator("#map .place").inner_text())
            east_m = float(place[1])
            red, _, blue, _ = canvas.evaluate(colour, [x, 203])
            if abs(east_m - meridian_m) > 5.0 and abs(red - blue) > 30:
                found.add((east_m < meridian_m, red > blue))
        assert found == {(True, True), (False, False)}
