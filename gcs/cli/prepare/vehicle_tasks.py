"""Common part of `gcs fence` and `gcs param`: select vehicles, confirm, run tasks, print the results."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, NoReturn, Protocol, TypeVar

import typer
from rich.table import Table

from gcs.cli.arguments import confirm_or_abort, vehicles_text
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

if TYPE_CHECKING:
    from gcs.config import Config


class VehicleTask(Protocol):
    """Task on one vehicle."""

    vehicle: int

    @property
    def ok(self) -> bool:
        """True if every step succeeded."""


Task = TypeVar("Task", bound=VehicleTask)


def run_tasks(
    source: str,
    vehicles: list[int] | None,
    link: str | None,
    run: Callable[[Config, list[int]], list[Task]],
    *,
    writes: bool,
    question: str,
    as_json: bool,
) -> list[Task]:
    """Ask for confirmation if there is a question; return the task of each vehicle.

    Parameters
    ----------
    vehicles : list of int or None
        System ids; None for all vehicles of the mission.
    run : callable
        Runs the tasks on the vehicles of a mission.
    writes : bool
        True if something on the vehicles is to be changed.
    """
    from gcs.config import load
    from gcs.io.vehicles.vehicle_access import vehicle_access

    with exit_on_error(as_json=as_json):
        config = load(source)
        selected = _selected_vehicles(config, vehicles)
        if question:
            confirm_or_abort(f"{question} {vehicles_text(selected)}")
        if notice := vehicle_access(config, link, writes=writes).description:
            console_for(stderr=as_json).print(notice, highlight=False, markup=False, soft_wrap=True)
        return run(config, selected)


def _selected_vehicles(config: Config, vehicles: list[int] | None) -> list[int]:
    known = [agent.vehicle for agent in config.agents]
    for vehicle in vehicles or ():
        if vehicle not in known:
            problem = f"{vehicles_text([vehicle])} is not in the mission"
            raise typer.BadParameter(problem, param_hint="--vehicle")
    return vehicles or known


def exit_with_results(
    action: str,
    tasks: Sequence[Task],
    columns: Sequence[str],
    rows_of: Callable[[Task], Iterable[tuple[tuple[str, ...], bool, str]]],
    result: dict[str, object],
    *,
    as_json: bool,
) -> NoReturn:
    """Print a table of the results, and with --json the result; exit with 1 if a task failed.

    Parameters
    ----------
    columns : sequence of str
        Titles of the columns between the vehicle and the outcome.
    rows_of : callable
        Returns the rows of a task: cells of these columns, True if it succeeded, and details.
    """
    from gcs.model import vehicle_name

    table = Table(pad_edge=False)
    for column in ("vehicle", *columns, "", "result"):
        table.add_column(column, overflow="fold")
    for task in tasks:
        for index, (cells, ok, detail) in enumerate(rows_of(task)):
            mark = "[green]ok[/]" if ok else "[bold red]failed[/]"
            table.add_row(vehicle_name(task.vehicle) if index == 0 else "", *cells, mark, detail)
    console_for(stderr=as_json).print(table)
    ok = all(task.ok for task in tasks)
    if as_json:
        print(json.dumps({"action": action, "ok": ok, **result}), flush=True)  # noqa: T201
    raise typer.Exit(0 if ok else 1)
