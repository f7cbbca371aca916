"""Reader of Moving AI benchmark maps.

Source: N. R. Sturtevant, "Benchmarks for Grid-Based Pathfinding", IEEE TCIAIG 4, 2012; format:
https://movingai.com/benchmarks/formats.html.

A `.map` file has four header lines (`type octile`, `height H`, `width W`, `map`) and H lines of W characters.
`.` and `G` are ground and `S` is walkable swamp. `@` and `O` are out of bounds, `T` trees and `W` water: all
blocked. Row y of the file is row y of the grid, so a picture of the map has y pointing down.
"""

from __future__ import annotations

import numpy as np

from gcs.errors import ConfigError
from gcs.mistake_codes import MistakeCode
from gcs.planning.map.grid import Grid

_FREE_CHARS = b".GS"
_BLOCKED_CHARS = b"@OTW"
_MAX_CELLS = 16_777_216
"""4096 x 4096; the largest maps of the benchmark have 2048 x 2048."""
_MAX_LINES = 65_536
MAX_BYTES = 32_000_000
"""Maximum size of a file."""


def read_map(text: str, source: str) -> Grid:
    """Read the text of a `.map` file as a grid with cells of 1 m.

    Raises
    ------
    ConfigError
        Names `source`, the line at fault and what was expected there.
    """
    if text.count("\n") > _MAX_LINES:
        raise ConfigError(source, "", MistakeCode.TOO_LARGE, f"expected a map of at most {_MAX_LINES} lines")
    lines = text.split("\n")
    header = {}
    for number, line in enumerate(lines[:4]):
        words = line.split()
        header[words[0].lower() if words else ""] = words[1] if len(words) > 1 else ""
        if words[:1] == ["map"]:
            lines = lines[number + 1 :]
            break
    else:
        raise ConfigError(
            source,
            "line 1",
            MistakeCode.INVALID_FILE,
            "expected a Moving AI map: type, height, width and map, a line each",
        )
    try:
        height = int(header["height"])
        width = int(header["width"])
    except (KeyError, ValueError):
        raise ConfigError(
            source,
            "header",
            MistakeCode.MISSING_KEY,
            "expected `height` and `width` with a whole number each",
        ) from None
    if not (height > 0 and width > 0 and height * width <= _MAX_CELLS):
        raise ConfigError(
            source, "header", MistakeCode.OUT_OF_RANGE, f"{width} x {height} is no size for a map"
        )
    while lines and not lines[-1].strip():
        lines.pop()
    if len(lines) != height:
        raise ConfigError(
            source,
            f"line {len(header) + 1}",
            MistakeCode.INVALID_FILE,
            f"expected {height} rows, found {len(lines)}",
        )
    blocked = np.empty((height, width), dtype=np.bool_)
    for row, line in enumerate(lines):
        cells = line.rstrip().encode("ascii", errors="replace")
        where = f"line {len(header) + row + 1}"
        if len(cells) != width:
            raise ConfigError(
                source, where, MistakeCode.INVALID_FILE, f"expected {width} characters, found {len(cells)}"
            )
        if unknown := cells.strip(_FREE_CHARS + _BLOCKED_CHARS).translate(None, _FREE_CHARS + _BLOCKED_CHARS):
            raise ConfigError(
                source,
                where,
                MistakeCode.INVALID_FILE,
                f"expected . G S (ground) or @ O T W (blocked), not {chr(unknown[0])!r}",
            )
        blocked[row] = np.isin(
            np.frombuffer(cells, dtype=np.uint8), np.frombuffer(_BLOCKED_CHARS, dtype=np.uint8)
        )
    return Grid((0.0, 0.0), 1.0, blocked)
