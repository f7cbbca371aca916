"""Figures of proposed routes, and which changes make a plan a different one.

The figures are those of the flight that is forward-simulated from the plan: the flight until the mission
arrives, or ground roll and climb, then the legs with their turns, and the loiter circle. A vehicle turns with
its planned bank or more steeply: its clearance is the lesser of both.

A number identifies an assignment, with routes of about the length and separation first shown. Routes are
planned again while vehicles fly on. A larger change makes it another plan, with another number.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs.config import Config
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.tasking.mission_builder import mission_ahead
from gcs.model import FloatArray, Route, RouteFigures, target_name, vehicle_name
from gcs.planning.forward_simulation import Motion, simulate
from gcs.planning.map.grid import Grid
from gcs.planning.map.line_of_sight import path_clearance
from gcs.planning.mission_flight import NOWHERE, simulate_mission

LONGER_FRACTION = 0.25
"""Maximum increase of a route's length, as a fraction; a full turn is allowed, too."""
NEARER_SHARE = 0.25
"""Maximum decrease of a distance, as a share of the required one: turns on to a route vary by so much."""


class PlanFigures:
    """Lengths, times, separations and clearances of proposed routes, as they will be flown."""

    def __init__(self, config: Config) -> None:
        self._airframes = config.airframes_of_agents
        self._clearance_m = config.planning.clearance_m
        self._separation_m = config.planning.separation_m

    def of(
        self,
        routes: Sequence[Route],
        shown: Mapping[int, RouteFigures],
        grid: Grid,
        inputs: PlanningInputs,
        delays_s: Mapping[int, float],
        separation_m: Mapping[int, float],
        short: Container[int],
    ) -> tuple[RouteFigures, ...]:
        """Return the figures of routes.

        Parameters
        ----------
        shown
            Figures of each vehicle when the number was first shown; none for a new number.
        delays_s
            Time until each vehicle begins its route or its climb.
        separation_m
            Minimum distance of each vehicle to another of its altitude layer.
        short
            Vehicles whose routes end before their targets.
        """
        found = []
        for route in routes:
            vehicle = route.vehicle
            apart_m = separation_m.get(vehicle, math.inf)
            before = shown.get(vehicle)
            climb = inputs.climbs.get(vehicle)
            length_m = route.length_m + (0.0 if climb is None else climb.latest_length_m)
            flights = [
                self._flight(route, inputs, delays_s.get(vehicle, 0.0), radius_m)
                for radius_m in (self._airframes[vehicle].turn_radius_m, 0.0)
            ]
            found.append(
                RouteFigures(
                    vehicle,
                    length_m,
                    before.shown_length_m if before is not None else length_m,
                    flights[0][1],
                    apart_m if math.isfinite(apart_m) else None,
                    self._clear_m(grid, [flown_m for flown_m, _ in flights]),
                    vehicle in short,
                )
            )
        return tuple(found)

    def _flight(
        self, route: Route, inputs: PlanningInputs, delay_s: float, turn_radius_m: float
    ) -> tuple[FloatArray, float]:
        """Return what will be flown in the air, with the loiter circle, (k, 2), and the time of arrival.

        `turn_radius_m` is that of the tightest turn; 0: as the autopilot's guidance commands it.
        """
        vehicle = route.vehicle
        airframe = self._airframes[vehicle]
        climb = inputs.climbs.get(vehicle)
        before_m = np.empty((0, 2))
        climb_end_m = None
        if climb is not None:
            climb_end_m = climb.end_m
            delay_s = 2.0 * climb.roll_s
            begin = Motion(*climb.at(climb.ground_run_m), climb.speed_m_s, climb.heading_rad)
        elif vehicle in inputs.agents:
            before = simulate(NOWHERE, inputs.motion(vehicle), delay_s, airframe.turn_lag_s)
            before_m = before.states[:-1, :2]
            begin = before.motion_at(-1)
        else:
            east_m, north_m = route.points_m[0].tolist()
            begin = Motion(east_m, north_m, airframe.speed_m_s, 0.0)
        flight = simulate_mission(
            replace(begin, speed_m_s=airframe.speed_m_s),
            climb_end_m,
            mission_ahead(route, climb_end_m or begin.place_m, airframe),
            airframe.turn_lag_s,
            turn_radius_m,
        )
        return np.concatenate((before_m, flight.places_m)), delay_s + flight.time_to_s(len(route.points_m))

    def _clear_m(self, grid: Grid, flights_m: Sequence[FloatArray]) -> float | None:
        """Return the clearance of possible flights from obstacles, at most the required one."""
        if self._clearance_m <= 0.0:
            return None
        frame = np.array([*grid.origin_m, grid.spacing_m])
        most = self._clearance_m / grid.spacing_m
        for flown_m in flights_m:
            most = float(path_clearance(grid.blocked, frame, flown_m, most))
        return grid.spacing_m * most

    def change(self, route: Route, now: RouteFigures, shown: RouteFigures) -> str:
        """Return how a route differs from the one shown; empty if it is about the same."""
        agent = f"agent {vehicle_name(now.vehicle)}"
        if now.is_short and not shown.is_short:
            return f"no clear path leads {agent} past target {target_name(route.target)} any more"
        longer_m = now.length_m - shown.length_m
        full_turn_m = 2.0 * math.pi * self._airframes[now.vehicle].planned_radius_m
        if longer_m > max(LONGER_FRACTION * shown.length_m, full_turn_m):
            return f"the route of {agent} is {longer_m:.0f} m longer than shown ({shown.length_m:.0f} m)"
        if _is_nearer(now.separation_m, shown.separation_m, self._separation_m):
            return f"{agent} would come within {now.separation_m:.0f} m of another at its altitude"
        if _is_nearer(now.clearance_m, shown.clearance_m, self._clearance_m):
            return f"{agent} would come within {now.clearance_m:.0f} m of an obstacle"
        return ""


def _is_nearer(now_m: float | None, shown_m: float | None, required_m: float) -> bool:
    if now_m is None or now_m >= required_m:
        return False
    return shown_m is None or now_m < shown_m - NEARER_SHARE * required_m
