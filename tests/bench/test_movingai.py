"""Moving AI maps: read as the benchmark defines them, with its optimal path lengths."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.grid_paths import find_path
from movingai import read_map

from gcs.errors import ConfigError

MAP = """type octile
height 6
width 8
map
........
.@@@@@..
.@GS.T..
.@.WWO..
.@......
........
"""
PROBLEMS = [((0, 0), (0, 7), 7.0), ((3, 2), (0, 0), 9.0), ((2, 3), (5, 7), 8.41421356)]
"""Start and goal as (row, col), and the optimal length."""


def test_a_map_is_free_where_one_can_walk():
    grid = read_map(MAP, "tiny.map")
    assert grid.shape == (6, 8)
    assert grid.spacing_m == 1.0
    rows = ["".join("@" if cell else "." for cell in row) for row in grid.blocked]
    assert rows == ["........", ".@@@@@..", ".@...@..", ".@.@@@..", ".@......", "........"]


def test_paths_have_the_optimal_lengths_of_the_problems():
    """The lengths were counted by hand: diagonals sqrt(2), none past a blocked cell."""
    grid = read_map(MAP, "tiny.map")
    for start, goal, optimal_length in PROBLEMS:
        path = find_path(grid, start, goal)
        assert path is not None
        assert path.length_m == pytest.approx(optimal_length, abs=1e-6)


def test_lines_may_have_windows_line_ends():
    assert np.array_equal(read_map(MAP.replace("\n", "\r\n"), "f").blocked, read_map(MAP, "f").blocked)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a Moving AI map"),
        (MAP.replace("height 6", "height six"), "header: expected `height` and `width`"),
        (MAP.replace("height 6", "height 7"), "expected 7 rows, found 6"),
        (MAP.replace("width 8", "width 9"), "line 5: expected 9 characters, found 8"),
        (MAP.replace("GS", "GX"), "line 7: expected .* not 'X'"),
        (MAP.replace("GS", "Gé"), "line 7: expected"),
        (MAP.replace("height 6", "height 999999999"), "no size for a map"),
        ("type octile\nheight 8000000\nwidth 2\nmap\n" + "..\n" * 8_000_000, "lines"),
    ],
)
def test_a_broken_map_is_refused_with_the_line_at_fault(text, message):
    with pytest.raises(ConfigError, match=message):
        read_map(text, "tiny.map")
