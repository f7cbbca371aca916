"""Commands that fly: simulated missions, and central command itself."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.shared import (
    ConfigArgument,
    JsonOption,
    ScenarioArgument,
    SeedOption,
    complete_scenario,
    errors_shown,
)
from gcs.io.console import console_for

PANEL = "Fly"

app = typer.Typer()


@app.command(rich_help_panel=PANEL)
def demo(
    scenario: ScenarioArgument = "prescribed",
    speed: Annotated[
        float, typer.Option(min=0.1, max=50.0, help="Run time for each second of wall time.")
    ] = 1.0,
    seed: SeedOption = 1,
    headless: Annotated[
        bool, typer.Option("--headless", help="Plain lines instead of the live view.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the recording and the picture.  [default: runs/SCENARIO-SEED]"),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            min=1.0, help="Seconds of run time after which it ends.  [default: the scenario's max_duration_s]"
        ),
    ] = None,
    as_json: JsonOption = False,
    loss: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Part of all datagrams that gets lost, each way.")
    ] = 0.0,
    pack: Annotated[int, typer.Option(min=1, max=250, help="Simulated vehicles in each process.")] = 1,
    sitl: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=PATH",
            help="Fly real firmware instead of simulated autopilots: arduplane=PATH (ArduPilot's SITL) or "
            "px4=PATH (PX4 with SIH). It is launched first, one process for each agent.",
        ),
    ] = None,
    forward: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ENDPOINT",
            help="Where another ground station may look on, such as udpout:127.0.0.1:14550 for a "
            "QGroundControl on this machine. Can be given again.",
        ),
    ] = None,
) -> None:
    """Fly a whole mission against simulated vehicles, one process each: real MAVLink over UDP, real zenoh.

    Ends when every agent has reached a target or is lost, with a summary, a recording and a picture of the
    run. Ctrl-C ends it early and leaves a readable recording.
    """
    from gcs.cli.fly.demo import DemoOptions, run_demo

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
    )
    with errors_shown():
        code = run_demo(options, console_for(stderr=as_json))
    raise typer.Exit(code)


@app.command(rich_help_panel=PANEL)
def simulate(
    scenario: ScenarioArgument = "prescribed",
    seed: SeedOption = 1,
    runs: Annotated[int, typer.Option(min=1, help="How many seeds, from --seed upwards.")] = 1,
    as_json: JsonOption = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for recordings; none is written without it.")
    ] = None,
    loss: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Part of all datagrams that gets lost, each way.")
    ] = 0.0,
    duration: Annotated[
        float | None, typer.Option(min=1.0, help="Seconds of run time after which a run has failed.")
    ] = None,
) -> None:
    """Fly whole missions on virtual time, as fast as the machine can.

    No sockets, no processes, the same rooms: a seed gives the same outcome every time.
    """
    arguments = [scenario, "--seed", str(seed), "--runs", str(runs), "--loss", str(loss)]
    arguments += ["--json"] if as_json else []
    arguments += ["--out", str(out)] if out is not None else []
    arguments += ["--duration", str(duration)] if duration is not None else []
    raise typer.Exit(_simulated(["simulate", *arguments]))


@app.command(rich_help_panel=PANEL)
def montecarlo(
    scenarios: Annotated[
        list[str],
        typer.Argument(
            help="Shipped scenarios or mission files.", autocompletion=complete_scenario, show_default=False
        ),
    ],
    runs: Annotated[int, typer.Option(min=1, help="How many seeds of each.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Lay a setting over every mission file; may be repeated."
        ),
    ] = None,
    sweep: Annotated[
        str,
        typer.Option(metavar="KEY=A,B,…", help="Fly with each of these values, and draw curves over them."),
    ] = "",
    workers: Annotated[
        int,
        typer.Option(min=0, help="Processes to fly in.  [default: one for each core]", show_default=False),
    ] = 0,
    dask: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Fly on a Dask cluster, such as tcp://10.0.0.1:8786.")
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder of the campaign.  [default: campaigns/SCENARIOS]"),
    ] = None,
    loss: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Part of all datagrams that gets lost, each way.")
    ] = 0.0,
    truth: Annotated[
        bool, typer.Option(help="Fly each mission a second time with a planner that is given the truth.")
    ] = True,
    parquet: Annotated[bool, typer.Option("--parquet", help="Write results.parquet too.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Fly many missions on virtual time and say, with confidence intervals, how good the system is.

    Writes every mission as a row (results.csv), and a report (report.html). A campaign that was interrupted
    goes on when the same command is given again; with more runs, it flies those that are missing.

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
    raise typer.Exit(_simulated(["montecarlo", json.dumps(options)]))


@app.command(rich_help_panel=PANEL)
def run(
    config: ConfigArgument,
    seed: SeedOption = 1,
    headless: Annotated[
        bool, typer.Option("--headless", help="Plain lines instead of the live view.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for the recording.  [default: runs/NAME]")] = None,
    resume: Annotated[
        bool | None,
        typer.Option(
            "--resume/--no-resume",
            help="Take up where the service was that ended or was killed; vehicles keep their missions.  "
            "[default: when its journal is less than 15 minutes old]",
        ),
    ] = None,
    journal: Annotated[
        Path | None, typer.Option(help="File to take up from.  [default: runs/NAME.journal]")
    ] = None,
    clock: Annotated[str | None, typer.Option(hidden=True, metavar="EPOCH_NS,SPEED")] = None,
) -> None:
    """Run central command alone, against whatever links and sensors the mission file names, until Ctrl-C.

    To see it work, start `sim-vehicles run SCENARIO` in a second terminal with the same scenario and seed.

    Ctrl-C ends it and leaves the vehicles alone: they fly their missions to the end. Started again, it goes
    on from there.
    """
    from gcs.cli.fly.run import ServeOptions, serve
    from gcs.io.clock import RunClock

    run_clock = RunClock()
    if clock is not None:  # of a simulation that flies faster than time
        epoch_ns, _, speed = clock.partition(",")
        run_clock = RunClock(int(epoch_ns), int(epoch_ns), float(speed))
    with errors_shown():
        serve(ServeOptions(config, seed, headless, out, resume, journal, run_clock), console_for())


def _simulated(arguments: list[str]) -> int:
    """Run the simulated side's own program; return its exit code."""
    process = subprocess.Popen([sys.executable, "-P", "-m", "sim_vehicles", *arguments])  # noqa: S603  no shell
    try:
        return process.wait()
    except KeyboardInterrupt:
        process.wait()
        return 130
