"""Compare path lengths with the optimal lengths of a Moving AI benchmark.

    python tests/bench/bench_movingai.py FILE.map FILE.scen [--limit N] [--json]

Source: N. R. Sturtevant, "Benchmarks for Grid-Based Pathfinding", IEEE TCIAIG 4, 2012; formats:
https://movingai.com/benchmarks/formats.html. A `.scen` file begins with `version 1`. Each further line is a
problem: bucket, map, width, height, start x, start y, goal x, goal y, optimal length. Diagonals count sqrt(2)
and do not cut corners. Older files give lengths with six digits, so a length is right if it agrees to six.

Exit code: 0 if all lengths agree, 1 if any differs, 2 for a file that cannot be used.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from helpers.grid_paths import find_path
from movingai import MAX_BYTES, read_map

from gcs.errors import ConfigError
from gcs.files import read_text
from gcs.mistake_codes import MistakeCode
from gcs.planning.map.grid import Grid, Node
from gcs.planning.warm_up import warm_up

RELATIVE_TOLERANCE = 5e-6
"""Half of the sixth digit, at most."""
MAX_PROBLEMS_SHOWN = 10


@dataclass(frozen=True, slots=True)
class Problem:
    """One line of a `.scen` file. Nodes are (row, col), the length is in cells."""

    bucket: int
    map_name: str
    shape: tuple[int, int]
    """(height, width) of the map."""
    start: Node
    goal: Node
    optimal_length: float


@dataclass(frozen=True, slots=True)
class Solution:
    """Result of one problem. Lengths are in cells, None without a path."""

    bucket: int
    start: Node
    goal: Node
    optimal_length: float
    length: float | None
    expanded: int
    ms: float

    @property
    def is_right(self) -> bool:
        """True if the path is as long as the optimal one."""
        return self.length is not None and self.error <= RELATIVE_TOLERANCE * max(self.optimal_length, 1.0)

    @property
    def error(self) -> float:
        """Difference from the optimal length."""
        return 0.0 if self.length is None else abs(self.length - self.optimal_length)


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
        # Names of maps may contain spaces, so newer files separate by tabs.
        words = line.strip().split("\t") if "\t" in line else line.split()
        try:
            bucket, width, height, *ends = (int(word) for word in (words[0], *words[2:8]))
            start_x, start_y, goal_x, goal_y = ends
            length = float(words[8])
        except (ValueError, IndexError):
            raise ConfigError(
                source,
                f"line {number}",
                MistakeCode.INVALID_FILE,
                "expected bucket, map, width, height, start x, start y, goal x, goal y, optimal length",
            ) from None
        if not math.isfinite(length):
            raise ConfigError(
                source, f"line {number}", MistakeCode.WRONG_TYPE, "the optimal length is not a number"
            )
        problems.append(
            Problem(bucket, words[1], (height, width), (start_y, start_x), (goal_y, goal_x), length)
        )
    return tuple(problems)


def read_benchmark(map_file: Path, scen_file: Path) -> tuple[Grid, tuple[Problem, ...]]:
    """Read a map and its problems.

    Raises
    ------
    ConfigError
        If a file cannot be read, or the problems belong to a map of another size.
    """
    grid = read_map(_text(map_file), str(map_file))
    problems = read_problems(_text(scen_file), str(scen_file))
    if not problems:
        raise ConfigError(str(scen_file), "", MistakeCode.INVALID_FILE, "no problem in it")
    for problem in problems:
        if problem.shape != grid.shape:
            (height, width), (rows, cols) = problem.shape, grid.shape
            raise ConfigError(
                str(scen_file),
                problem.map_name,
                MistakeCode.CONFLICT,
                f"expected a map of {width} x {height}; {map_file.name} is {cols} x {rows}",
            )
    return grid, problems


def _text(path: Path) -> str:
    try:
        return read_text(path, MAX_BYTES)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(str(path), "", MistakeCode.NO_ACCESS, f"cannot be read: {error}") from None


def solve(grid: Grid, problem: Problem) -> Solution:
    """Search the path of one problem. A start or goal off the map or blocked has no path."""
    rows, cols = grid.shape
    ends = (problem.start, problem.goal)
    began = time.process_time_ns()
    length, expanded = None, 0
    if all(0 <= row < rows and 0 <= col < cols and not grid.blocked[row, col] for row, col in ends):
        path = find_path(grid, *ends)
        if path is not None:
            length, expanded = path.length_m / grid.spacing_m, path.expanded
    ms = (time.process_time_ns() - began) / 1e6
    return Solution(problem.bucket, *ends, problem.optimal_length, length, expanded, ms)


def summarise(solutions: Sequence[Solution]) -> dict[str, Any]:
    """Return counts, errors and times of some problems; times are CPU time of one thread."""
    return {
        "problems": len(solutions),
        "wrong": sum(not one.is_right for one in solutions),
        "longest": max(one.optimal_length for one in solutions),
        "greatest_error": max(one.error for one in solutions),
        "median_expanded": float(np.median([one.expanded for one in solutions])),
        "median_ms": float(np.median([one.ms for one in solutions])),
        "total_ms": sum(one.ms for one in solutions),
    }


def report(solutions: Sequence[Solution]) -> dict[str, Any]:
    """Return all results as plain data; nodes as in the file, (x, y)."""
    wrong = [asdict(one) for one in solutions if not one.is_right]
    for one in wrong:
        one["start"], one["goal"] = one["start"][::-1], one["goal"][::-1]
    ordered = sorted(solutions, key=lambda one: one.bucket)
    buckets = [
        {"bucket": bucket, **summarise(list(some))}
        for bucket, some in groupby(ordered, lambda one: one.bucket)
    ]
    return {"all": summarise(solutions), "buckets": buckets, "wrong": wrong}


def _show(found: dict[str, Any]) -> None:
    print("bucket  problems  wrong    longest  greatest error  expanded (median)  ms (median)")
    for row in [*found["buckets"], {"bucket": "all", **found["all"]}]:
        print(
            f"{row['bucket']:>6}{row['problems']:>10}{row['wrong']:>7}{row['longest']:>11.1f}"
            f"{row['greatest_error']:>16.1e}{row['median_expanded']:>19,.0f}{row['median_ms']:>13.3f}"
        )
    for one in found["wrong"][:MAX_PROBLEMS_SHOWN]:
        length = "no path" if one["length"] is None else f"{one['length']:.8f}"
        (x0, y0), (x1, y1) = one["start"], one["goal"]
        print(
            f"wrong: bucket {one['bucket']}, {x0},{y0} to {x1},{y1}: {length}, "
            f"optimal {one['optimal_length']:.8f}"
        )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=Path)
    parser.add_argument("scen", type=Path)
    parser.add_argument("--limit", type=int, help="solve only so many problems, evenly from the whole file")
    parser.add_argument("--json", action="store_true", help="end with one JSON object")
    arguments = parser.parse_args(argv)
    try:
        grid, problems = read_benchmark(arguments.map, arguments.scen)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return 2
    if arguments.limit is not None and arguments.limit < len(problems):
        chosen = np.linspace(0, len(problems) - 1, arguments.limit).round().astype(int)
        problems = tuple(problems[k] for k in chosen)
    warm_up()
    solve(grid, problems[0])
    found = report([solve(grid, problem) for problem in problems])
    _show(found)
    if arguments.json:
        print(json.dumps(found))
    return 0 if found["all"]["wrong"] == 0 else 1


if __name__ == "__main__":
    raise SystemExit(main())
