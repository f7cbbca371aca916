"""Short sessions with vehicles: `vehicle_access`, `session`, and the tasks of `gcs fence` and `gcs param`.

`upload_mission` (`missions`) is the public interface, imported at first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gcs.io.vehicles.missions import upload_mission

__all__ = ["upload_mission"]


def __getattr__(name: str) -> Any:
    """Import the public name at first use (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gcs.io.vehicles import missions

    return missions.upload_mission
