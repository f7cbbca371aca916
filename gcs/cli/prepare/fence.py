"""`gcs fence`: bring the mission file's fence and rally points to the vehicles, show them, clear them.

Exit codes: 0 done for all, 1 not for somebody, 2 a mistake in the arguments or the mission file.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.table import Table

from gcs.cli.errors import complain
from gcs.cli.vehicle_names import names, vehicle_named
from gcs.errors import GcsError
from gcs.io.console import console_for

if TYPE_CHECKING:
    from gcs.config import Config
    from gcs.io.vehicles.geofence import Fencing

app = typer.Typer(
    help="""The fence and the rally points of a mission file, and of its vehicles.

    Nothing else in this project sends a fence to a vehicle. What is uploaded counts when it was read back
    equal. Whether a vehicle heeds its fence is its own parameters' to say: `gcs preflight` shows them.""",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)

ConfigArgument = Annotated[str, typer.Argument(help="A mission file.", metavar="CONFIG")]
VehicleOption = Annotated[
    list[int] | None,
    typer.Option(
        "--vehicle",
        "-v",
        parser=vehicle_named,
        metavar="ID",
        help="Only this vehicle, with its network as 2:17 when that is not 0; repeat it.  [default: all]",
    ),
]
WaitOption = Annotated[float, typer.Option("--wait", min=1.0, help="Seconds to wait until all is done.")]
LinkOption = Annotated[
    str | None, typer.Option("--link", help="Where the vehicles are.  [default: the mission file's links]")
]
YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask.")]
JsonOption = Annotated[bool, typer.Option("--json", help="End with one JSON object on its own line.")]


@app.command()
def upload(
    config: ConfigArgument,
    vehicle: VehicleOption = None,
    wait: WaitOption = 60.0,
    link: LinkOption = None,
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Replace the fence and the rally points of the vehicles by those of the mission file."""
    _run("upload", config, vehicle, wait, link, yes, as_json)


@app.command()
def show(
    config: ConfigArgument,
    vehicle: VehicleOption = None,
    wait: WaitOption = 30.0,
    link: LinkOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show what the vehicles hold."""
    _run("show", config, vehicle, wait, link, True, as_json)


@app.command()
def clear(
    config: ConfigArgument,
    vehicle: VehicleOption = None,
    wait: WaitOption = 60.0,
    link: LinkOption = None,
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Take the fence and the rally points from the vehicles."""
    _run("clear", config, vehicle, wait, link, yes, as_json)


def _run(
    action: Literal["upload", "show", "clear"],
    source: str,
    vehicles: list[int] | None,
    wait_s: float,
    link: str | None,
    yes: bool,
    as_json: bool,
) -> None:
    from gcs.config import load
    from gcs.io.vehicles.access import entrance_of
    from gcs.io.vehicles.geofence import fence_vehicles

    console = console_for(stderr=as_json)
    try:
        config = load(source)
        whom = chosen(config, vehicles)
        if not yes:
            _ask(action, whom)
        if words := entrance_of(config, link, writes=action != "show").words:
            console.print(words, highlight=False, markup=False, soft_wrap=True)
        talks = fence_vehicles(config, source, action, whom, wait_s, link)
    except GcsError as error:
        raise typer.Exit(complain(error)) from None
    console.print(_table(talks))
    ok = all(talk.ok for talk in talks)
    if as_json:
        rows = [{"vehicle": talk.vehicle, "ok": talk.ok, "steps": talk.rows()} for talk in talks]
        print(json.dumps({"action": action, "ok": ok, "vehicles": rows}), flush=True)  # noqa: T201
    raise typer.Exit(0 if ok else 1)


def chosen(config: Config, vehicles: list[int] | None) -> list[int]:
    """Return the vehicles that a command is for: those named, or all of the mission.

    Raises
    ------
    typer.BadParameter
        One of them is not of the mission.
    """
    known = [agent.vehicle for agent in config.agents]
    for vehicle in vehicles or ():
        if vehicle not in known:
            problem = f"{names([vehicle])} is none of the mission's"
            raise typer.BadParameter(problem, param_hint="--vehicle")
    return vehicles or known


def _ask(action: str, vehicles: list[int]) -> None:
    whom = names(vehicles)
    if not sys.stdin.isatty():
        raise typer.BadParameter(f"to {action} the fence of {whom} without somebody to ask, say --yes")
    typer.confirm(f"{action} fence and rally points of {whom}?", abort=True, err=True)


def _table(talks: Sequence[Fencing]) -> Table:
    from gcs.model import vehicle_name

    table = Table(pad_edge=False)
    for column in ("vehicle", "what", "", "how it went"):
        table.add_column(column)
    for talk in talks:
        for index, (what, ok, detail) in enumerate(talk.rows()):
            word = "[green]ok[/]" if ok else "[bold red]failed[/]"
            table.add_row(vehicle_name(talk.vehicle) if index == 0 else "", what, word, detail)
    return table
