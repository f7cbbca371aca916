"""`gcs fence`: upload, show or clear the fence and the rally points of vehicles.

Exit codes: 0 done for all vehicles; 1 failed for at least one; 2 a mistake in the arguments or the mission
file.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import typer
from rich.table import Table

from gcs.cli.arguments import (
    ConfigArgument,
    JsonOption,
    LinkOption,
    VehicleOption,
    WaitOption,
    YesOption,
    command_app,
    confirm_or_abort,
    vehicles_text,
)
from gcs.cli.errors import exit_on_error
from gcs.io.console import console_for

if TYPE_CHECKING:
    from gcs.config import Config
    from gcs.io.vehicles.geofence import FenceTask

app = command_app("""Upload, show or clear the fence and the rally points of vehicles.

    Nothing else in this project uploads a fence. An upload counts when the download from the vehicle is
    equal. The vehicle's parameters decide whether it obeys its fence: `gcs preflight` shows them.

    Without `--vehicle` a command is for all vehicles of the mission.""")


@app.command()
def upload(
    config: ConfigArgument,
    vehicle: VehicleOption = None,
    wait: WaitOption = 60.0,
    link: LinkOption = None,
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Upload the fence and the rally points of the mission file, in place of those on the vehicles."""
    _run("upload", config, vehicle, wait, link, yes, as_json)


@app.command()
def show(
    config: ConfigArgument,
    vehicle: VehicleOption = None,
    wait: WaitOption = 30.0,
    link: LinkOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show the fence and the rally points on the vehicles."""
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
    """Remove the fence and the rally points from the vehicles."""
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
    from gcs.io.vehicles.access import vehicle_access
    from gcs.io.vehicles.geofence import fence_vehicles

    console = console_for(stderr=as_json)
    with exit_on_error():
        config = load(source)
        selected = selected_vehicles(config, vehicles)
        if not yes:
            confirm_or_abort(f"{action} fence and rally points of {vehicles_text(selected)}")
        if notice := vehicle_access(config, link, writes=action != "show").description:
            console.print(notice, highlight=False, markup=False, soft_wrap=True)
        transfers = fence_vehicles(config, source, action, selected, wait_s, link)
    console.print(_table(transfers))
    ok = all(transfer.ok for transfer in transfers)
    if as_json:
        rows = [{"vehicle": one.vehicle, "ok": one.ok, "steps": one.rows()} for one in transfers]
        print(json.dumps({"action": action, "ok": ok, "vehicles": rows}), flush=True)  # noqa: T201
    raise typer.Exit(0 if ok else 1)


def selected_vehicles(config: Config, vehicles: list[int] | None) -> list[int]:
    """Return the vehicles of a command: those named, or all of the mission.

    Raises
    ------
    typer.BadParameter
        When a vehicle is not of the mission.
    """
    known = [agent.vehicle for agent in config.agents]
    for vehicle in vehicles or ():
        if vehicle not in known:
            problem = f"{vehicles_text([vehicle])} is not in the mission"
            raise typer.BadParameter(problem, param_hint="--vehicle")
    return vehicles or known


def _table(transfers: Sequence[FenceTask]) -> Table:
    from gcs.model import vehicle_name

    table = Table(pad_edge=False)
    for column in ("vehicle", "step", "", "result"):
        table.add_column(column)
    for transfer in transfers:
        for index, (step, ok, detail) in enumerate(transfer.rows()):
            mark = "[green]ok[/]" if ok else "[bold red]failed[/]"
            table.add_row(vehicle_name(transfer.vehicle) if index == 0 else "", step, mark, detail)
    return table
