"""What the console reads of the engine, in one place.

A capture is made on the loop of the service, between two events. Its parts are frozen records or copies, so
that another thread may read them while the engine goes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from gcs.console.view.details import VehicleDetail, collect_details
from gcs.core.engine import Engine
from gcs.core.perception.sensor_watchdog import WatchedSensor
from gcs.core.state import flown_routes
from gcs.io.recording.writer import DiskSpace
from gcs.model import NS_PER_S, IntArray, NoFlyZone, Proposal, Route, SwarmStatus, VehicleState
from gcs.planning.map.grid import Grid

SensorState: TypeAlias = Literal["", "late", "silent"]
"""Empty if scans come in time; `silent` while the alarm about that is raised."""
_LATE_PERIODS: Final = 2
_LATE_NS: Final = NS_PER_S


@dataclass(frozen=True, slots=True)
class ServiceState:
    """State of the service around the engine; a replay has none."""

    lag_s: float
    """Run time that the newest tick waited before it was processed."""
    dropped: int
    """Events that found the queue of the service full."""
    is_recording: bool
    space: DiskSpace | None
    """Space of the recording; None if it is not known."""
    stations: tuple[str, ...]
    """Other ground stations: address, and system and component ids."""


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
    telemetry: IntArray
    """Telemetry table, with the counters of the links."""
    sensors: dict[str, SensorState]
    details: dict[int, VehicleDetail]
    service: ServiceState | None = None
    """None in a replay."""


def capture(engine: Engine, t_ns: int, service: ServiceState | None = None) -> Capture:
    """Return the state of the engine now."""
    statuses = [agent.perception.status for agent in engine.state.agents.values()]
    return Capture(
        t_ns=t_ns,
        status=engine.stages.status_report.build(t_ns),
        states=engine.stages.fleet.states(),
        routes=tuple(flown_routes(engine.state.agents).values()),
        proposal=engine.state.operator.approval.pending,
        grid=engine.grid,
        zones=tuple(engine.state.airspace.zones.values()),
        lost_at_m={
            one.vehicle: one.position_m
            for one in statuses
            if one.status in ("lost", "down") and one.position_m is not None
        },
        telemetry=engine.state.fleet.table.copy(),
        sensors={
            name: _sensor_state(one, t_ns)
            for name, one in engine.state.perception.sensor_watchdog.sensors.items()
        },
        details=collect_details(engine, t_ns),
        service=service,
    )


def _sensor_state(sensor: WatchedSensor, t_ns: int) -> SensorState:
    if sensor.alarmed:
        return "silent"
    since_t_ns = sensor.first_t_ns if sensor.processed_t_ns is None else sensor.processed_t_ns
    return "late" if t_ns - since_t_ns > max(_LATE_NS, _LATE_PERIODS * sensor.period_ns) else ""
