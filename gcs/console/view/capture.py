"""What the console reads of the engine for its pages, in one place.

A capture is made on the loop of the service, between two events. Its parts are frozen records or copies, so
that another thread may read them while the engine goes on.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.console.view.schema import ServiceState
from gcs.core.engine import Engine
from gcs.core.state import flown_routes
from gcs.model import IntArray, NoFlyZone, Proposal, Route, SwarmStatus
from gcs.planning.map.grid import Grid


@dataclass(frozen=True, slots=True)
class Capture:
    """State of the engine at one time."""

    t_ns: int
    status: SwarmStatus
    routes: tuple[Route, ...]
    """Routes that are flown, ordered by vehicle."""
    proposal: Proposal | None
    """The plan that waits for approval."""
    grid: Grid
    zones: tuple[NoFlyZone, ...]
    telemetry: IntArray
    """Telemetry table, with the counters of the links."""
    service: ServiceState | None = None
    """None in a replay."""


def capture(engine: Engine, t_ns: int, service: ServiceState | None = None) -> Capture:
    """Return the state of the engine now."""
    pending = engine.state.operator.approval.pending
    return Capture(
        t_ns=t_ns,
        status=engine.stages.status_report.build(t_ns),
        routes=tuple(flown_routes(engine.state.agents).values()),
        proposal=pending if pending is not None and pending.routes else None,
        grid=engine.grid,
        zones=tuple(engine.state.airspace.zones.values()),
        telemetry=engine.state.fleet.table.copy(),
        service=service,
    )
