"""`gcs plan`: plan routes on the map of a mission, without a flight."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core

from gcs.cli.arguments import JsonOption, MapSeedOption, check_picture, command_app, complete_scenario
from gcs.cli.errors import exit_on_error
from gcs.io.console import console_for

app = command_app()


class _PositionsCommand(typer.core.TyperCommand):
    """Accepts several positions after an option (`--agents 1,2 3,4`) as well as a repeated option."""

    _POSITION = re.compile(r"-?[\d.]+,-?[\d.]+")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Repeat the option before each of its positions, then parse."""
        option = ""
        expanded: list[str] = []
        for arg in args:
            if option and (
                self._POSITION.fullmatch(arg) or (expanded[-1] == option and not arg.startswith("--"))
            ):
                if expanded[-1] == option:
                    expanded.pop()
                expanded.append(f"{option}={arg}")
                continue
            name = arg.partition("=")[0]
            option = name if name in ("--agents", "--targets") else ""
            expanded.append(arg)
        return super().parse_args(ctx, expanded)


@app.command(cls=_PositionsCommand)
def plan(
    scenario: Annotated[
        str,
        typer.Argument(
            help="Name of a shipped scenario (see `gcs scenarios`) or a mission file.",
            autocompletion=complete_scenario,
        ),
    ],
    agents: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y ...",
            help="Positions of agents, in metres east and north.  [default: their starts in the mission]",
        ),
    ] = None,
    targets: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y ...",
            help="Positions of targets, in metres east and north.  [default: the target births]",
        ),
    ] = None,
    seed: MapSeedOption = 1,
    plot: Annotated[Path | None, typer.Option(help="Picture of the plan, such as plan.png.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Plan routes once, without a flight.

    Prints targets, routes, lengths and times, and why an agent has no route. Exit code 1: an agent has no
    route although a target is left for it.
    """
    from gcs.cli.prepare.single_plan import planning_task, run_plan

    console = console_for(stderr=as_json)
    with exit_on_error():
        check_picture(plot)
        task = planning_task(scenario, agents, targets, seed)
        code = run_plan(task, plot, console, as_json=as_json)
    raise typer.Exit(code)
