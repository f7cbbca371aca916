"""Numbers and names of vehicles and tracks: a network and a system id in one number; target T0.2."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from gcs.model.basics import Kind, Label

_HOME: Final = -1
_HOLD: Final = -2


def vehicle_id(network: int, system_id: int) -> int:
    """Return the number of a vehicle: 256 times its MAVLink network, plus its system id."""
    return (network << 8) | system_id


def network_of(vehicle: int) -> int:
    """Return the MAVLink network of a vehicle."""
    return vehicle >> 8


def system_of(vehicle: int) -> int:
    """Return the MAVLink system id of a vehicle."""
    return vehicle & 0xFF


def vehicle_name(vehicle: int) -> str:
    """Return the name of a vehicle: "17", or "2:17" on network 2."""
    network = network_of(vehicle)
    system_id = system_of(vehicle)
    return f"{network}:{system_id}" if network else str(system_id)


def named(vehicles: Iterable[int]) -> str:
    """Return vehicles in words: ``agents 1, 3``."""
    ids = sorted(vehicles)
    return f"agent{'s' if len(ids) != 1 else ''} {', '.join(map(vehicle_name, ids))}"


def target_name(label: Label) -> str:
    """Return the name of a target track: "T12.3", born in scan 12 with index 3; else "home" or "hold"."""
    if is_place(label):
        return "home" if label[0] == _HOME else "hold"
    return track_name("targets", label)


def home_label(vehicle: int) -> Label:
    """Return what a route home has in place of a target."""
    return (_HOME, vehicle)


def hold_label(vehicle: int) -> Label:
    """Return what the route of a vehicle that holds has in place of a target."""
    return (_HOLD, vehicle)


def is_place(label: Label) -> bool:
    """Return True if a label is of home, or of a place to hold, and not of a target."""
    return label[0] < 0


def track_name(kind: Kind, label: Label) -> str:
    """Return the name of a track: "T12.3" of a target, "A12.3" of an agent.

    The letter keeps it a word for programs: as numbers, 0.1 and 0.10 would be one track.
    """
    return f"{'T' if kind == 'targets' else 'A'}{label[0]}.{label[1]}"


def targets_text(labels: Iterable[Label]) -> str:
    """Return targets in words: ``targets T0.1, T12.3``."""
    names = [target_name(label) for label in sorted(labels)]
    return f"target{'s' if len(names) != 1 else ''} {', '.join(names)}"


def target_of(text: str) -> Label:
    """Parse a name that `target_name` returned.

    Raises
    ------
    ValueError
        If it is none.
    """
    scan, separator, index = text.removeprefix("T").partition(".")
    if not (separator and scan.isdecimal() and index.isdecimal()):
        raise ValueError(f"expected the name of a target, such as T0.1, got {text!r}")
    return int(scan), int(index)


def vehicle_of(text: str) -> int:
    """Parse a name that `vehicle_name` returned.

    Raises
    ------
    ValueError
        When the text is no vehicle name.
    """
    network, _, system_id = text.rpartition(":")
    numbers = int(network or 0), int(system_id)
    if not (0 <= numbers[0] <= 255 and 1 <= numbers[1] <= 250):
        raise ValueError(text)
    return vehicle_id(*numbers)
