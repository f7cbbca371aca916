"""Moving AI problems: paths have the optimal lengths, and a wrong length is reported."""

from __future__ import annotations

import importlib.util
import json
import math
import sys
from pathlib import Path

import pytest

from gcs.errors import ConfigError

_spec = importlib.util.spec_from_file_location(
    "bench_movingai", Path(__file__).with_name("bench_movingai.py")
)
bench = importlib.util.module_from_spec(_spec)
sys.modules["bench_movingai"] = bench
_spec.loader.exec_module(bench)

MAP = "type octile\nheight 4\nwidth 5\nmap\n.....\n.@@@.\n...@.\n....T\n"
LENGTHS = [(0, "0 0 4 0", "4"), (1, "2 2 4 2", "10"), (2, "0 3 4 2", "9"), (2, "3 3 0 0", "5.41421356")]
SCEN = """version 1
0\ttiny maps/a.map\t8\t6\t0\t0\t7\t0\t7.00000000
1\ttiny maps/a.map\t8\t6\t2\t3\t0\t0\t9.00000000
"""


@pytest.fixture
def files(tmp_path):
    """Write a map and its problems; returns the arguments that name them."""

    def write(lengths=LENGTHS, shape="5 4"):
        (tmp_path / "tiny.map").write_text(MAP, encoding="utf-8")
        lines = [f"{bucket} tiny.map {shape} {ends} {length}" for bucket, ends, length in lengths]
        (tmp_path / "tiny.scen").write_text("\n".join(["version 1", *lines]), encoding="utf-8")
        return [str(tmp_path / "tiny.map"), str(tmp_path / "tiny.scen")]

    return write


@pytest.fixture
def solve(capsys):
    def run(*arguments):
        code = bench.main([*arguments, "--json"])
        printed = capsys.readouterr()
        lines = printed.out.splitlines()
        return code, json.loads(lines[-1]) if lines else None, printed.out + printed.err

    return run


def test_problems_are_solved_in_their_optimal_lengths_bucket_by_bucket(files, solve):
    """Lengths counted by hand: no corner is cut, so past a blocked cell a diagonal is none."""
    code, found, _ = solve(*files())
    assert code == 0
    assert [(b["bucket"], b["problems"], b["wrong"]) for b in found["buckets"]] == [
        (0, 1, 0),
        (1, 1, 0),
        (2, 2, 0),
    ]
    assert found["all"]["greatest_error"] < 1e-6
    assert found["wrong"] == []


def test_a_wrong_length_is_reported_with_its_problem_and_fails(files, solve):
    code, found, printed = solve(*files([*LENGTHS, (3, "0 0 4 2", "5.41421356")]))
    assert code == 1
    [wrong] = found["wrong"]
    assert (wrong["start"], wrong["goal"], wrong["optimal_length"]) == ([0, 0], [4, 2], 5.41421356)
    assert wrong["length"] == pytest.approx(6.0)
    assert "wrong: bucket 3, 0,0 to 4,2: 6.00000000" in printed


def test_six_digits_of_a_length_are_enough(files, solve):
    assert solve(*files([(0, "3 3 0 0", "5.41421")]))[0] == 0
    assert solve(*files([(0, "3 3 0 0", "5.4143")]))[0] == 1


@pytest.mark.parametrize("ends", ["0 0 1 1", "1 1 0 0", "0 0 5 0", "0 -1 0 0"])
def test_a_problem_that_ends_in_a_wall_or_off_the_map_has_no_path(files, solve, ends):
    code, found, _ = solve(*files([(0, ends, "1")]))
    assert code == 1
    assert found["wrong"][0]["length"] is None


def test_a_limit_takes_problems_from_the_whole_file(files, solve):
    _, found, _ = solve(*files(), "--limit", "2")
    assert [bucket["bucket"] for bucket in found["buckets"]] == [0, 2]


@pytest.mark.parametrize(
    ("lengths", "shape", "message"),
    [
        (LENGTHS, "4 5", "expected a map of 4 x 5; tiny.map is 5 x 4"),
        ([], "5 4", "no problem in it"),
        ([(0, "0 0", "4")], "5 4", "optimal length"),
    ],
)
def test_files_that_do_not_fit_are_refused(files, solve, lengths, shape, message):
    code, found, printed = solve(*files(lengths, shape))
    assert (code, found) == (2, None)
    assert message in printed


def test_a_missing_file_is_refused(files, solve, tmp_path):
    code, found, printed = solve(files()[0], str(tmp_path / "none.scen"))
    assert (code, found) == (2, None)
    assert "cannot be read" in printed


def test_problems_have_rows_from_y_and_columns_from_x():
    first, second = bench.read_problems(SCEN, "tiny.scen")
    assert first.map_name == "tiny maps/a.map"
    assert (first.start, first.goal, first.shape) == ((0, 0), (0, 7), (6, 8))
    assert second.start == (3, 2)
    assert second.optimal_length == pytest.approx(9.0)


def test_older_files_separate_by_spaces():
    [problem] = bench.read_problems("version 1.0\n3 a.map 8 6 1 2 3 4 5.5\n", "f")
    assert (problem.bucket, problem.start, problem.goal) == (3, (2, 1), (4, 3))


@pytest.mark.parametrize(
    "line", ["1 a.map 8 6 1 2 3", "1 a.map 8 6 1 2 3 4 far", "x a.map 8 6 1 2 3 4 5", "1"]
)
def test_a_broken_problem_is_refused_with_the_line_at_fault(line):
    with pytest.raises(ConfigError, match="line 2: expected bucket, map"):
        bench.read_problems(f"version 1\n{line}\n", "tiny.scen")
    with pytest.raises(ConfigError, match="not a number"):
        bench.read_problems(f"1 a.map 8 6 1 2 3 4 {math.nan}", "tiny.scen")
