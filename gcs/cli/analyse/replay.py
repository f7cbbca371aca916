"""`gcs replay`: play a recording again, exactly or with other settings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.arguments import (
    ConsoleAccessOption,
    ConsoleMapOption,
    ConsoleOption,
    DetectionsOption,
    HeadlessOption,
    JsonOption,
    ModelOption,
    OffsetOption,
    OpenOption,
    RecordedSeedOption,
    command_app,
)
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def replay(
    recording: Annotated[
        Path,
        typer.Argument(
            help="A recording (its folder or .mcap), or a log (.tlog, .bin of ArduPilot, .ulg of PX4)."
        ),
    ],
    speed: Annotated[
        str | None,
        typer.Option(
            metavar="N|max",
            help="Speed as a multiple of real time.  [default: 1 in the live view, else max]",
        ),
    ] = None,
    start: Annotated[
        float, typer.Option("--from", min=0.0, help="Start of the output, in seconds of the run.")
    ] = 0,
    end: Annotated[float | None, typer.Option("--to", min=0.0, help="End, in seconds of the run.")] = None,
    verify: Annotated[
        bool,
        typer.Option("--verify", help="Compare every track, plan and sent message with the recorded one."),
    ] = False,
    config: Annotated[
        str | None,
        typer.Option(
            help="Another mission file, to compare results under other settings. For a log: the mission of "
            "its vehicles.  [default: derived from the log]"
        ),
    ] = None,
    seed: RecordedSeedOption = None,
    compare: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Another recording or log, beside this one in the console, at the same mission time. "
            "--config, --seed and the options of logs are for the first.",
        ),
    ] = None,
    detections: DetectionsOption = None,
    model: ModelOption = None,
    offset: OffsetOption = 0.0,
    headless: HeadlessOption = False,
    as_json: JsonOption = False,
    page: ConsoleOption = None,
    page_access: ConsoleAccessOption = None,
    page_map: ConsoleMapOption = None,
    open_page: OpenOption = False,
) -> None:
    """Play a recording through central command again.

    With --verify the exit code is 1 if an output differs by a byte; the first difference is printed.
    """
    from gcs.cli.analyse.playback import ReplayOptions, parse_speed, run_replay
    from gcs.cli.analyse.run_file import RunFile
    from gcs.cli.console_options import PageOptions
    from gcs.service.replay import Window

    with exit_on_error(as_json=as_json):
        file = RunFile(recording, config, seed, detections, model, offset)
        window = Window(start, math.inf if end is None else end)
        options = ReplayOptions(
            file,
            parse_speed(speed),
            window,
            verify,
            headless,
            as_json,
            PageOptions(page, page_access, open_page, page_map, compare is not None),
        )
        console = console_for(stderr=as_json)
        if compare is None:
            code = run_replay(options, console)
        else:
            from gcs.cli.analyse.compare import run_comparison

            code = run_comparison(options, RunFile(compare), console)
    raise typer.Exit(code)
