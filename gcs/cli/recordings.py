"""Commands after a flight: replay, judge, track recorded detections."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from gcs.cli.shared import JsonOption, errors_shown
from gcs.io.console import console_for

PANEL = "Recordings"

app = typer.Typer()

RecordedSeedOption = Annotated[
    int | None, typer.Option(min=0, help="Of the random obstacles.  [default: the recorded one]")
]
DetectionsOption = Annotated[
    Path | None,
    typer.Option(help="Scans to lay beside a log: NPZ, CSV (k,x,y or t_s,x,y or t_ns,x,y), a recording."),
]
ModelOption = Annotated[
    Path | None, typer.Option(help="What their sensor is, TOML or NPZ.  [default: the file's own]")
]
OffsetOption = Annotated[
    float, typer.Option(metavar="S", help="Seconds to add to their times, which begin with the log's.")
]


@app.command(rich_help_panel=PANEL)
def replay(
    recording: Annotated[
        Path,
        typer.Argument(help="A recording: its folder or its .mcap; or a .tlog or raw MAVLink with --config."),
    ],
    speed: Annotated[
        str | None,
        typer.Option(
            metavar="N|max", help="Run time for each second of wall time.  [default: 1 live, max headless]"
        ),
    ] = None,
    start: Annotated[float, typer.Option("--from", min=0.0, help="Show from this second of the run on.")] = 0,
    end: Annotated[float | None, typer.Option("--to", min=0.0, help="End at this second of the run.")] = None,
    verify: Annotated[
        bool, typer.Option("--verify", help="Compare every picture, plan and send with the recorded one.")
    ] = False,
    config: Annotated[
        str | None, typer.Option(help="Another mission file: what would have been different?")
    ] = None,
    seed: RecordedSeedOption = None,
    detections: DetectionsOption = None,
    model: ModelOption = None,
    offset: OffsetOption = 0.0,
    headless: Annotated[
        bool, typer.Option("--headless", help="Plain lines instead of the live view.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Play a recorded run through central command again: the same events, by the same door.

    With --verify it exits with 1 when anything comes out differently by as much as a byte, and says where.
    """
    from gcs.cli.analyse.replay import ReplayOptions, run_replay, speed_of
    from gcs.service.replay import Window

    with errors_shown():
        window = Window(start, float("inf") if end is None else end)
        options = ReplayOptions(
            recording, speed_of(speed), window, verify, config, seed, headless, as_json,
            detections, model, offset,
        )  # fmt: skip
        code = run_replay(options, console_for(stderr=as_json))
    raise typer.Exit(code)


@app.command(rich_help_panel=PANEL)
def report(
    recording: Annotated[
        Path | None, typer.Argument(help="A recording, a .tlog of any ground station, or raw MAVLink.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for it.  [default: RECORDING/report, or NAME-report]"),
    ] = None,
    paper: Annotated[
        bool,
        typer.Option("--paper", help="Fly the paper's missions; draw its figures 3 to 9, check its claims."),
    ] = False,
    config: Annotated[
        str | None, typer.Option(help="The mission, for a log, or for a recording that lost its own.")
    ] = None,
    seed: RecordedSeedOption = None,
    detections: DetectionsOption = None,
    model: ModelOption = None,
    offset: OffsetOption = 0.0,
    timing: Annotated[
        bool,
        typer.Option(help="Work every event once more, to measure how long scans and plans take here."),
    ] = True,
    as_json: JsonOption = False,
) -> None:
    """Put a run on one page: maps, trackers, plans, times; figures as PNG and PDF, tracks as CSV.

    The page stands alone and opens in any browser. What a file does not hold, such as the truth of a real
    flight, the page says.
    """
    from gcs.cli.analyse.paper import run_paper
    from gcs.cli.analyse.report import ReportOptions, run_report

    if (recording is None) != paper:
        raise typer.BadParameter("name a recording, or give --paper without one")
    with errors_shown():
        if recording is None:
            folder = out if out is not None else Path("paper-report")
            raise typer.Exit(run_paper(folder, console_for(stderr=as_json), as_json=as_json))
        options = ReportOptions(recording, out, config, seed, timing, as_json, detections, model, offset)
        code = run_report(options, console_for(stderr=as_json))
    raise typer.Exit(code)


@app.command(rich_help_panel=PANEL)
def info(
    file: Annotated[
        Path,
        typer.Argument(
            help="A recording, a .tlog of any ground station, raw MAVLink, or detections (NPZ, CSV)."
        ),
    ],
    as_json: JsonOption = False,
) -> None:
    """Say what is in a recording: vehicles, messages and their rates, gaps, loss, missions, damage."""
    from gcs.cli.analyse.info import run_info

    with errors_shown():
        code = run_info(file, console_for(stderr=as_json), as_json=as_json)
    raise typer.Exit(code)


@app.command(rich_help_panel=PANEL)
def track(
    file: Annotated[
        Path,
        typer.Argument(
            help="Detections: NPZ, or CSV with k,x,y or t_s,sensor,range_m,bearing_deg; or a recorded run."
        ),
    ],
    model: Annotated[
        Path | None, typer.Option(help="The model to track by, TOML or NPZ.  [default: the file's own]")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="CSV for the estimates, k,label,x,y,vx,vy,…; may be a --truth."),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            help="The truth to judge by, CSV with k,id,x,y or t_s,id,x,y, or NPZ.  [default: the file's own]"
        ),
    ] = None,
    estimator: Annotated[
        Literal["filtered", "recovered", "smoothed"],
        typer.Option(help="What was known at each scan, whole paths afterwards, or these smoothed."),
    ] = "recovered",
    lag_scans: Annotated[
        int | None,
        typer.Option(
            min=0, help="Later scans that a smoothed state knows, as a display that lags so far behind."
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of the result, such as tracks.png.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Track recorded detections, and say how well where the truth is known, and how fast.

    The truth judges the result and is not looked at before.
    """
    from gcs.cli.analyse.track import TrackOptions, run_track

    with errors_shown():
        run_track(
            TrackOptions(file, model, truth, estimator, lag_scans, out, plot, as_json),
            console_for(stderr=as_json),
        )
