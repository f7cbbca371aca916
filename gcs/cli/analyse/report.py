"""`gcs report`: write a page about a run, with figures, tables and the tracks as CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.arguments import (
    DetectionsOption,
    JsonOption,
    ModelOption,
    OffsetOption,
    RecordedSeedOption,
    command_app,
)
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for

app = command_app()


@app.command()
def report(
    recording: Annotated[
        Path, typer.Argument(help="A recording, or a log (.tlog, .bin of ArduPilot, .ulg of PX4).")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the page.  [default: RECORDING/report, or NAME-report]"),
    ] = None,
    config: Annotated[
        str | None, typer.Option(help="Mission file, for a log or a recording without its own.")
    ] = None,
    seed: RecordedSeedOption = None,
    detections: DetectionsOption = None,
    model: ModelOption = None,
    offset: OffsetOption = 0.0,
    timing: Annotated[
        bool,
        typer.Option(
            help="Process every event again, to measure the time of scans and plans on this machine."
        ),
    ] = True,
    as_json: JsonOption = False,
) -> None:
    """Write a page about a run: maps, tracks, plans and times.

    The page opens in any browser. It names what the file does not have, such as ground truth. Figures are
    written as PNG and PDF, tracks as CSV.
    """
    from gcs.cli.analyse.report_material import ReportOptions, run_report
    from gcs.cli.analyse.run_file import RunFile

    console = console_for(stderr=as_json)
    with exit_on_error(as_json=as_json):
        file = RunFile(recording, config, seed, detections, model, offset)
        run_report(ReportOptions(file, out, timing, as_json), console)
