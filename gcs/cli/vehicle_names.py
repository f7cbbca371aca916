"""How vehicles are named on the command line."""

from __future__ import annotations

from collections.abc import Sequence

import typer


def vehicle_named(text: str) -> int:
    """Read a vehicle's name; the model is loaded only when it is needed.

    Raises
    ------
    typer.BadParameter
        It is none.
    """
    from gcs.model import vehicle_of

    try:
        return vehicle_of(text)
    except ValueError:
        raise typer.BadParameter(
            f"expected a system id such as 3, or 2:17 on network 2, got {text!r}"
        ) from None


def names(vehicles: Sequence[int]) -> str:
    """Name vehicles as an operator does: "vehicle 3", "vehicles 3, 2:17"."""
    from gcs.model import vehicle_name

    return f"vehicle{'s' if len(vehicles) > 1 else ''} {', '.join(map(vehicle_name, vehicles))}"
