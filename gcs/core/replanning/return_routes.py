"""Return routes of missions that end with a landing.

A return route is planned when a mission is made, to the home that the vehicle reports. It is not part of the
route to the target.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gcs.config import Config
from gcs.core.replanning.plan_targets import plan_options
from gcs.core.replanning.replanner import is_crossed
from gcs.core.tasking.mission_builder import corners_of
from gcs.model import FloatArray, Route, VehicleState
from gcs.planning.map.grid import Grid, Point
from gcs.planning.planner_inputs import AgentState
from gcs.planning.terminal.landing import LandingSpec, ReturnRoute, plan_return_route


def landing_of(config: Config) -> LandingSpec | None:
    """Return how vehicles return and land; None if missions end with a loiter circle."""
    if config.mission.end != "land":
        return None
    return LandingSpec(corners_of(config.mission, config.airframe), config.airframe.turn_lag_s)


class ReturnRoutes:
    """Plans return routes.

    Attributes
    ----------
    grid : Grid
        The current map.
    newest_m : dict of int to ndarray, shape (k, 2)
        Return route of each vehicle's newest mission, from the end of its route.
    """

    def __init__(self, config: Config, grid: Grid) -> None:
        self.grid = grid
        self._config, self._options, self._landing = config, plan_options(config), landing_of(config)
        self.newest_m: dict[int, FloatArray] = {}
        self._speeds_m_s = {agent.vehicle: config.speed_m_s(agent.vehicle) for agent in config.agents}

    def plan(self, route: Route, state: VehicleState | None, home_deg: Point) -> ReturnRoute | None:
        """Return the return route to a home (latitude, longitude); None if the mission does not land.

        Without `state`, the route begins at its first point.
        """
        if self._landing is None:
            return None
        home_m = self._config.local_frame.to_local(*home_deg)
        speed_m_s = self._speeds_m_s.get(route.vehicle, self._config.airframe.speed_m_s)
        east_m, north_m = route.points_m[0].tolist() if state is None else (state.east_m, state.north_m)
        start = AgentState(east_m, north_m, None if state is None else state.course_rad, speed_m_s)
        return_route = plan_return_route(
            self.grid, start, route.points_m, home_m, self._options, self._landing
        )
        self.newest_m[route.vehicle] = np.vstack((route.points_m[-1:], return_route.points_m))
        return return_route

    def crossed(self, closed: Grid, returning: Mapping[int, Point]) -> set[int]:
        """Return the vehicles whose return routes lead through closed cells.

        Of a vehicle that is `returning`, only the part ahead of its position counts.
        """
        routes_m = self.newest_m.items()
        return {v for v, route_m in routes_m if is_crossed(closed, route_m, returning.get(v))}
