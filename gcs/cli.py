"""The ``gcs`` command: arguments in, exit codes out; the work is done elsewhere.

Exit codes: 0 done as it should be, 1 the mission did not end as it should (the reason is printed), 2 a
mistake in arguments or files, 130 interrupted.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
import typer.core
from rich.console import Console
from rich.table import Table

from gcs.commands.fence import app as fence_app
from gcs.commands.keys import app as keys_app
from gcs.commands.order import app as order_app
from gcs.errors import GcsError, InterruptedRunError

app = typer.Typer(
    help="""Central command for a swarm of fixed-wing vehicles.

    Tracks agents and targets through clutter, plans, uploads MAVLink missions, and re-tasks the survivors.

    Start with **gcs demo**.""",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)

app.add_typer(order_app, name="order")
app.add_typer(keys_app, name="keys")
app.add_typer(fence_app, name="fence")


def _complete(incomplete: str) -> list[str]:
    """Names of shipped scenarios for tab completion."""
    from gcs.config import scenario_names

    return [name for name in scenario_names() if name.startswith(incomplete)]


ScenarioArgument = Annotated[
    str,
    typer.Argument(
        help="Name of a shipped scenario (see `gcs scenarios`) or a mission file.", autocompletion=_complete
    ),
]
ConfigArgument = Annotated[
    str,
    typer.Argument(
        help="A mission file, or the name of a shipped scenario.", metavar="CONFIG", autocompletion=_complete
    ),
]
SeedOption = Annotated[
    int, typer.Option(min=0, help="Makes everything random: obstacles, deaths, targets, noise.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="End with one JSON object on its own line.")]


@app.command()
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
    from gcs.commands.demo import DemoOptions, run_demo

    forwards = tuple(forward or ())
    options = DemoOptions(scenario, seed, speed, duration, loss, pack, headless, as_json, out, forwards)
    with _errors_shown():
        code = run_demo(options, Console(stderr=as_json))
    raise typer.Exit(code)


@app.command()
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


@app.command()
def montecarlo(
    scenarios: Annotated[
        list[str],
        typer.Argument(
            help="Shipped scenarios or mission files.", autocompletion=_complete, show_default=False
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


def _simulated(arguments: list[str]) -> int:
    """Run the simulated side's own program; return its exit code."""
    process = subprocess.Popen([sys.executable, "-m", "sim_vehicles", *arguments])  # noqa: S603  no shell
    try:
        return process.wait()
    except KeyboardInterrupt:
        process.wait()
        return 130


@app.command()
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
    from gcs.commands.serve import ServeOptions, serve
    from gcs.edge.clock import RunClock

    run_clock = RunClock()
    if clock is not None:  # of a simulation that flies faster than time
        epoch_ns, _, speed = clock.partition(",")
        run_clock = RunClock(int(epoch_ns), int(epoch_ns), float(speed))
    with _errors_shown():
        serve(ServeOptions(config, seed, headless, out, resume, journal, run_clock), Console())


@app.command()
def check(config: ConfigArgument, seed: SeedOption = 1) -> None:
    """Validate a mission file and say what it would do.

    A mistake is shown with its file, its key and what was expected.
    """
    from gcs.commands.check import describe

    with _errors_shown():
        describe(config, seed, Console())


@app.command()
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
    from gcs.commands.preflight import PreflightOptions
    from gcs.commands.preflight import preflight as check_all

    options = PreflightOptions(config, seed, wait, link, sensors, brief, as_json)
    with _errors_shown():
        ok = check_all(options, Console(stderr=as_json))
    raise typer.Exit(0 if ok else 1)


@app.command()
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
    seed: Annotated[
        int | None, typer.Option(min=0, help="Of the random obstacles.  [default: the recorded one]")
    ] = None,
    detections: Annotated[
        Path | None,
        typer.Option(help="Scans to lay beside a log: NPZ, CSV (k,x,y or t_s,x,y or t_ns,x,y), a recording."),
    ] = None,
    model: Annotated[
        Path | None, typer.Option(help="What their sensor is, TOML or NPZ.  [default: the file's own]")
    ] = None,
    offset: Annotated[
        float, typer.Option(metavar="S", help="Seconds to add to their times, which begin with the log's.")
    ] = 0.0,
    headless: Annotated[
        bool, typer.Option("--headless", help="Plain lines instead of the live view.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Play a recorded run through central command again: the same events, by the same door.

    With --verify it exits with 1 when anything comes out differently by as much as a byte, and says where.
    """
    from gcs.commands.replay import ReplayOptions, run_replay, speed_of
    from gcs.commands.replaying import Window

    with _errors_shown():
        window = Window(start, float("inf") if end is None else end)
        options = ReplayOptions(
            recording, speed_of(speed), window, verify, config, seed, headless, as_json,
            detections, model, offset,
        )  # fmt: skip
        code = run_replay(options, Console(stderr=as_json))
    raise typer.Exit(code)


@app.command()
def track(
    file: Annotated[
        Path, typer.Argument(help="Detections (NPZ, or CSV with rows k,x,y), or the folder of a recording.")
    ],
    model: Annotated[
        Path | None, typer.Option(help="The model to track by, TOML or NPZ.  [default: the file's own]")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="CSV for the estimates: k,label,x,y,vx,vy,existence.")
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option(help="The truth to judge by, CSV or NPZ: k,id,px,vx,py,vy.  [default: the file's own]"),
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
    from gcs.commands.track import TrackOptions, run_track

    with _errors_shown():
        run_track(
            TrackOptions(file, model, truth, estimator, lag_scans, out, plot, as_json),
            Console(stderr=as_json),
        )


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


@app.command(cls=_ManyPlaces)
def plan(
    scenario: Annotated[
        str | None,
        typer.Argument(
            help="Name of a shipped scenario (see `gcs scenarios`) or a mission file.",
            autocompletion=_complete,
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
    from gcs.commands.plan import PlanArguments, run_plan

    with _errors_shown():
        arguments = PlanArguments(scenario, agents, targets, map_file, seed, plot, as_json)
        code = run_plan(arguments, Console(stderr=as_json))
    raise typer.Exit(code)


@app.command()
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
    from gcs.commands.info import run_info

    with _errors_shown():
        code = run_info(file, Console(stderr=as_json), as_json=as_json)
    raise typer.Exit(code)


@app.command()
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
    seed: Annotated[
        int | None, typer.Option(min=0, help="Of the random obstacles.  [default: the recorded one]")
    ] = None,
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
    from gcs.commands.paper import run_paper
    from gcs.commands.report import ReportOptions, run_report

    if (recording is None) != paper:
        raise typer.BadParameter("name a recording, or give --paper without one")
    with _errors_shown():
        if recording is None:
            folder = out if out is not None else Path("paper-report")
            raise typer.Exit(run_paper(folder, Console(stderr=as_json), as_json=as_json))
        options = ReportOptions(recording, out, config, seed, timing, as_json)
        code = run_report(options, Console(stderr=as_json))
    raise typer.Exit(code)


@app.command()
def scenarios() -> None:
    """List the shipped scenarios."""
    from gcs.config import load, scenario_names

    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for name in scenario_names():
        table.add_row(name, load(name).description)
    Console().print(table)


class _errors_shown:  # noqa: N801  reads as a statement
    """Turn an error of ours into one readable line and exit code 2."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, _type: object, error: BaseException | None, _trace: object) -> None:
        if isinstance(error, GcsError):
            Console(stderr=True).print(f"[bold red]error:[/] {error}", highlight=False, soft_wrap=True)
            raise typer.Exit(130 if isinstance(error, InterruptedRunError) else 2) from None
        if isinstance(error, KeyboardInterrupt):
            raise typer.Exit(130) from None


def main() -> None:
    """Entry point."""
    app()
