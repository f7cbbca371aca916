"""`gcs simulate`: fly simulated missions on virtual time.

`simulate` and `montecarlo` run in the program of the simulated vehicles, which this package never imports.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

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
        float | None,
        typer.Option(
            min=1.0, help="Time limit in seconds of run time.  [default: max_duration_s of the scenario]"
        ),
    ] = None,
) -> None:
    """Fly simulated missions as fast as the machine can.

    Runs on virtual time, without sockets or other processes. The same seed gives the same outcome.
    """
    options = {
        "scenario": scenario,
        "seed": seed,
        "runs": runs,
        "as_json": as_json,
        "out": None if out is None else str(out),
        "loss": loss,
        "duration_s": duration,
    }
    raise typer.Exit(run_sim_vehicles("simulate", options))


def sim_vehicles_command(name: str, options: dict[str, Any]) -> list[str]:
    """Return the command line of a hidden command of `sim-vehicles`, with its options as JSON."""
    return [sys.executable, "-P", "-m", "sim_vehicles", name, json.dumps(options)]


def run_sim_vehicles(name: str, options: dict[str, Any]) -> int:
    """Run a hidden command of `sim-vehicles`; return its exit code."""
    process = subprocess.Popen(sim_vehicles_command(name, options))  # noqa: S603  no shell
    try:
        return process.wait()
    except KeyboardInterrupt:
        process.wait()
        return 130
