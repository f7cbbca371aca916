"""Start of the processes of a simulated world: their arguments as JSON, and the common start.

The supervisor runs ``python -m MODULE JSON``, with the JSON of a class below. The process prints ``ready``,
reads the start as one JSON line, and ends when its standard input closes.
"""

from __future__ import annotations

import select
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

import msgspec
import numpy as np

from gcs.geo import LocalFrame
from gcs.io.clock import RunClock
from gcs.terrain.elevation_grid import Elevation
from sim_vehicles.vehicle.vehicle import VehicleSpec

Address: TypeAlias = tuple[str, int]
"""Host and UDP port."""
Firmware: TypeAlias = Literal["arduplane", "px4"]
T = TypeVar("T")
_IDLE_S = 0.05


@dataclass(frozen=True, slots=True)
class VehicleArguments:
    """Arguments of a process with vehicles."""

    frame: LocalFrame
    specs: list[VehicleSpec]
    loss: float = 0.0
    """Fraction of datagrams lost, each way."""
    elevation: str = ""
    """File of the ground (`save_elevation`); empty without an elevation model."""


@dataclass(frozen=True, slots=True)
class FirmwareArguments:
    """Arguments of the process of one real firmware."""

    vehicle: VehicleArguments
    gcs: Address
    """Ground station."""
    truth: Address
    """Receiver of true states: the simulated world."""
    firmware: Firmware
    binary: str
    instance: int
    """Number that sets the ports."""
    speed: float
    folder: str


@dataclass(frozen=True, slots=True)
class WorldArguments:
    """Arguments of the process of the world."""

    scenario: str
    seed: int
    zenoh: str
    zenoh_role: Literal["listen", "connect"]
    waits_for_ground: bool
    """True if targets stand until ground contact."""
    zenoh_tls: str = ""
    """Folder of the certificate; empty without TLS."""


@dataclass(frozen=True, slots=True)
class TruthLinkArguments:
    """Arguments of a link to the simulation of running vehicles."""

    link: str
    truth: Address


@dataclass(frozen=True, slots=True)
class Start:
    """Start of the flight: run time `start_t_ns` at the Unix time `epoch_ns`, advancing at `speed`."""

    epoch_ns: int
    start_t_ns: int
    speed: float
    gcs: Address
    """Ground station."""
    truth: Address | None = None
    """Receiver of true states: the simulated world."""

    def line(self) -> str:
        """Return the line that a process reads."""
        return msgspec.json.encode(self).decode() + "\n"

    @property
    def clock(self) -> RunClock:
        """The common clock."""
        return RunClock(self.epoch_ns, self.start_t_ns, self.speed)


def save_elevation(elevation: Elevation, path: Path) -> None:
    """Write the ground for the processes of vehicles."""
    np.savez(path, origin=elevation.origin_m, spacing=elevation.spacing_m, heights=elevation.heights_msl_m)


def load_elevation(path: str) -> Elevation | None:
    """Return the ground in a file; None without one."""
    if not path:
        return None
    with np.load(path) as arrays:
        east_m, north_m = arrays["origin"].tolist()
        return Elevation((east_m, north_m), float(arrays["spacing"]), arrays["heights"])


def process_command(module: str, arguments: object) -> list[str]:
    """Return the command line of a process of `sim_vehicles`."""
    encoded = msgspec.json.encode(arguments).decode()
    return [sys.executable, "-P", "-m", f"sim_vehicles.{module}", encoded]


def read_arguments(arguments_type: type[T]) -> T:
    """Return the arguments of this process."""
    return msgspec.json.decode(sys.argv[1], type=arguments_type)


def await_start(ready: str = "ready", idle: Callable[[], None] | None = None) -> Start | None:
    """Report that this process is ready, and return the start; None if standard input closed.

    `idle` is called again and again until it comes.
    """
    sys.stdout.write(f"{ready}\n")
    sys.stdout.flush()
    while idle is not None and not select.select([sys.stdin], [], [], _IDLE_S)[0]:
        idle()
    line = sys.stdin.buffer.readline()
    if not line.strip():
        return None
    return msgspec.json.decode(line, type=Start)
