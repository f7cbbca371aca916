"""`gcs param`: read and set parameters of vehicles.

Exit codes: 0 done for all vehicles; 1 failed for at least one; 2 a mistake in the arguments or the mission
file.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

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
from gcs.cli.prepare.fence import selected_vehicles
from gcs.io.console import console_for

if TYPE_CHECKING:
    from gcs.io.vehicles.parameters import ParameterTask

app = command_app("""Read and set parameters of vehicles.

    A new value counts when it was read back. While `gcs run` serves the mission, the command uses one of its
    forward endpoints. To set a parameter, that endpoint needs access = "full".

    Without `--vehicle` a command is for all vehicles of the mission.""")

_NAME = re.compile(r"[A-Za-z0-9_]{1,16}")


def _parse_name(text: str) -> str:
    if not _NAME.fullmatch(text):
        raise typer.BadParameter(f"expected up to 16 letters, digits and _, got {text!r}")
    return text


def _parse_value(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise typer.BadParameter(f"expected a number, got {text!r}")
    return value


NameArgument = Annotated[
    str, typer.Argument(parser=_parse_name, metavar="NAME", help="Parameter name, such as FS_LONG_ACTN.")
]


@app.command()
def get(
    config: ConfigArgument,
    names: Annotated[
        list[str],
        typer.Argument(parser=_parse_name, metavar="NAME...", help="Parameter name, such as FS_LONG_ACTN."),
    ],
    vehicle: VehicleOption = None,
    wait: WaitOption = 30.0,
    link: LinkOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show parameters of the vehicles."""
    _run(config, vehicle, names, None, wait, link, as_json)


@app.command(context_settings={"ignore_unknown_options": True})  # A value may be negative.
def set(  # noqa: A001  the command's name
    config: ConfigArgument,
    name: NameArgument,
    value: Annotated[
        float, typer.Argument(parser=_parse_value, metavar="VALUE", help="New value, a number.")
    ],
    vehicle: VehicleOption = None,
    armed: Annotated[
        bool, typer.Option("--armed", help="Allow armed vehicles. Without it they are refused.")
    ] = False,
    wait: WaitOption = 30.0,
    link: LinkOption = None,
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Set a parameter of the vehicles, and read it back."""
    _run(config, vehicle, [name], value, wait, link, as_json, armed=armed, is_confirmed=yes)


def _run(
    source: str,
    vehicles: list[int] | None,
    names: list[str],
    value: float | None,
    wait_s: float,
    link: str | None,
    as_json: bool,
    *,
    armed: bool = False,
    is_confirmed: bool = True,
) -> None:
    from gcs.config import load
    from gcs.io.vehicles.access import vehicle_access
    from gcs.io.vehicles.parameters import access_parameters

    console = console_for(stderr=as_json)
    with exit_on_error():
        config = load(source)
        selected = selected_vehicles(config, vehicles)
        if not is_confirmed:
            confirm_or_abort(f"set {names[0]} = {value:g} on {vehicles_text(selected)}")
        if notice := vehicle_access(config, link, writes=value is not None).description:
            console.print(notice, highlight=False, markup=False, soft_wrap=True)
        transfers = access_parameters(
            config, source, selected, names, value, wait_s=wait_s, link=link, armed_too=armed
        )
    console.print(_table(transfers))
    ok = all(transfer.ok for transfer in transfers)
    if as_json:
        rows = [
            {"vehicle": transfer.vehicle, "name": name, "ok": is_ok, "value": read_value, "detail": detail}
            for transfer in transfers
            for name, is_ok, read_value, detail in transfer.rows()
        ]
        action = "get" if value is None else "set"
        print(json.dumps({"action": action, "ok": ok, "parameters": rows}), flush=True)  # noqa: T201
    raise typer.Exit(0 if ok else 1)


def _table(transfers: Sequence[ParameterTask]) -> Table:
    from gcs.model import vehicle_name

    table = Table(pad_edge=False)
    for column in ("vehicle", "parameter", "value", "", "result"):
        table.add_column(column, overflow="fold")
    for transfer in transfers:
        for index, (name, ok, value, detail) in enumerate(transfer.rows()):
            mark = "[green]ok[/]" if ok else "[bold red]failed[/]"
            text = "" if value is None else f"{value:.7g}"
            table.add_row(vehicle_name(transfer.vehicle) if index == 0 else "", name, text, mark, detail)
    return table
