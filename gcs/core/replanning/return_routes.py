"""Ways home of vehicles that land at their missions' ends, by the map of the moment.

A way home is planned when a mission is made: home is known then as the vehicle says it, and only those ways
are planned that are flown. It is no part of a route: routes are judged by their targets.
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
    """Return how vehicles of a mission fly home; None when they wait at the ends of their routes."""
    if config.mission.end != "land":
        return None
    return LandingSpec(corners_of(config.mission, config.airframe), config.airframe.turn_lag_s)


class ReturnRoutes:
    """Plans ways home.

    Attributes
    ----------
    grid : Grid
        The map of the moment.
    newest_m : dict of int to ndarray, shape (k, 2)
        Each vehicle's way home, from the end of its route; of the newest mission that was made for it.
    """

    def __init__(self, config: Config, grid: Grid) -> None:
        self.grid = grid
        self._config, self._options, self._landing = config, plan_options(config), landing_of(config)
        self.newest_m: dict[int, FloatArray] = {}
        self._speeds_m_s = {agent.vehicle: config.speed_m_s(agent.vehicle) for agent in config.agents}

    def way(self, route: Route, state: VehicleState | None, home_deg: Point) -> ReturnRoute | None:
        """Return a vehicle's way to its home (latitude, longitude) after its route; None if it does not land.

        What it knows of the vehicle's place is `state`; without, the route begins at its first point.
        """
        if self._landing is None:
            return None
        home_m = self._config.local_frame.to_local(*home_deg)
        speed_m_s = self._speeds_m_s.get(route.vehicle, self._config.airframe.speed_m_s)
        east_m, north_m = route.points_m[0].tolist() if state is None else (state.east_m, state.north_m)
        start = AgentState(east_m, north_m, None if state is None else state.course_rad, speed_m_s)
        way = plan_return_route(self.grid, start, route.points_m, home_m, self._options, self._landing)
        self.newest_m[route.vehicle] = np.vstack((route.points_m[-1:], way.points_m))
        return way

    def crossed(self, closed: Grid, on_the_way: Mapping[int, Point]) -> set[int]:
        """Vehicles whose newest ways home lead through what is closed.

        Those that are `on_the_way`, and where, have a part behind them.
        """
        ways = self.newest_m.items()
        return {vehicle for vehicle, way_m in ways if is_crossed(closed, way_m, on_the_way.get(vehicle))}
