"""What vehicles are called: a MAVLink network and a system id in one number."""

from __future__ import annotations

from gcs.model.basics import Label


def vehicle_id(network: int, system_id: int) -> int:
    """Return the number that a vehicle is called by: its MAVLink network times 256, plus its system id."""
    return network << 8 | system_id


def network_of(vehicle: int) -> int:
    """MAVLink network of a vehicle."""
    return vehicle >> 8


def system_of(vehicle: int) -> int:
    """MAVLink system id of a vehicle, on its network."""
    return vehicle & 0xFF


def vehicle_name(vehicle: int) -> str:
    """Write a vehicle as people do: "17", or "2:17" on network 2."""
    network, system_id = network_of(vehicle), system_of(vehicle)
    return f"{network}:{system_id}" if network else str(system_id)


def target_name(label: Label) -> str:
    """Write a target's track label as people do: "T12.3", born in scan 12 at place 3 (or the third there)."""
    return f"T{label[0]}.{label[1]}"


def vehicle_of(text: str) -> int:
    """Read what `vehicle_name` writes.

    Raises
    ------
    ValueError
        When it is no such name.
    """
    network, _, system_id = text.rpartition(":")
    numbers = int(network or 0), int(system_id)
    if not (0 <= numbers[0] <= 255 and 1 <= numbers[1] <= 250):
        raise ValueError(text)
    return vehicle_id(*numbers)
