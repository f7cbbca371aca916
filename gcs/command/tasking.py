"""Missions on their way to vehicles: one transfer a vehicle at a time, the newest wins.

A route becomes a mission, a mission becomes a `MissionTask` (upload, read back, compare, start), and its
end becomes an `UploadReport`. A newer mission for the same vehicle replaces a transfer under way.
"""

from __future__ import annotations

import numpy as np

from gcs.config import AirframeTable, MissionTable
from gcs.geo import LocalFrame
from gcs.mavlink.codec import Message
from gcs.mavlink.fleet import Fleet
from gcs.mavlink.items import HOME_ITEMS, Home
from gcs.mavlink.transfer import MissionTask
from gcs.model import Effect, FloatArray, Mission, Notice, Route, Waypoint
from gcs.planning.progress import next_point
from gcs.planning.turning import acceptance_m

_CORRIDOR_M = 40.0
"""A vehicle this near to a leg of its new route flies it."""
_MAX_RADIUS_M = 255.0
"""What a mission item can hold."""


class Tasking:
    """All transfers under way.

    Parameters
    ----------
    table : MissionTable
        Altitude and least acceptance radius of every waypoint.
    airframe : AirframeTable
        How the vehicles turn: they are told to turn as long before each waypoint.
    frame : LocalFrame
        Where routes lie; its origin serves as home of a vehicle that has not told its own.
    fleet : Fleet
        Addresses and sequences.
    """

    def __init__(self, table: MissionTable, airframe: AirframeTable, frame: LocalFrame, fleet: Fleet) -> None:
        self._table = table
        self._airframe = airframe
        self._frame = frame
        self._fleet = fleet
        self._home = Home(frame.lat_deg, frame.lon_deg, frame.alt_msl_m)
        self._tasks: dict[int, MissionTask] = {}
        self._mission_count = 0

    @property
    def under_way(self) -> dict[int, str]:
        """Stage of each transfer under way, by vehicle."""
        return {vehicle: task.stage for vehicle, task in self._tasks.items()}

    def task(self, route: Route, t_ns: int) -> list[Effect]:
        """Send a route to its vehicle as a mission; a transfer under way is given up for it."""
        self._supersede(route.vehicle, t_ns)
        self._mission_count += 1
        mission = self._mission(route, self._mission_count)
        home = self._fleet.home(route.vehicle) or self._home
        encode, state = self._fleet.encoder(route.vehicle), self._fleet.state(route.vehicle)
        task = MissionTask(
            mission, home, encode, state=state, first_item=lambda: HOME_ITEMS + self._points_passed(route)
        )
        self._tasks[route.vehicle] = task
        return [*self._fleet.sends(route.vehicle, task.start(t_ns))]

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Give a vehicle's message to its transfer, if there is one."""
        task = self._tasks.get(vehicle)
        return [] if task is None else self._worked(vehicle, task, task.receive(message, t_ns))

    def poll(self, t_ns: int) -> list[Effect]:
        """Let timers run."""
        effects: list[Effect] = []
        for vehicle, task in list(self._tasks.items()):
            effects += self._worked(vehicle, task, task.poll(t_ns))
        return effects

    def cancel(self, vehicle: int, t_ns: int) -> None:
        """Stop talking to a vehicle: it is dead."""
        self._supersede(vehicle, t_ns)

    def abandon(self, vehicle: int, reason: str, t_ns: int) -> list[Effect]:
        """Give a transfer up safely: the vehicle keeps a whole mission, or holds and is cleared."""
        task = self._tasks.get(vehicle)
        return [] if task is None else self._worked(vehicle, task, task.abandon(reason, t_ns))

    def _supersede(self, vehicle: int, t_ns: int) -> None:
        task = self._tasks.pop(vehicle, None)
        if task is not None:
            task.supersede(t_ns)

    def _worked(self, vehicle: int, task: MissionTask, frames: list[bytes]) -> list[Effect]:
        effects: list[Effect] = [*self._fleet.sends(vehicle, frames)]
        if task.result is not None:
            del self._tasks[vehicle]
            effects.append(task.report())
            if task.result.held:
                text = f"agent {vehicle} was told to hold: {task.result.detail}"
                effects.append(Notice(task.result.t_ns, "alarm", text, vehicle))
        return effects

    def _points_passed(self, route: Route) -> int:
        state = self._fleet.state(route.vehicle)
        if state is None:
            return 0
        return next_point(route.points_m, (state.east_m, state.north_m), _CORRIDOR_M)

    def _mission(self, route: Route, mission_id: int) -> Mission:
        places = (self._frame.to_geodetic(float(east), float(north)) for east, north in route.points_m)
        table = self._table
        waypoints = tuple(
            Waypoint(*place, table.altitude_rel_m, float(radius_m))
            for place, radius_m in zip(places, self._acceptance_m(route), strict=True)
        )
        return Mission(mission_id, route.vehicle, waypoints, table.loiter_radius_m)

    def _acceptance_m(self, route: Route) -> FloatArray:
        """How near to each waypoint it counts as reached: soon enough to turn to the next one."""
        state = self._fleet.state(route.vehicle)
        start = route.points_m[:1] if state is None else [(state.east_m, state.north_m)]
        airframe = self._airframe
        wanted = acceptance_m(
            np.concatenate((start, route.points_m)),
            airframe.turn_radius_m,
            airframe.turn_lag_m,
            self._table.accept_radius_m,
        )
        return np.minimum(np.round(wanted, 0), _MAX_RADIUS_M)
