"""An operator in the field, without internet, would have no map under the swarm."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from gcs.console.tiles import Tiles
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
    assert tiles.about()["max_zoom"] == 2
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
