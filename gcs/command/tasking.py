"""Missions on their way to vehicles: one transfer a vehicle at a time, the newest wins.

A route becomes a mission, a mission becomes a `MissionTask` (upload, read back, compare, start), and its end becomes an
`UploadReport`. A newer mission for the same vehicle replaces a transfer under way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gcs.config import MissionTable
from gcs.geo import LocalFrame
from gcs.mavlink.fleet import Fleet
from gcs.mavlink.transfer import MissionTask
from gcs.model import NS_PER_S, Mission, Notice, Route, Send, UploadReport, Waypoint


@dataclass(slots=True)
class _Transfer:
    mission: Mission
    task: MissionTask
    started_t_ns: int


class Tasking:
    """All transfers under way."""

    def __init__(self, table: MissionTable, frame: LocalFrame, fleet: Fleet) -> None:
        self._table = table
        self._frame = frame
        self._fleet = fleet
        self._transfers: dict[int, _Transfer] = {}
        self._mission_count = 0

    @property
    def under_way(self) -> dict[int, str]:
        """Stage of each transfer under way, by vehicle."""
        return {vehicle: str(transfer.task.stage) for vehicle, transfer in self._transfers.items()}

    def task(self, route: Route, t_ns: int) -> list[Send | UploadReport | Notice]:
        """Send a route to its vehicle as a mission."""
        self._mission_count += 1
        mission = self._mission(route, self._mission_count)
        task = MissionTask(mission, self._fleet, t_ns)
        self._transfers[route.vehicle] = _Transfer(mission, task, t_ns)
        return list(self._sends(route.vehicle, task.start(t_ns)))

    def receive(self, vehicle: int, message: Any, t_ns: int) -> list[Send | UploadReport | Notice]:
        """Give a vehicle's message to its transfer, if there is one."""
        transfer = self._transfers.get(vehicle)
        if transfer is None:
            return []
        return [*self._sends(vehicle, transfer.task.receive(message, t_ns)), *self._ended(vehicle, t_ns)]

    def poll(self, t_ns: int) -> list[Send | UploadReport | Notice]:
        """Let timers run."""
        effects: list[Send | UploadReport | Notice] = []
        for vehicle in list(self._transfers):
            effects += self._sends(vehicle, self._transfers[vehicle].task.poll(t_ns))
            effects += self._ended(vehicle, t_ns)
        return effects

    def cancel(self, vehicle: int) -> None:
        """Stop talking to a vehicle: it is dead."""
        self._transfers.pop(vehicle, None)
