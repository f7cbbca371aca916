"""`gcs montecarlo`: fly many simulated missions and report success rates."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.arguments import JsonOption, LossOption, command_app, complete_scenario
from gcs.cli.fly.simulate import run_sim_vehicles

app = command_app()


@app.command()
def montecarlo(
    scenarios: Annotated[
        list[str],
        typer.Argument(
            help="Shipped scenarios or mission files.", autocompletion=complete_scenario, show_default=False
        ),
    ],
    runs: Annotated[int, typer.Option(min=1, help="Number of seeds for each scenario.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="First seed.")] = 1,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override a key of every mission file; repeatable."),
    ] = None,
    sweep: Annotated[
        str,
        typer.Option(metavar="KEY=A,B,…", help="Fly with each of these values, and plot the results."),
    ] = "",
    workers: Annotated[
        int,
        typer.Option(min=0, help="Number of processes.  [default: one for each core]", show_default=False),
    ] = 0,
    dask: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Fly on a Dask cluster, such as tcp://10.0.0.1:8786.")
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for results.  [default: campaigns/SCENARIOS]"),
    ] = None,
    loss: LossOption = 0.0,
    truth: Annotated[
        bool, typer.Option(help="Fly each mission a second time with a planner that is given the truth.")
    ] = True,
    parquet: Annotated[bool, typer.Option("--parquet", help="Write results.parquet as well.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Fly many simulated missions and report success rates with confidence intervals.

    Writes one row for each mission (results.csv) and a report (report.html). The same command continues an
    interrupted campaign; with more --runs it adds the missing ones.

    Example: **gcs montecarlo prescribed random-targets --runs 20 --sweep planning.period_s=1,2,5,10**
    """
    key, _, values = sweep.partition("=")
    options = {
        "campaign": {
            "scenarios": scenarios,
            "runs": runs,
            "seed": seed,
            "settings": settings or [],
            "sweep_key": key.strip(),
            "sweep_values": [value.strip() for value in values.split(",")],
            "loss": loss,
            "planners": ["own", "truth"] if truth else ["own"],
        },
        "folder": str(out or Path("campaigns") / "-".join(Path(name).stem for name in scenarios)),
        "workers": workers or os.cpu_count() or 1,
        "dask": dask,
        "parquet": parquet,
        "as_json": as_json,
    }
    raise typer.Exit(run_sim_vehicles("montecarlo", options))
