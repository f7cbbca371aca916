"""Commands before a flight: mission files, plans, and what the vehicles say."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core
from rich.table import Table

from gcs.cli.shared import ConfigArgument, JsonOption, SeedOption, complete_scenario, errors_shown
from gcs.io.console import console_for

PANEL = "Before a flight"

app = typer.Typer()


@app.command(rich_help_panel=PANEL)
def scenarios() -> None:
    """List the shipped scenarios."""
    from gcs.config import load, scenario_names

    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for name in scenario_names():
        table.add_row(name, load(name).description)
    console_for().print(table)


@app.command(name="warm-up", rich_help_panel=PANEL)
def warm_up() -> None:
    """Compile what is compiled once after an installation, so that no first flight waits for it."""
    from gcs.cli.warm_up_progress import ALL, load_kernels

    console = console_for()
    load_kernels(console, *ALL)
    console.print("all kernels are ready")


@app.command(rich_help_panel=PANEL)
def init(
    source: Annotated[
        Path | None,
        typer.Argument(
            help="A .plan of QGroundControl, a .kml, a .tlog or raw MAVLink, or a recording of ours.",
            show_default=False,
        ),
    ] = None,
    listen: Annotated[
        str | None,
        typer.Option(metavar="ENDPOINT", help="Take the vehicles heard there, such as udpin:0.0.0.0:14550."),
    ] = None,
    wait: Annotated[float, typer.Option(min=1.0, max=600.0, help="Seconds to listen.")] = 10.0,
    name: Annotated[str | None, typer.Option(help="Of the mission.  [default: that of the file]")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write.  [default: NAME.toml]")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it is there.")] = False,
) -> None:
    """Write a first mission file: vehicles, targets and fence from the source, and comments on the rest.

    Waypoints of a plan and points of a KML become places of birth; points called "agent" or "vehicle" become
    starts, polygons a fence. A log and a link give the vehicles. Nothing on a vehicle is changed.
    """
    from gcs.cli.prepare.init import InitOptions, run_init

    with errors_shown():
        run_init(InitOptions(source, listen, wait, name, out, force), console_for())


@app.command(rich_help_panel=PANEL)
def check(config: ConfigArgument, seed: SeedOption = 1) -> None:
    """Validate a mission file and say what it would do.

    A mistake is shown with its file, its key and what was expected.
    """
    from gcs.cli.prepare.check import describe

    with errors_shown():
        describe(config, seed, console_for())


@app.command(rich_help_panel=PANEL)
def preflight(
    config: ConfigArgument,
    wait: Annotated[
        float, typer.Option(min=1.0, help="Seconds until who has not answered counts as not there.")
    ] = 30.0,
    link: Annotated[
        str | None,
        typer.Option(help="Where the vehicles are, such as udpin:0.0.0.0:14560.  [default: links.mavlink]"),
    ] = None,
    sensors: Annotated[bool, typer.Option(help="Wait for scans on zenoh as well.")] = True,
    brief: Annotated[bool, typer.Option("--brief", help="Show only what is not ok.")] = False,
    seed: SeedOption = 1,
    as_json: JsonOption = False,
) -> None:
    """Ask every vehicle what matters before a flight; refuse with reasons. Nothing on a vehicle is changed.

    Exit code 0: nothing is refused; 1: do not fly; 2: a mistake in the mission file.
    """
    from gcs.cli.prepare.preflight import PreflightOptions
    from gcs.cli.prepare.preflight import preflight as check_all

    options = PreflightOptions(config, seed, wait, link, sensors, brief, as_json)
    with errors_shown():
        ok = check_all(options, console_for(stderr=as_json))
    raise typer.Exit(0 if ok else 1)


class _ManyPlaces(typer.core.TyperCommand):
    """Lets an option be followed by several places: `--agents 1,2 3,4`, as well as be given several times."""

    _PLACE = re.compile(r"-?[\d.]+,-?[\d.]+")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Write the option before each of its places."""
        option = ""
        spread: list[str] = []
        for arg in args:
            if option and (self._PLACE.fullmatch(arg) or (spread[-1] == option and not arg.startswith("--"))):
                if spread[-1] == option:
                    spread.pop()
                spread.append(f"{option}={arg}")
                continue
            name = arg.partition("=")[0]
            option = name if name in ("--agents", "--targets") else ""
            spread.append(arg)
        return super().parse_args(ctx, spread)


@app.command(cls=_ManyPlaces, rich_help_panel=PANEL)
def plan(
    scenario: Annotated[
        str | None,
        typer.Argument(
            help="Name of a shipped scenario (see `gcs scenarios`) or a mission file.",
            autocompletion=complete_scenario,
        ),
    ] = None,
    agents: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y ...", help="Where agents are, in metres east and north.  [default: their starts]"
        ),
    ] = None,
    targets: Annotated[
        list[str] | None,
        typer.Option(metavar="X,Y ...", help="Where targets are.  [default: the places of birth]"),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE.map", help="Plan on a Moving AI map; places are in cells."),
    ] = None,
    seed: SeedOption = 1,
    plot: Annotated[Path | None, typer.Option(help="Picture of the plan, such as plan.png.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Plan once, without flying: who goes to which target, by which way, how far; and why somebody cannot.

    Exits with 1 when an agent stays without a route although there is a target for it.
    """
    from gcs.cli.prepare.plan import PlanArguments, run_plan

    with errors_shown():
        arguments = PlanArguments(scenario, agents, targets, map_file, seed, plot, as_json)
        code = run_plan(arguments, console_for(stderr=as_json))
    raise typer.Exit(code)
