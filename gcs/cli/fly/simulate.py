"""`gcs simulate`: fly simulated missions on virtual time.

`simulate` and `montecarlo` run in the program of the simulated vehicles, which this package never imports.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.arguments import JsonOption, LossOption, ScenarioArgument, SeedOption, command_app

app = command_app()


@app.command()
def simulate(
    scenario: ScenarioArgument = "prescribed",
    seed: SeedOption = 1,
    runs: Annotated[int, typer.Option(min=1, help="Number of runs, with seeds from --seed upwards.")] = 1,
    as_json: JsonOption = False,
    out: Annotated[Path | None, typer.Option(help="Folder for recordings.  [default: no recording]")] = None,
    loss: LossOption = 0.0,
    duration: Annotated[
        float | None, typer.Option(min=1.0, help="Time limit of a run, in seconds of run time.")
    ] = None,
) -> None:
    """Fly simulated missions as fast as the machine can.

    Runs on virtual time, without sockets or other processes. The same seed gives the same outcome.
    """
    arguments = [scenario, "--seed", str(seed), "--runs", str(runs), "--loss", str(loss)]
    arguments += ["--json"] if as_json else []
    arguments += ["--out", str(out)] if out is not None else []
    arguments += ["--duration", str(duration)] if duration is not None else []
    raise typer.Exit(run_sim_vehicles(["simulate", *arguments]))


def run_sim_vehicles(arguments: list[str]) -> int:
    """Run the program of the simulated vehicles; return its exit code."""
    process = subprocess.Popen([sys.executable, "-P", "-m", "sim_vehicles", *arguments])  # noqa: S603  no shell
    try:
        return process.wait()
    except KeyboardInterrupt:
        process.wait()
        return 130
