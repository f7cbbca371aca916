"""Arguments and options that several commands share."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from gcs.errors import ConfigError
from gcs.mistake_codes import MistakeCode


def command_app(help: str | None = None) -> typer.Typer:  # noqa: A002  as Typer names it
    """Return an empty Typer app: for one command, or with `help` for a group of commands."""
    return typer.Typer(
        help=help, no_args_is_help=help is not None, rich_markup_mode="markdown", add_completion=False
    )


def complete_scenario(incomplete: str) -> list[str]:
    """Return the shipped scenarios that begin with `incomplete`, for tab completion."""
    from gcs.config import scenario_names

    return [name for name in scenario_names() if name.startswith(incomplete)]


def parse_vehicle(text: str) -> int:
    """Return the vehicle with a name such as 3, or 2:17 on network 2.

    Raises
    ------
    typer.BadParameter
        When the text is no vehicle's name.
    """
    from gcs.model import vehicle_of  # Loads numpy.

    try:
        return vehicle_of(text)
    except ValueError:
        raise typer.BadParameter(
            f"expected a system id such as 3, or 2:17 on network 2, got {text!r}"
        ) from None


def vehicles_text(vehicles: Sequence[int]) -> str:
    """Return vehicles as an operator names them: "vehicle 3", "vehicles 3, 2:17"."""
    from gcs.model import vehicle_name

    return f"vehicle{'s' if len(vehicles) > 1 else ''} {', '.join(map(vehicle_name, vehicles))}"


def confirm_or_abort(question: str) -> None:
    """Ask the user to confirm.

    Raises
    ------
    typer.Abort
        When the user refuses.
    typer.BadParameter
        When standard input is not a terminal.
    """
    if not sys.stdin.isatty():
        raise typer.BadParameter(f"{question} needs a confirmation: add --yes")
    typer.confirm(f"{question}?", abort=True, err=True)


def check_picture(path: Path | None) -> None:
    """Check the name of a picture, if one is wanted.

    Raises
    ------
    ConfigError
        When the name has another ending.
    """
    if path is not None and path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise ConfigError(
            str(path), "", MistakeCode.WRONG_TYPE, "expected a name that ends in .png, .pdf or .svg"
        )


ScenarioArgument = Annotated[
    str,
    typer.Argument(
        help="Name of a shipped scenario (see `gcs scenarios`) or a mission file.",
        autocompletion=complete_scenario,
    ),
]
ConfigArgument = Annotated[
    str,
    typer.Argument(
        help="A mission file, or the name of a shipped scenario.",
        metavar="CONFIG",
        autocompletion=complete_scenario,
    ),
]
SeedOption = Annotated[
    int,
    typer.Option(min=0, help="Seed of everything random: obstacles, vehicle losses, targets, noise."),
]
MapSeedOption = Annotated[int, typer.Option(min=0, help="Seed of the random obstacles of the mission file.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object as the last line.")]
HeadlessOption = Annotated[
    bool, typer.Option("--headless", help="Print plain lines instead of the live view.")
]


class LogFormat(StrEnum):
    """Form of what a run prints."""

    TEXT = "text"
    JSON = "json"


LogFormatOption = Annotated[
    LogFormat,
    typer.Option(
        "--log-format",
        help="*text*: a live view in a terminal, else lines.  *json*: one JSON object a line, with time, "
        "level, code, subject and parameters.",
    ),
]
ConsoleOption = Annotated[
    str | None,
    typer.Option(
        "--console",
        metavar="HOST:PORT|off",
        help="Address of the console, a page for the browser.  [default: 127.0.0.1, a free port from 8480]",
    ),
]
ConsoleAccessOption = Annotated[
    Path | None,
    typer.Option(
        "--console-access",
        metavar="FOLDER",
        help="Folder with cert.pem, key.pem, operate.token and perhaps view.token, for an address that other "
        "machines reach.",
    ),
]
ConsoleMapOption = Annotated[
    Path | None,
    typer.Option(
        "--console-map", metavar="FILE", help="MBTiles file with raster tiles, drawn under the console's map."
    ),
]
OpenOption = Annotated[bool, typer.Option("--open", help="Open the console in the browser.")]
LossOption = Annotated[
    float, typer.Option(min=0.0, max=1.0, help="Fraction of datagrams lost in each direction, 0 to 1.")
]
SpeedOption = Annotated[
    float,
    typer.Option(min=0.1, max=50.0, help="Speed as a multiple of real time; other ground stations expect 1."),
]
PackOption = Annotated[int, typer.Option(min=1, max=250, help="Simulated vehicles in each process.")]
SitlOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=PATH",
        help="Fly real firmware instead of simulated autopilots: arduplane=PATH (ArduPilot's SITL) or "
        "px4=PATH (PX4 with SIH). One process for each agent; they take off first. With both, agents in "
        "`simulation.px4` fly PX4.",
    ),
]
FaultsOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KIND:VEHICLE@SECONDS[+DURATION]",
        help="Break a vehicle in flight, simulated or real firmware, in addition to the faults of the "
        "scenario: crash, engine, gps, glitch, battery, rc, airspeed, fence or radio. Can be repeated.",
    ),
]
YES_HELP = "Do not ask for confirmation."
YesOption = Annotated[bool, typer.Option("--yes", help=YES_HELP)]
WaitOption = Annotated[float, typer.Option("--wait", min=1.0, help="Timeout in seconds.")]
VehicleOption = Annotated[
    list[int] | None,
    typer.Option(
        "--vehicle",
        "-v",
        parser=parse_vehicle,
        metavar="ID",
        help="System id of a vehicle, or 2:17 on network 2. Can be repeated.",
    ),
]
LinkOption = Annotated[
    str | None,
    typer.Option(
        "--link",
        metavar="ENDPOINT",
        help="MAVLink endpoint of the vehicles, such as udpin:0.0.0.0:14560.  "
        "[default: the links of the mission file]",
    ),
]
MissionOption = Annotated[
    str | None,
    typer.Option(help="Mission of the service.  [default: the one service on this machine]"),
]
ZenohOption = Annotated[
    str | None,
    typer.Option(
        metavar="ENDPOINT",
        help="zenoh endpoint of the service, such as tls/10.0.0.5:7447.  [default: this machine]",
    ),
]
ZenohTlsOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Folder with your certificate, as `gcs keys node` makes it, for an endpoint tls/HOST:PORT.  "
        "[default: that of the service on this machine]",
    ),
]
RecordedSeedOption = Annotated[
    int | None, typer.Option(min=0, help="Seed of the random obstacles.  [default: the recorded seed]")
]
DetectionsOption = Annotated[
    Path | None,
    typer.Option(help="Detections to add to a log: NPZ, CSV (k,x,y or t_s,x,y or t_ns,x,y), or a recording."),
]
ModelOption = Annotated[
    Path | None,
    typer.Option(help="Sensor model of the detections, TOML or NPZ.  [default: the model in their file]"),
]
OffsetOption = Annotated[
    float,
    typer.Option(metavar="S", help="Seconds to add to the times of the detections, from the log's start."),
]
