"""The ``sim-vehicles`` command: simulated vehicles and their world, for any ground station."""

from __future__ import annotations

import json
import os
import selectors
import signal
import socket
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from gcs.cli.arguments import (
    FaultsOption,
    LossOption,
    PackOption,
    ScenarioArgument,
    SeedOption,
    SitlOption,
    SpeedOption,
)
from gcs.cli.errors import exit_on_error
from gcs.errors import ConfigError, GcsError, LinkError
from gcs.io.terminal import console_for
from gcs.mistake_codes import MistakeCode

if TYPE_CHECKING:
    from sim_vehicles.supervisor import SimulationPlan, Supervisor

app = typer.Typer(
    help="Simulated fixed-wing vehicles and the world they fly in, over real MAVLink and real zenoh.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)

ZenohOption = Annotated[
    str,
    typer.Option(
        help="zenoh endpoint for scans and ground truth; with a standby both, with a comma between."
    ),
]
ZenohRoleOption = Annotated[
    Literal["connect", "listen"],
    typer.Option(help="connect: to a listening central command (`gcs run`); listen: wait for connections."),
]
ZenohTlsOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Folder with a certificate of the role command (the world has all sensors), for zenoh endpoints "
        "tls/HOST:PORT.",
    ),
]
JsonLinesOption = Annotated[bool, typer.Option("--json", help="Print events as JSON, one object a line.")]


def _show_version(is_wanted: bool) -> None:
    if is_wanted:
        import importlib.metadata

        typer.echo(f"sim-vehicles {importlib.metadata.version('swarm-gcs')}")
        raise typer.Exit


@app.callback()
def callback(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    """Simulated fixed-wing vehicles and the world they fly in."""


@app.command()
def run(
    scenario: ScenarioArgument,
    seed: SeedOption = 1,
    speed: SpeedOption = 1.0,
    gcs: Annotated[
        str, typer.Option(help="HOST:PORT of the ground station of all vehicles.")
    ] = "127.0.0.1:14550",
    zenoh: ZenohOption = "tcp/127.0.0.1:7447",
    zenoh_role: ZenohRoleOption = "connect",
    zenoh_tls: ZenohTlsOption = None,
    pack: PackOption = 1,
    loss: LossOption = 0.0,
    start_at_once: Annotated[
        bool,
        typer.Option(
            "--start-at-once",
            help="Start targets and vehicle losses at once, not when a ground station has been heard for "
            "10 s.",
        ),
    ] = False,
    sitl: SitlOption = None,
    sitl_folder: Annotated[
        Path | None,
        typer.Option(help="Folder for files and logs of the firmware.  [default: a temporary folder]"),
    ] = None,
    faults: FaultsOption = None,
    as_json: JsonLinesOption = False,
    until_stdin_closes: Annotated[bool, typer.Option(hidden=True)] = False,
    await_ground_station: Annotated[bool, typer.Option(hidden=True)] = False,
) -> None:
    """Fly the vehicles of a scenario until Ctrl-C.

    Each vehicle is a process with its own UDP socket. It behaves like ArduPlane, loiters at its start and
    waits for a mission. Targets start to move, and losses start, when a ground station has been heard for
    10 s. Connect QGroundControl, MAVProxy (`mavproxy.py --master=udpin:0.0.0.0:14550`) or `gcs run SCENARIO`.
    """
    from sim_vehicles.autopilots.firmware import parse_sitl
    from sim_vehicles.supervisor import SimulationPlan
    from sim_vehicles.world.scenario import load, with_faults

    with exit_on_error():
        firmware = dict(parse_sitl(text) for text in sitl or [])
        loaded = with_faults(load(scenario), faults or [])
        _check_certificate(zenoh, zenoh_role, zenoh_tls)
    waits = not start_at_once
    connections = _address(gcs), zenoh, zenoh_role
    plan = SimulationPlan(
        loaded, seed, speed, *connections, pack, loss, waits, firmware, sitl_folder, zenoh_tls=zenoh_tls
    )
    stdin = sys.stdin.fileno() if until_stdin_closes else None
    _supervise(plan, as_json, stdin, awaits_ground_station=await_ground_station)


@app.command()
def world(
    scenario: ScenarioArgument,
    link: Annotated[
        list[str],
        typer.Option(
            metavar="ENDPOINT",
            help="MAVLink endpoint of running vehicles, such as tcp:127.0.0.1:5762 (second port of "
            "ArduPilot's SITL) or udpin:127.0.0.1:14551. Can be repeated.",
        ),
    ],
    seed: SeedOption = 1,
    zenoh: ZenohOption = "tcp/127.0.0.1:7447",
    zenoh_role: ZenohRoleOption = "connect",
    zenoh_tls: ZenohTlsOption = None,
    as_json: JsonLinesOption = False,
) -> None:
    """Simulate the targets and sensors of a scenario around running vehicles, until Ctrl-C.

    The sensors detect the vehicles at their true positions (SIMSTATE of ArduPilot's SITL,
    HIL_STATE_QUATERNION of PX4), or without such messages at their reported positions.
    """
    from sim_vehicles.supervisor import SimulationPlan
    from sim_vehicles.world.scenario import load

    with exit_on_error():
        loaded = load(scenario)
        _check_certificate(zenoh, zenoh_role, zenoh_tls)
    plan = SimulationPlan(
        loaded, seed, 1.0, ("", 0), zenoh, zenoh_role, truth_links=link, zenoh_tls=zenoh_tls
    )
    _supervise(plan, as_json)


def _check_certificate(endpoint: str, role: str, folder: Path | None) -> None:
    """Check that a certificate is accepted, and lets the world publish for all sensors."""
    from gcs.io.zenoh.certificates import read_node
    from gcs.io.zenoh.handshake import tls_problem
    from gcs.io.zenoh.session import check_transport

    check_transport(endpoint.split(","), folder)
    if folder is None:
        return
    node = read_node(folder)
    if node.role != "command":
        problem = f"{node.common_name} may publish for itself alone; the simulated world has all sensors: "
        raise ConfigError(
            str(folder),
            "--zenoh-tls",
            MistakeCode.BAD_CREDENTIALS,
            problem + "expected a certificate of the role command",
        )
    if role == "connect" and (refusal := tls_problem(endpoint, folder)):
        raise LinkError(endpoint, refusal)


def _address(text: str) -> tuple[str, int]:
    host, separator, port = text.rpartition(":")
    try:
        return socket.gethostbyname(host), int(port)
    except (OSError, ValueError):
        problem = "no such host" if separator and port.isdigit() else "expected HOST:PORT"
        raise typer.BadParameter(f"{problem}: {text!r}", param_hint="--gcs") from None


def _supervise(
    plan: SimulationPlan, as_json: bool, stdin: int | None = None, *, awaits_ground_station: bool = False
) -> None:
    """Run a simulated world until Ctrl-C, SIGTERM, or the end of `stdin` (a file descriptor).

    With `awaits_ground_station` it starts when standard input has a line HOST:PORT.
    """
    from sim_vehicles.supervisor import Supervisor

    console = console_for(stderr=True)

    def report(event: dict[str, Any]) -> None:
        if as_json:
            print(json.dumps(event), flush=True)  # noqa: T201
        else:
            console.print(_event_text(event), highlight=False)

    supervisor = Supervisor(plan, report)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with exit_on_error():
        try:
            supervisor.start()
            line = sys.stdin.readline().strip() if awaits_ground_station else ""
            if line or not awaits_ground_station:
                supervisor.begin(_address(line) if line else None)
                _watch(supervisor, stdin)
        except KeyboardInterrupt:
            pass
        finally:
            supervisor.stop()


def _event_text(event: dict[str, Any]) -> str:
    match event["event"]:
        case "vehicle":
            return f"vehicle {event['system_id']} is process {event['pid']}"
        case "started":
            return f"flying at speed {event['speed']:g}; Ctrl-C ends it"
        case _:
            names = ", ".join(str(i) for i in event["system_ids"])
            return f"{f'vehicle {names}' if names else 'the world'}: process ended with code {event['code']}"


def _watch(supervisor: Supervisor, stdin: int | None) -> None:
    """Watch until standard input closes or the world ends; report vehicles that end."""
    with selectors.DefaultSelector() as selector:
        if stdin is not None:
            selector.register(stdin, selectors.EVENT_READ)
        while True:
            if selector.select(0.2) and stdin is not None and not os.read(stdin, 1024):
                return
            for child in supervisor.newly_ended():
                if not child.system_ids:
                    raise GcsError("the world's process ended: see the messages above")


@app.command(hidden=True)
def simulate(options: str) -> None:
    """Fly missions for `gcs simulate`; `options` is the JSON of `SimulateOptions`."""
    import msgspec

    from sim_vehicles.campaign.simulate import SimulateOptions
    from sim_vehicles.campaign.simulate import simulate as simulate_runs

    decoded = msgspec.json.decode(options, type=SimulateOptions)
    with exit_on_error(as_json=decoded.as_json):
        are_complete = simulate_runs(decoded)
    raise typer.Exit(0 if are_complete else 1)


@app.command(hidden=True)
def montecarlo(options: str) -> None:
    """Fly a campaign for `gcs montecarlo`; `options` is the JSON of `MontecarloOptions`."""
    import msgspec

    from sim_vehicles.campaign.montecarlo import MontecarloOptions, run_montecarlo

    decoded = msgspec.json.decode(options, type=MontecarloOptions)
    with exit_on_error(as_json=decoded.as_json):
        are_complete = run_montecarlo(decoded)
    raise typer.Exit(0 if are_complete else 1)


def main() -> None:
    """Run the ``sim-vehicles`` command."""
    app()
