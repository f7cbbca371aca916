"""What the console reads of the engine, in one place.

A capture is made on the loop of the service, between two events. Its parts are frozen records or copies, so
that another thread may read them while the engine goes on.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.core.engine import Engine
from gcs.core.state import flown_routes
from gcs.model import NoFlyZone, Proposal, Route, SwarmStatus, VehicleState
from gcs.planning.map.grid import Grid


@dataclass(frozen=True, slots=True)
class Capture:
    """State of the engine at one time."""

    t_ns: int
    status: SwarmStatus
    states: tuple[VehicleState, ...]
    routes: tuple[Route, ...]
    """Routes that are flown, ordered by vehicle."""
    proposal: Proposal | None
    """The plan that waits for approval."""
    grid: Grid
    zones: tuple[NoFlyZone, ...]
    lost_at_m: dict[int, tuple[float, float]]
    """Position at which each lost vehicle was last seen."""
    lag_s: float = 0.0
    """Run time that the newest tick waited before it was processed."""
    dropped: int = 0
    """Events that found the queue of the service full."""
    is_recording: bool = False


def capture(
    engine: Engine, t_ns: int, *, lag_s: float = 0.0, dropped: int = 0, is_recording: bool = False
) -> Capture:
    """Return the state of the engine now."""
    statuses = [agent.perception.status for agent in engine.state.agents.values()]
    return Capture(
        t_ns=t_ns,
        status=engine.status_report.build(t_ns),
        states=engine.fleet.states(),
        routes=tuple(flown_routes(engine.state.agents).values()),
        proposal=engine.state.operator.approval.pending,
        grid=engine.grid,
        zones=tuple(engine.state.airspace.zones.values()),
        lost_at_m={
            one.vehicle: one.position_m
            for one in statuses
            if one.status == "lost" and one.position_m is not None
        },
        lag_s=lag_s,
        dropped=dropped,
        is_recording=is_recording,
    )
