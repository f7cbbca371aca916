"""The ``sim-vehicles`` command: vehicles and a world alone, for any ground station to connect to."""

from __future__ import annotations

import json
import os
import selectors
import signal
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from gcs.cli.errors import print_error
from gcs.errors import GcsError
from gcs.io.console import console_for
from sim_vehicles.autopilots.firmware import parse_sitl
from sim_vehicles.supervisor import Plan, Supervisor
from sim_vehicles.world.scenario import load

app = typer.Typer(
    help="Simulated fixed-wing vehicles and the world they fly in, over real MAVLink and real zenoh.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)

ScenarioArgument = Annotated[
    str,
    typer.Argument(
        help="Name of a shipped scenario (see `gcs scenarios`) or a mission file.", show_default=True
    ),
]
SeedOption = Annotated[
    int, typer.Option(min=0, help="Makes everything random: obstacles, deaths, targets, noise.")
]
ZenohOption = Annotated[str, typer.Option(help="zenoh endpoint for scans and truth.")]
ZenohRoleOption = Annotated[
    Literal["connect", "listen"],
    typer.Option(
        help="connect: to a central command that listens (`gcs run`); listen: for anybody to connect."
    ),
]


@app.callback()
def callback() -> None:
    """Simulated fixed-wing vehicles and the world they fly in."""


@app.command()
def run(
    scenario: ScenarioArgument,
    seed: SeedOption = 1,
    speed: Annotated[
        float,
        typer.Option(
            min=0.1, max=50.0, help="Run time for each second of wall time; ground stations expect 1."
        ),
    ] = 1.0,
    gcs: Annotated[
        str, typer.Option(help="HOST:PORT of the ground station that every vehicle talks to.")
    ] = "127.0.0.1:14550",
    zenoh: ZenohOption = "tcp/127.0.0.1:7447",
    zenoh_role: ZenohRoleOption = "connect",
    pack: Annotated[int, typer.Option(min=1, max=250, help="Vehicles in each process.")] = 1,
    loss: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Part of all datagrams that gets lost, each way.")
    ] = 0.0,
    start_at_once: Annotated[
        bool,
        typer.Option(
            "--start-at-once",
            help="Let targets move and deaths count from the start, not from when a ground station has been "
            "heard for 10 s.",
        ),
    ] = False,
    sitl: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=PATH",
            help="Fly real firmware in place of simulated autopilots: arduplane=PATH (ArduPilot's SITL) or "
            "px4=PATH (PX4 with SIH). Can be given twice: agents in `simulation.px4` take PX4.",
        ),
    ] = None,
    sitl_folder: Annotated[
        Path | None,
        typer.Option(help="Where the firmware keeps its files and logs.  [default: a temporary folder]"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object a line instead of words.")] = False,
    until_stdin_closes: Annotated[bool, typer.Option(hidden=True)] = False,
) -> None:
    """Fly a scenario's vehicles until Ctrl-C: one process and one UDP socket each, and one for the world.

    Each vehicle behaves as an ArduPlane does, in LOITER at its start, and waits for a mission. Targets stand
    at their starts, and nobody dies, until a ground station has been heard for 10 s. Connect QGroundControl,
    MAVProxy (`mavproxy.py --master=udpin:0.0.0.0:14550`) or `gcs run SCENARIO`.
    """
    try:
        firmware = dict(parse_sitl(text) for text in sitl or [])
        loaded = load(scenario)
    except GcsError as error:
        raise typer.Exit(print_error(error)) from None
    plan = Plan(
        loaded, seed, speed, gcs, zenoh, zenoh_role, pack, loss, not start_at_once, firmware, sitl_folder
    )
    _supervise(plan, as_json, sys.stdin.fileno() if until_stdin_closes else None)


@app.command()
def world(
    scenario: ScenarioArgument,
    link: Annotated[
        list[str],
        typer.Option(
            metavar="ENDPOINT",
            help="MAVLink endpoint of vehicles that fly already, such as tcp:127.0.0.1:5762 (second port of "
            "ArduPilot's SITL) or udpin:127.0.0.1:14551. Give it once for each link.",
        ),
    ],
    seed: SeedOption = 1,
    zenoh: ZenohOption = "tcp/127.0.0.1:7447",
    zenoh_role: ZenohRoleOption = "connect",
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object a line instead of words.")] = False,
) -> None:
    """Simulate a scenario's targets and sensors around vehicles that fly already, until Ctrl-C.

    The sensors see the vehicles where their simulation says that they truly are (SIMSTATE of ArduPilot's
    SITL, HIL_STATE_QUATERNION of PX4). A vehicle without such messages is seen where it reports to be.
    """
    try:
        loaded = load(scenario)
    except GcsError as error:
        raise typer.Exit(print_error(error)) from None
    plan = Plan(loaded, seed, 1.0, "", zenoh, zenoh_role, truth_links=link)
    _supervise(plan, as_json)


def _supervise(plan: Plan, as_json: bool, stdin: int | None = None) -> None:
    """Run a simulated world until Ctrl-C, SIGTERM, or the end of standard input where that is given."""
    console = console_for(stderr=True)

    def report(event: dict[str, Any]) -> None:
        if as_json:
            print(json.dumps(event), flush=True)  # noqa: T201
        else:
            console.print(_in_words(event), highlight=False)

    supervisor = Supervisor(plan, report)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        try:
            supervisor.start()
            _watch(supervisor, stdin)
        except KeyboardInterrupt:
            pass
        finally:
            supervisor.stop()
    except GcsError as error:
        raise typer.Exit(print_error(error, console)) from None


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def _in_words(event: dict[str, Any]) -> str:
    match event["event"]:
        case "vehicle":
            return f"vehicle {event['system_id']} is process {event['pid']}"
        case "started":
            return f"flying at speed {event['speed']:g}; Ctrl-C ends it"
        case _:
            who = ", ".join(str(i) for i in event["system_ids"]) or "the world"
            return (
                f"{'vehicle ' if event['system_ids'] else ''}{who}: process ended with code {event['code']}"
            )


def _watch(supervisor: Supervisor, stdin: int | None) -> None:
    """Watch until interrupted, standard input closes, or the world ends; report vehicles that end."""
    with selectors.DefaultSelector() as selector:
        if stdin is not None:
            selector.register(stdin, selectors.EVENT_READ)
        while True:
            if selector.select(0.2) and stdin is not None and not os.read(stdin, 1024):
                return
            for child in supervisor.newly_ended():
                if not child.system_ids:
                    raise GcsError("the world's process ended: see the messages above")


@app.command()
def simulate(
    scenario: ScenarioArgument = "prescribed",
    seed: SeedOption = 1,
    runs: Annotated[int, typer.Option(min=1, help="How many seeds, from --seed upwards.")] = 1,
    as_json: Annotated[
        bool, typer.Option("--json", help="End with one JSON object on its own line.")
    ] = False,
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
    """Fly whole missions on virtual time, as fast as the machine can; the same seed, the same outcome."""
    from sim_vehicles.campaign.simulate import simulate as simulate_runs

    try:
        complete = simulate_runs(load(scenario), seed, runs, as_json, out, loss, duration)
    except GcsError as error:
        raise typer.Exit(print_error(error)) from None
    raise typer.Exit(0 if complete else 1)


@app.command(hidden=True)
def montecarlo(options: str) -> None:
    """Fly a campaign; `options` is the JSON of `MontecarloOptions`. People say `gcs montecarlo`."""
    import msgspec

    from sim_vehicles.campaign.montecarlo import MontecarloOptions, run_montecarlo

    try:
        complete = run_montecarlo(msgspec.json.decode(options, type=MontecarloOptions))
    except GcsError as error:
        raise typer.Exit(print_error(error)) from None
    raise typer.Exit(0 if complete else 1)


def main() -> None:
    """Entry point."""
    app()
