"""`gcs demo`: fly a mission with simulated vehicles."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.arguments import (
    ConsoleAccessOption,
    ConsoleMapOption,
    ConsoleOption,
    FaultsOption,
    HeadlessOption,
    JsonOption,
    LogFormat,
    LogFormatOption,
    LossOption,
    OpenOption,
    PackOption,
    ScenarioArgument,
    SeedOption,
    SitlOption,
    SpeedOption,
    command_app,
)
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def demo(
    scenario: ScenarioArgument = "prescribed",
    speed: SpeedOption = 1.0,
    seed: SeedOption = 1,
    headless: HeadlessOption = False,
    log_format: LogFormatOption = LogFormat.TEXT,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the recording and the picture.  [default: runs/SCENARIO-SEED]"),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            min=1.0, help="Time limit in seconds of run time.  [default: max_duration_s of the scenario]"
        ),
    ] = None,
    as_json: JsonOption = False,
    loss: LossOption = 0.0,
    pack: PackOption = 1,
    sitl: SitlOption = None,
    faults: FaultsOption = None,
    forward: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ENDPOINT",
            help="Endpoint of another ground station that may watch, such as udpout:127.0.0.1:14550 for "
            "QGroundControl on this machine. Can be repeated.",
        ),
    ] = None,
    page: ConsoleOption = None,
    page_access: ConsoleAccessOption = None,
    page_map: ConsoleMapOption = None,
    open_page: OpenOption = False,
) -> None:
    """Fly a mission with simulated vehicles, over real MAVLink and real zenoh.

    Each vehicle is a process. The run ends when every agent has reached a target or is lost, and leaves a
    summary, a recording and a picture. Ctrl-C ends it early; the recording stays readable.
    """
    from gcs.cli.console_options import PageOptions
    from gcs.cli.fly.demo_simulation import DemoOptions, DemoSimulation
    from gcs.config import parse, read_text

    options = DemoOptions(
        scenario,
        seed,
        speed,
        duration,
        loss,
        pack,
        headless,
        as_json,
        out,
        tuple(forward or ()),
        tuple(sitl or ()),
        PageOptions(page, page_access, open_page, page_map),
        tuple(faults or ()),
    )
    is_json = log_format is LogFormat.JSON
    console = console_for(stderr=as_json, as_json=is_json)
    with exit_on_error(console if is_json else None, as_json=as_json):
        options.check()
        parse(*read_text(options.scenario))
        with DemoSimulation(options) as simulation:
            if not options.sitl:
                simulation.start()
            from gcs.cli.fly.demo_flight import run_demo  # while the vehicles start

            code = run_demo(simulation, console)
    raise typer.Exit(code)
