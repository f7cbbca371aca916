"""Map tiles of a local MBTiles file, raster only: https://github.com/mapbox/mbtiles-spec (1.3)."""

from __future__ import annotations

import sqlite3
import threading
from pathlib import Path
from typing import Final
from urllib.parse import quote

from gcs.console.view.page_records import TilesInfo
from gcs.errors import ConsoleError

_MEDIA_TYPES: Final = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_MAX_ZOOM: Final = 24


class Tiles:
    """An MBTiles file, open for reading.

    Raises
    ------
    ConsoleError
        When the file cannot be read, or has no raster tiles.
    """

    def __init__(self, path: Path) -> None:
        try:
            uri = f"file:{quote(str(path.resolve()))}?mode=ro"
            self._file = sqlite3.connect(uri, uri=True, check_same_thread=False)
            rows = dict(self._file.execute("SELECT name, value FROM metadata"))
            lowest, highest = self._file.execute(
                "SELECT min(zoom_level), max(zoom_level) FROM tiles"
            ).fetchone()
        except (sqlite3.Error, ValueError) as error:
            raise ConsoleError(f"console: {path} cannot be read as MBTiles ({error})") from None
        self._lock = threading.Lock()
        self.media_type = _MEDIA_TYPES.get(str(rows.get("format", "")).lower(), "")
        if not self.media_type or lowest is None:
            raise ConsoleError(
                f"console: {path} has no raster tiles: expected the format png, jpg or webp, got "
                f"{rows.get('format', 'none')!r}"
            )
        attribution = str(rows.get("attribution", ""))
        self.info = TilesInfo(int(lowest), min(int(highest), _MAX_ZOOM), attribution)
        """Zoom levels and attribution."""

    def tile(self, zoom: int, column: int, row: int) -> bytes | None:
        """Return a tile, rows counted from the north; None if the file has none there."""
        if not 0 <= zoom <= _MAX_ZOOM:
            return None
        south = 2**zoom - 1 - row  # rows of the file are counted from the south
        query = "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        try:
            with self._lock:
                found = self._file.execute(query, (zoom, column, south)).fetchone()
        except (sqlite3.Error, OverflowError):
            return None
        return None if found is None else bytes(found[0])
