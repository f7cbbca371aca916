"""Moving AI maps and problems: read as the benchmark means them, solved in its optimal lengths."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.errors import ConfigError
from gcs.planning.map.movingai import read_map, read_problems
from gcs.planning.search.shortest import find_path

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
SCEN = """version 1
0\ttiny maps/a.map\t8\t6\t0\t0\t7\t0\t7.00000000
1\ttiny maps/a.map\t8\t6\t2\t3\t0\t0\t9.00000000
1\ttiny maps/a.map\t8\t6\t3\t2\t7\t5\t8.41421356
"""


def test_a_map_is_free_where_one_can_walk():
    grid = read_map(MAP, "tiny.map")
    assert grid.shape == (6, 8)
    assert grid.spacing_m == 1.0
    rows = ["".join("@" if cell else "." for cell in row) for row in grid.blocked]
    assert rows == ["........", ".@@@@@..", ".@...@..", ".@.@@@..", ".@......", "........"]


def test_problems_have_rows_from_y_and_columns_from_x():
    first, second, _ = read_problems(SCEN, "tiny.scen")
    assert first.map_name == "tiny maps/a.map"
    assert (first.start, first.goal, first.shape) == ((0, 0), (0, 7), (6, 8))
    assert second.start == (3, 2)
    assert second.optimal_length == pytest.approx(9.0)


def test_paths_have_the_optimal_lengths_of_the_problems():
    """The lengths were counted by hand: diagonals sqrt(2), none past a blocked cell."""
    grid = read_map(MAP, "tiny.map")
    for problem in read_problems(SCEN, "tiny.scen"):
        path = find_path(grid, problem.start, problem.goal)
        assert path is not None
        assert path.length_m == pytest.approx(problem.optimal_length, abs=1e-6)


def test_lines_may_end_as_windows_ends_them_and_words_be_separated_by_spaces():
    assert np.array_equal(read_map(MAP.replace("\n", "\r\n"), "f").blocked, read_map(MAP, "f").blocked)
    [problem] = read_problems("version 1.0\n3 a.map 8 6 1 2 3 4 5.5\n", "f")
    assert (problem.bucket, problem.start, problem.goal) == (3, (2, 1), (4, 3))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "expected a Moving AI map"),
        (MAP.replace("height 6", "height six"), "header: expected `height` and `width`"),
        (MAP.replace("height 6", "height 7"), "expected 7 rows, found 6"),
        (MAP.replace("width 8", "width 9"), "line 5: expected 9 characters, found 8"),
        (MAP.replace("GS", "GX"), "line 7: expected .* not 'X'"),
        (MAP.replace("GS", "Gé"), "line 7: expected"),
        (MAP.replace("height 6", "height 999999999"), "no size for a map"),
    ],
)
def test_a_broken_map_is_refused_with_the_line_at_fault(text, said):
    with pytest.raises(ConfigError, match=said):
        read_map(text, "tiny.map")


@pytest.mark.parametrize(
    "line", ["1 a.map 8 6 1 2 3", "1 a.map 8 6 1 2 3 4 far", "x a.map 8 6 1 2 3 4 5", "1"]
)
def test_a_broken_problem_is_refused_with_the_line_at_fault(line):
    with pytest.raises(ConfigError, match="line 2: expected bucket, map"):
        read_problems(f"version 1\n{line}\n", "tiny.scen")
    with pytest.raises(ConfigError, match="not a number"):
        read_problems(f"1 a.map 8 6 1 2 3 4 {math.nan}", "tiny.scen")
