"""The Moving AI benchmarks: maps, and problems with known optimal lengths.

After N. R. Sturtevant, "Benchmarks for Grid-Based Pathfinding", IEEE TCIAIG 4, 2012; formats:
https://movingai.com/benchmarks/formats.html.

A `.map` file has four lines of header (`type octile`, `height H`, `width W`, `map`) and H lines of W
characters: `.` and `G` are ground, `S` is swamp, which one can walk; `@` and `O` are out of bounds, `T` is
trees, `W` is water, which one cannot enter from ground. x counts columns from the left, y rows from the top.
Here row y of the file is row y of the grid, so that (x, y) means the same in both; a picture of it has y
pointing down.

A `.scen` file begins with `version 1`; each line behind it is a problem: bucket, map, width, height, start x,
start y, goal x, goal y, optimal length. Diagonals count sqrt(2) and do not cut corners, as everywhere here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.errors import ConfigError
from gcs.planning.map.grid import Grid, Node

_GROUND, _WALLS = b".GS", b"@OTW"
_MOST_CELLS = 16_777_216
"""4096 x 4096; the benchmarks' largest maps have 2048 x 2048."""
_MOST_LINES = 65_536
MAX_BYTES = 32_000_000
"""Of a file, maps and problems."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One line of a `.scen` file; nodes are (row, col), the length is in cells."""

    bucket: int
    map_name: str
    shape: tuple[int, int]
    """(height, width) of the map that is meant."""
    start: Node
    goal: Node
    optimal_length: float


def read_map(text: str, source: str) -> Grid:
    """Read the text of a `.map` file: a grid with cells of 1 m.

    Raises
    ------
    ConfigError
        With `source`, the line at fault and what was expected there.
    """
    if text.count("\n") > _MOST_LINES:
        raise ConfigError(source, "", f"expected a map of at most {_MOST_LINES} lines")
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
            source, "line 1", "expected a Moving AI map: type, height, width and map, a line each"
        )
    try:
        height, width = int(header["height"]), int(header["width"])
    except (KeyError, ValueError):
        raise ConfigError(
            source, "header", "expected `height` and `width` with a whole number each"
        ) from None
    if not (height > 0 and width > 0 and height * width <= _MOST_CELLS):
        raise ConfigError(source, "header", f"{width} x {height} is no size for a map")
    while lines and not lines[-1].strip():
        lines.pop()
    if len(lines) != height:
        raise ConfigError(source, f"line {len(header) + 1}", f"expected {height} rows, found {len(lines)}")
    blocked = np.empty((height, width), dtype=np.bool_)
    for row, line in enumerate(lines):
        cells = line.rstrip().encode("ascii", errors="replace")
        where = f"line {len(header) + row + 1}"
        if len(cells) != width:
            raise ConfigError(source, where, f"expected {width} characters, found {len(cells)}")
        if strange := cells.strip(_GROUND + _WALLS).translate(None, _GROUND + _WALLS):
            raise ConfigError(
                source, where, f"expected . G S (ground) or @ O T W (blocked), not {chr(strange[0])!r}"
            )
        blocked[row] = np.isin(np.frombuffer(cells, dtype=np.uint8), np.frombuffer(_WALLS, dtype=np.uint8))
    return Grid((0.0, 0.0), 1.0, blocked)


def read_problems(text: str, source: str) -> tuple[Problem, ...]:
    """Read the text of a `.scen` file.

    Raises
    ------
    ConfigError
        With `source`, the line at fault and what was expected there.
    """
    problems = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or (number == 1 and line.split()[0] == "version"):
            continue
        # Names of maps may have spaces in them, so newer files separate by tabs.
        words = line.strip().split("\t") if "\t" in line else line.split()
        try:
            bucket, width, height, *ends = (int(word) for word in (words[0], *words[2:8]))
            start_x, start_y, goal_x, goal_y = ends
            length = float(words[8])
        except (ValueError, IndexError):
            raise ConfigError(
                source,
                f"line {number}",
                "expected bucket, map, width, height, start x, start y, goal x, goal y, optimal length",
            ) from None
        if not math.isfinite(length):
            raise ConfigError(source, f"line {number}", "the optimal length is not a number")
        problems.append(
            Problem(bucket, words[1], (height, width), (start_y, start_x), (goal_y, goal_x), length)
        )
    return tuple(problems)
