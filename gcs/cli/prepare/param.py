"""`gcs param`: read and set parameters of vehicles.

Exit codes: 0 done for all vehicles; 1 failed for at least one; 2 a mistake in the arguments or the mission
file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.arguments import (
    ConfigArgument,
    JsonOption,
    LinkOption,
    VehicleOption,
    WaitOption,
    YesOption,
    command_app,
)
from gcs.cli.prepare.vehicle_tasks import exit_with_results, run_tasks

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


_NAME_HELP = "Parameter name, such as FS_LONG_ACTN."


@app.command()
def get(
    config: ConfigArgument,
    names: Annotated[
        list[str],
        typer.Argument(parser=_parse_name, metavar="NAME...", help=_NAME_HELP),
    ],
    vehicle: VehicleOption = None,
    wait: WaitOption = 30.0,
    link: LinkOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show parameters of the vehicles."""
    from gcs.io.vehicles.parameters import access_parameters

    tasks = run_tasks(
        config,
        vehicle,
        link,
        lambda mission, selected: access_parameters(
            mission, config, selected, names, None, wait_s=wait, link=link
        ),
        writes=False,
        question="",
        as_json=as_json,
    )
    _show("get", tasks, as_json=as_json)


@app.command(context_settings={"ignore_unknown_options": True})  # A value may be negative.
def set(  # noqa: A001  the command's name
    config: ConfigArgument,
    name: Annotated[str, typer.Argument(parser=_parse_name, metavar="NAME", help=_NAME_HELP)],
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
    from gcs.io.vehicles.parameters import access_parameters

    tasks = run_tasks(
        config,
        vehicle,
        link,
        lambda mission, selected: access_parameters(
            mission, config, selected, [name], value, wait_s=wait, link=link, armed_too=armed
        ),
        writes=True,
        question="" if yes else f"set {name} = {value:g} on",
        as_json=as_json,
    )
    _show("set", tasks, as_json=as_json)


def _show(action: str, tasks: Sequence[ParameterTask], *, as_json: bool) -> None:
    """Print the results, and exit with the code of them all."""
    rows = [
        {"vehicle": task.vehicle, "name": name, "ok": ok, "value": read_value, "detail": detail}
        for task in tasks
        for name, ok, read_value, detail in task.rows()
    ]
    exit_with_results(
        action,
        tasks,
        ["parameter", "value"],
        lambda task: (
            ((name, "" if read_value is None else f"{read_value:.7g}"), ok, detail)
            for name, ok, read_value, detail in task.rows()
        ),
        {"parameters": rows},
        as_json=as_json,
    )
