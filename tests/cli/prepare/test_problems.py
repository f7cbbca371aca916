"""`gcs plan --scen`: problems of the Moving AI benchmarks, solved in their lengths or said to be wrong."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from gcs.cli import app

MAP = "type octile\nheight 4\nwidth 5\nmap\n.....\n.@@@.\n...@.\n....T\n"
LENGTHS = [(0, "0 0 4 0", "4"), (1, "2 2 4 2", "10"), (2, "0 3 4 2", "9"), (2, "3 3 0 0", "5.41421356")]


@pytest.fixture
def files(tmp_path):
    """Write a map and its problems; returns the arguments that name them."""

    def write(lengths=LENGTHS, shape="5 4"):
        (tmp_path / "tiny.map").write_text(MAP, encoding="utf-8")
        lines = [f"{bucket} tiny.map {shape} {ends} {length}" for bucket, ends, length in lengths]
        (tmp_path / "tiny.scen").write_text("\n".join(["version 1", *lines]), encoding="utf-8")
        return ["--map", str(tmp_path / "tiny.map"), "--scen", str(tmp_path / "tiny.scen")]

    return write


def solve(*arguments):
    result = CliRunner().invoke(app, ["plan", *arguments, "--json"], catch_exceptions=False)
    lines = result.stdout.splitlines()
    return result.exit_code, json.loads(lines[-1]) if lines else None, result.output


def test_problems_are_solved_in_their_optimal_lengths_bucket_by_bucket(files):
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


def test_a_length_that_is_not_ours_is_said_with_its_problem_and_fails(files):
    code, found, said = solve(*files([*LENGTHS, (3, "0 0 4 2", "5.41421356")]))
    assert code == 1
    [wrong] = found["wrong"]
    assert (wrong["start"], wrong["goal"], wrong["optimal_length"]) == ([0, 0], [4, 2], 5.41421356)
    assert wrong["length"] == pytest.approx(6.0)
    assert "wrong: bucket 3, 0,0 to 4,2: 6.00000000" in said


def test_six_digits_of_a_length_are_enough(files):
    assert solve(*files([(0, "3 3 0 0", "5.41421")]))[0] == 0
    assert solve(*files([(0, "3 3 0 0", "5.4143")]))[0] == 1


@pytest.mark.parametrize("ends", ["0 0 1 1", "1 1 0 0", "0 0 5 0", "0 -1 0 0"])
def test_a_problem_that_ends_in_a_wall_or_off_the_map_has_no_path(files, ends):
    code, found, _ = solve(*files([(0, ends, "1")]))
    assert code == 1
    assert found["wrong"][0]["length"] is None


def test_a_limit_takes_problems_from_the_whole_file(files):
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
def test_files_that_do_not_fit_are_mistakes_and_no_wrong_lengths(files, lengths, shape, message):
    code, found, said = solve(*files(lengths, shape))
    assert (code, found) == (2, None)
    assert message in " ".join(said.split())


def test_problems_need_a_map_and_go_with_no_places(files, tmp_path):
    given = files()
    for arguments, message in (
        (given[2:], "with --map FILE.map"),
        ([*given, "--agents", "0,0"], "goes with --map"),
        ([*given[:2], "--scen", str(tmp_path / "none.scen")], "cannot be read"),
    ):
        code, found, said = solve(*arguments)
        assert (code, found) == (2, None)
        assert message in " ".join(said.split())
