"""`gcs param`: read and set parameters of a mission's vehicles, such as those that `gcs preflight` names.

Exit codes: 0 done for all, 1 not for somebody, 2 a mistake in the arguments or the mission file.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from gcs.cli.errors import complain
from gcs.cli.prepare.fence import ConfigArgument, JsonOption, LinkOption, VehicleOption, YesOption, chosen
from gcs.cli.vehicle_names import names as named
from gcs.errors import GcsError
from gcs.io.console import console_for

if TYPE_CHECKING:
    from gcs.io.vehicles.parameters import ParameterTalk

app = typer.Typer(
    help="""Parameters of a mission's vehicles, by name.

    A value that is set counts when it was read back. While `gcs run` serves the mission, this goes through
    one of its forward endpoints; to set something, one with access = "full".""",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)

_NAME = re.compile(r"[A-Za-z0-9_]{1,16}")


def _name(text: str) -> str:
    if not _NAME.fullmatch(text):
        raise typer.BadParameter(f"expected up to 16 letters, digits and _, got {text!r}")
    return text


def _value(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise typer.BadParameter(f"expected a number, got {text!r}")
    return value


NameArgument = Annotated[str, typer.Argument(parser=_name, metavar="NAME", help="Such as FS_LONG_ACTN.")]
WaitOption = Annotated[float, typer.Option("--wait", min=1.0, help="Seconds to wait until all is done.")]


@app.command()
def get(
    config: ConfigArgument,
    names: Annotated[
        list[str], typer.Argument(parser=_name, metavar="NAME...", help="Such as FS_LONG_ACTN.")
    ],
    vehicle: VehicleOption = None,
    wait: WaitOption = 30.0,
    link: LinkOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show parameters of the vehicles."""
    _run(config, vehicle, names, None, wait, link, as_json)


@app.command(context_settings={"ignore_unknown_options": True})  # a value may begin with a minus
def set(  # noqa: A001  the command's name
    config: ConfigArgument,
    name: NameArgument,
    value: Annotated[float, typer.Argument(parser=_value, metavar="VALUE", help="A number.")],
    vehicle: VehicleOption = None,
    armed: Annotated[bool, typer.Option("--armed", help="Armed vehicles, too. Others are refused.")] = False,
    wait: WaitOption = 30.0,
    link: LinkOption = None,
    yes: YesOption = False,
    as_json: JsonOption = False,
) -> None:
    """Set a parameter of the vehicles, and read it back."""
    _run(config, vehicle, [name], value, wait, link, as_json, armed=armed, ask=not yes)


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
    ask: bool = False,
) -> None:
    from gcs.config import load
    from gcs.io.vehicles.access import entrance_of
    from gcs.io.vehicles.parameters import ask_parameters

    console = console_for(stderr=as_json)
    try:
        config = load(source)
        whom = chosen(config, vehicles)
        if ask:
            _ask(f"set {names[0]} = {value:g} on {named(whom)}")
        if words := entrance_of(config, link, writes=value is not None).words:
            console.print(words, highlight=False, markup=False, soft_wrap=True)
        talks = ask_parameters(config, source, whom, names, value, wait_s=wait_s, link=link, armed_too=armed)
    except GcsError as error:
        raise typer.Exit(complain(error)) from None
    console.print(_table(talks))
    ok = all(talk.ok for talk in talks)
    if as_json:
        rows = [
            {"vehicle": talk.vehicle, "name": name, "ok": is_ok, "value": held, "detail": detail}
            for talk in talks
            for name, is_ok, held, detail in talk.rows()
        ]
        action = "get" if value is None else "set"
        print(json.dumps({"action": action, "ok": ok, "parameters": rows}), flush=True)  # noqa: T201
    raise typer.Exit(0 if ok else 1)


def _ask(what: str) -> None:
    if not sys.stdin.isatty():
        raise typer.BadParameter(f"to {what} without somebody to ask, say --yes")
    typer.confirm(f"{what}?", abort=True, err=True)


def _table(talks: Sequence[ParameterTalk]) -> Table:
    from gcs.model import vehicle_name

    table = Table(pad_edge=False)
    for column in ("vehicle", "parameter", "value", "", "how it went"):
        table.add_column(column, overflow="fold")
    for talk in talks:
        for index, (name, ok, value, detail) in enumerate(talk.rows()):
            word = "[green]ok[/]" if ok else "[bold red]failed[/]"
            shown = "" if value is None else f"{value:.7g}"
            table.add_row(vehicle_name(talk.vehicle) if index == 0 else "", name, shown, word, detail)
    return table
