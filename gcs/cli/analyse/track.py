"""`gcs track`: track recorded detections and score the result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.arguments import JsonOption, command_app
from gcs.cli.errors import exit_on_error
from gcs.io.terminal import console_for
from gcs.tracking import Estimator

app = command_app()


@app.command()
def track(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Detections: NPZ, or CSV with k,x,y or t_s,sensor,range_m,bearing_deg; or a recording. Of "
            "several files the scores are given as mean, deviation and 95 % interval.",
        ),
    ],
    model: Annotated[
        Path | None,
        typer.Option(help="Motion and sensor model, TOML or NPZ.  [default: the model in the file]"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="CSV or Parquet (by its ending) of the estimates: k,label,x,y,vx,vy,…"
        ),
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(
            help="Ground truth for the scores, CSV with k,id,x,y or t_s,id,x,y, or NPZ.  "
            "[default: the truth in the file]"
        ),
    ] = None,
    estimator: Annotated[
        Estimator,
        typer.Option(help="Estimates at each scan, whole paths afterwards, or smoothed paths."),
    ] = "recovered",
    lag_scans: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Fixed lag of smoothed estimates, in scans: each state as known so many scans later, from "
            "the detections up to then.  [default: all detections]",
        ),
    ] = None,
    cutoff_m: Annotated[
        float,
        typer.Option(
            min=1e-3,
            max=1e9,
            help="Cut-off c of OSPA in metres: how far off an object counts as missed. GOSPA and identity "
            "switches use half of it.",
        ),
    ] = 100.0,
    plot: Annotated[Path | None, typer.Option(help="Picture of the result, such as tracks.png.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Track recorded detections and score the result.

    Ground truth is used for the scores only.
    """
    from gcs.cli.analyse.track_run import TrackOptions, run_track

    options = TrackOptions(tuple(files), model, truth, estimator, lag_scans, cutoff_m, out, plot, as_json)
    with exit_on_error(as_json=as_json):
        run_track(options, console_for(stderr=as_json))
