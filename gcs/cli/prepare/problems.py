"""`gcs plan --map FILE.map --scen FILE.scen`: our paths against the optimal lengths of a Moving AI benchmark.

Older files give their lengths with six digits, so a length is right when it agrees to six.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from gcs.cli.warm_up_progress import PLANNING, load_kernels
from gcs.errors import ConfigError
from gcs.files import read_text
from gcs.planning.map.grid import Grid, Node
from gcs.planning.map.movingai import MAX_BYTES, Problem, read_map, read_problems
from gcs.planning.search.shortest import find_path

_DIGITS = 5e-6
"""Of a length: half of the sixth digit, at most."""
_MOST_SHOWN = 10
_ROWS = 25
"""Of the table: where there are more buckets, a row is of several."""
_BAR_ABOVE = 200


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one problem; lengths in cells, None where there is none."""

    bucket: int
    start: Node
    goal: Node
    optimal_length: float
    length: float | None
    expanded: int
    ms: float

    @property
    def is_right(self) -> bool:
        """Whether the path is as long as it must be."""
        return self.length is not None and self.error <= _DIGITS * max(self.optimal_length, 1.0)

    @property
    def error(self) -> float:
        """Distance from the optimal length."""
        return 0.0 if self.length is None else abs(self.length - self.optimal_length)


def run_problems(
    map_file: Path | None, scen_file: Path, limit: int | None, console: Console, *, as_json: bool
) -> int:
    """Solve the problems of a file, print a table by bucket, and return the exit code: 1 when any is wrong.

    With a `limit` as many problems, evenly from the whole file, since files begin with the short ones.

    Raises
    ------
    ConfigError
        When a file is not what it should be, or the problems are of a map of another size.
    """
    if map_file is None:
        raise ConfigError("--scen", "", "expected the map that the problems are of, with --map FILE.map")
    grid = read_map(_text(map_file), str(map_file))
    problems = read_problems(_text(scen_file), str(scen_file))
    if not problems:
        raise ConfigError(str(scen_file), "", "no problem in it")
    for problem in problems:
        if problem.shape != grid.shape:
            (height, width), (rows, cols) = problem.shape, grid.shape
            raise ConfigError(
                str(scen_file),
                problem.map_name,
                f"expected a map of {width} x {height}; {map_file.name} is {cols} x {rows}",
            )
    if limit is not None and limit < len(problems):
        problems = tuple(problems[k] for k in np.linspace(0, len(problems) - 1, limit).round().astype(int))
    load_kernels(console, PLANNING)
    solve(grid, problems[0])
    shown = track(problems, "searching", console=console, transient=True, disable=len(problems) < _BAR_ABOVE)
    outcomes = [solve(grid, problem) for problem in shown]
    _show(outcomes, console)
    if as_json:
        print(json.dumps(_plain(outcomes)), flush=True)  # noqa: T201  the promised last line
    return 0 if all(outcome.is_right for outcome in outcomes) else 1


def _text(path: Path) -> str:
    try:
        return read_text(path, MAX_BYTES)
    except OSError as error:
        raise ConfigError(str(path), "", f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(str(path), "", f"cannot be read: {error}") from None


def solve(grid: Grid, problem: Problem) -> Outcome:
    """Search the path of one problem. From, or to, a place that is off the map or blocked there is none."""
    rows, cols = grid.shape
    ends = (problem.start, problem.goal)
    began = time.process_time_ns()
    length, expanded = None, 0
    if all(0 <= row < rows and 0 <= col < cols and not grid.blocked[row, col] for row, col in ends):
        path = find_path(grid, *ends)
        if path is not None:
            length, expanded = path.length_m / grid.spacing_m, path.expanded
    ms = (time.process_time_ns() - began) / 1e6
    return Outcome(problem.bucket, *ends, problem.optimal_length, length, expanded, ms)


def _summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    return {
        "problems": len(outcomes),
        "wrong": sum(not outcome.is_right for outcome in outcomes),
        "longest": max(outcome.optimal_length for outcome in outcomes),
        "greatest_error": max(outcome.error for outcome in outcomes),
        "median_expanded": float(np.median([outcome.expanded for outcome in outcomes])),
        "median_ms": float(np.median([outcome.ms for outcome in outcomes])),
        "total_ms": sum(outcome.ms for outcome in outcomes),
    }


def _buckets(outcomes: Sequence[Outcome], width: int = 1) -> dict[int, dict[str, Any]]:
    """Sum up by bucket, or by so many neighbouring ones; by the lowest of them."""
    ordered = sorted(outcomes, key=lambda one: one.bucket)
    return {
        index * width: _summary(list(some))
        for index, some in groupby(ordered, lambda one: one.bucket // width)
    }


def _plain(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return what a script reads; nodes as in the file, x and y."""
    wrong = [asdict(outcome) for outcome in outcomes if not outcome.is_right]
    for one in wrong:
        one["start"], one["goal"] = one["start"][::-1], one["goal"][::-1]
    buckets = [{"bucket": bucket, **summary} for bucket, summary in _buckets(outcomes).items()]
    return {"all": _summary(outcomes), "buckets": buckets, "wrong": wrong}


def _show(outcomes: Sequence[Outcome], console: Console) -> None:
    table = Table()
    for heading in ("bucket", "problems", "wrong", "longest", "greatest error", "nodes looked at", "ms"):
        table.add_column(heading, justify="right")
    width = 1 + max(outcome.bucket for outcome in outcomes) // _ROWS
    for bucket, summary in _buckets(outcomes, width).items():
        _row(table, str(bucket) if width == 1 else f"{bucket} - {bucket + width - 1}", summary)
    table.add_section()
    _row(table, "all", _summary(outcomes))
    console.print(table)
    console.print("nodes and ms: medians; CPU time, one thread", style="dim", highlight=False)
    wrong = [outcome for outcome in outcomes if not outcome.is_right]
    for one in wrong[:_MOST_SHOWN]:
        found = "no path" if one.length is None else f"{one.length:.8f}"
        (y0, x0), (y1, x1) = one.start, one.goal
        console.print(
            f"[red]wrong:[/] bucket {one.bucket}, {x0},{y0} to {x1},{y1}: {found}, "
            f"optimal {one.optimal_length:.8f}",
            highlight=False,
        )
    if len(wrong) > _MOST_SHOWN:
        console.print(f"... and {len(wrong) - _MOST_SHOWN} more", highlight=False)


def _row(table: Table, name: str, summary: dict[str, Any]) -> None:
    table.add_row(
        name,
        str(summary["problems"]),
        f"[red]{summary['wrong']}[/]" if summary["wrong"] else "0",
        f"{summary['longest']:.1f}",
        f"{summary['greatest_error']:.1e}",
        f"{summary['median_expanded']:,.0f}",
        f"{summary['median_ms']:.3f}",
    )
