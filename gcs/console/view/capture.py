"""State of a run at one time, as far as the console shows it.

A capture is made on the loop of the run, between two events (`gcs.console.engine`). Its parts are frozen
records or copies: they are encoded, and shown, while the engine goes on.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.console.view.page_records import ObstacleMap, ServiceState
from gcs.model import IntArray, NoFlyZone, Proposal, Route, SwarmStatus


@dataclass(frozen=True, slots=True)
class Capture:
    """State of the engine at one time."""

    t_ns: int
    status: SwarmStatus
    routes: tuple[Route, ...]
    """Routes that are flown, ordered by vehicle."""
    proposal: Proposal | None
    """The plan that waits for approval."""
    map: ObstacleMap
    """The same object until the map changes."""
    zones: tuple[NoFlyZone, ...]
    telemetry: IntArray
    """Telemetry table, with the counters of the links."""
    service: ServiceState | None = None
    """None in a replay."""
    number: int = 0
    """Number among the captures of a run."""


def same_routes(routes: tuple[Route, ...], others: tuple[Route, ...]) -> bool:
    """Return True if both have the same routes; records with arrays have no equality."""
    return len(routes) == len(others) and all(a is b for a, b in zip(routes, others, strict=True))
