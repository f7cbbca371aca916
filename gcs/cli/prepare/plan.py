"""`gcs plan`: plan routes on the map of a mission, without a flight."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.arguments import JsonOption, MapSeedOption, check_picture, command_app, complete_scenario
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


@app.command()
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
            metavar="X,Y",
            help="Position of an agent, metres east and north; repeatable.  [default: the mission's starts]",
        ),
    ] = None,
    targets: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y",
            help="Position of a target, in metres east and north; repeatable.  [default: the target births]",
        ),
    ] = None,
    seed: MapSeedOption = 1,
    plot: Annotated[Path | None, typer.Option(help="Picture of the plan, such as plan.png.")] = None,
    plan_files: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Write a .plan of QGroundControl for each vehicle: mission, fence and rally points.",
        ),
    ] = None,
    autopilot: Annotated[
        str, typer.Option(help="Autopilot of the .plan files: arduplane or px4.")
    ] = "arduplane",
    as_json: JsonOption = False,
) -> None:
    """Plan routes once, without a flight.

    Prints targets, routes, lengths and times, and why an agent has no route. Exit code 1: an agent has no
    route although a target is left for it.

    The .plan files have the items that `gcs run` uploads to vehicles in flight at their starts: there is no
    take-off.
    """
    from gcs.cli.prepare.plan_files import autopilot_profile
    from gcs.cli.prepare.single_plan import Outputs, planning_task, run_plan

    console = console_for(stderr=as_json)
    with exit_on_error(as_json=as_json):
        check_picture(plot)
        task = planning_task(scenario, agents, targets, seed)
        outputs = Outputs(plot, plan_files, autopilot_profile(autopilot))
        code = run_plan(task, outputs, console, as_json=as_json)
    raise typer.Exit(code)
