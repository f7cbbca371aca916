"""Return routes of missions that end with a landing.

A return route is planned once for each route, to the home that the vehicle reports, when the route is sent.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from typing import Final, TypeAlias

import numpy as np
from pymavlink.dialects.v20.ardupilotmega import MAV_CMD_NAV_WAYPOINT

from gcs.config import Config
from gcs.config.airframe import AgentAirframe
from gcs.core.airspace.no_fly_zones import MapChange, NoFlyZones
from gcs.core.airspace.obstacle_map import LowFlight
from gcs.core.replanning.mission_inputs import terrain_of
from gcs.core.replanning.plan_targets import vehicle_options
from gcs.core.replanning.route_crossing import is_crossed, rest_of
from gcs.core.separation.landing_order import LandingOrder
from gcs.core.state import Agent
from gcs.core.tasking.mission_builder import corners_of, is_hold
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.mission.item_builder import APPROACH_ALT_M, DESCENT_SLOPE
from gcs.model import APPROACH_M, Effect, FloatArray, Notice, NoticeCode, Parameter, Route
from gcs.planning.manoeuvres.landing import LandingSpec, ReturnRoute, plan_return_route
from gcs.planning.map.grid import Grid, Point
from gcs.planning.planner_inputs import AgentState, MissionInputs, PlanOptions
from gcs.planning.terrain.landing import LandingSite, plan_return_over_terrain

_MAX_PLACES: Final = 3
"""Places beside a target that are tried for the wait before a landing."""
_Task: TypeAlias = tuple[Grid, AgentState, FloatArray, Point, PlanOptions, LandingSpec]
NO_APPROACH: Final = (
    "no approach to its home keeps above the ground; its mission ends with a circle at its target"
)


def landing_of(airframe: AgentAirframe) -> LandingSpec | None:
    """Return how vehicles return and land; None if their missions end with a loiter circle."""
    return LandingSpec(corners_of(airframe), airframe.turn_lag_s) if airframe.end == "land" else None


def return_over_terrain(mission: MissionInputs, route: Route, home_m: Point) -> ReturnRoute | None:
    """Return the return route of a plan that is not flown; None where no approach is clear."""
    assert mission.terrain is not None
    agent = mission.agents[route.vehicle]
    options = agent.options or mission.options
    site = LandingSite(home_m, APPROACH_ALT_M, mission.grid)
    return plan_return_over_terrain(mission.terrain, mission.grid, route, site, agent.speed_m_s, options)


class ReturnRoutes:
    """Plans return routes."""

    def __init__(
        self,
        config: Config,
        zones: NoFlyZones,
        fleet: Fleet,
        agents: Mapping[int, Agent],
        landing_order: LandingOrder,
    ) -> None:
        self._config = config
        self._options = vehicle_options(config)
        self._landing_order = landing_order
        self._zones = zones
        self._fleet = fleet
        self._agents = agents

    def plan(self, route: Route, t_ns: int) -> tuple[ReturnRoute | None, list[Effect]]:
        """Return the return route that follows a route, and a warning if it has a new problem.

        None if the mission does not land; over terrain also if no approach is clear. A vehicle that was not
        heard begins at the first point of its route, and lands at the origin of the local frame.
        """
        vehicle = route.vehicle
        points_m = route.points_m
        airframe = self._config.airframe_of(vehicle)
        landing = landing_of(airframe)
        if landing is None or is_hold(route):
            return None, []
        routes = self._agents[vehicle].routes
        home = self._fleet.home(vehicle)
        state = self._fleet.state(vehicle)
        home_m = (0.0, 0.0) if home is None else self._config.local_frame.to_local(*home[:2])
        east_m, north_m = points_m[0].tolist() if state is None else (state.east_m, state.north_m)
        start = AgentState(east_m, north_m, None if state is None else state.course_rad, airframe.speed_m_s)
        options = self._options[vehicle]
        grid = self._zones.obstacles.below_layers([_landing_at(home_m)])
        if route.heights_msl_m is not None:
            return self._over_terrain(route, LandingSite(home_m, APPROACH_ALT_M, grid), t_ns)
        task = grid, start, points_m, home_m, options, landing
        planned, too_soon = self._with_wait(route, task, t_ns)
        routes.return_m = np.vstack((points_m[-1:], planned.points_m))
        return self._noted(planned, vehicle, planned.problem or too_soon, t_ns)

    def _with_wait(self, route: Route, task: _Task, t_ns: int) -> tuple[ReturnRoute, str]:
        """Return the return route with its wait; past a place beside the target if it has none to wait on."""
        order = self._landing_order
        grid = self._zones.grid
        planned = plan_return_route(*task)
        waiting, too_soon = order.wait(route, planned, grid, t_ns)
        east_m, north_m = route.points_m[-1].tolist()
        places = order.places_beside(route.vehicle, (east_m, north_m), grid) if too_soon else iter(())
        for place_m in islice(places, _MAX_PLACES):
            past = plan_return_route(*task, past_m=place_m)
            if past.problem in ("", planned.problem):
                detour, problem = order.wait(route, past, grid, t_ns)
                if not problem:
                    return detour, ""
        if too_soon:  # once more: the last call reserves the landing
            return order.wait(route, planned, grid, t_ns)
        return waiting, ""

    def _over_terrain(
        self, route: Route, site: LandingSite, t_ns: int
    ) -> tuple[ReturnRoute | None, list[Effect]]:
        """Return the return route over terrain; None where no approach is clear: it does not land."""
        vehicle = route.vehicle
        routes = self._agents[vehicle].routes
        routes.return_m = None
        terrain = terrain_of(self._config, self._zones.obstacles)
        assert terrain is not None
        planned = plan_return_over_terrain(
            terrain,
            self._zones.grid,
            route,
            site,
            self._config.airframe_of(vehicle).speed_m_s,
            self._options[vehicle],
        )
        if planned is None:
            return self._noted(None, vehicle, NO_APPROACH, t_ns)
        planned, too_soon = self._landing_order.wait(route, planned, self._zones.grid, t_ns)
        if planned.wait is not None:
            planned = planned.without_arc()
        routes.return_m = np.vstack((route.points_m[-1:], planned.points_m))
        return self._noted(planned, vehicle, too_soon, t_ns)

    def _noted(
        self, planned: ReturnRoute | None, vehicle: int, problem: str, t_ns: int
    ) -> tuple[ReturnRoute | None, list[Effect]]:
        """Return a return route with a warning if it has a new problem, or the all-clear."""
        routes = self._agents[vehicle].routes
        before = routes.return_problem
        routes.return_problem = problem
        if before and not problem:
            return planned, [Notice(t_ns, NoticeCode.RETURN_ROUTE_CLEAR, vehicle)]
        if problem in ("", before):
            return planned, []
        about: dict[str, Parameter] = {"problem": problem}
        return planned, [Notice(t_ns, NoticeCode.RETURN_ROUTE_PROBLEM, vehicle, about)]

    def crossed(self, closed: MapChange, returning: Mapping[int, Point]) -> set[int]:
        """Return the vehicles whose return routes lead through a zone that was closed.

        Of a vehicle that is `returning`, only the part ahead of its position counts.
        """
        return {
            vehicle
            for vehicle, agent in self._agents.items()
            if agent.routes.return_m is not None
            and self._is_crossed(closed, agent.routes.return_m, returning.get(vehicle), _passed(agent))
        }

    def _is_crossed(self, closed: MapChange, route_m: FloatArray, place: Point | None, passed: int) -> bool:
        descent = _landing_at(route_m[-1].tolist())
        if is_crossed(closed.below_layers(descent), route_m, place, passed):
            return True
        terrain = self._config.terrain
        if terrain is None:
            return False
        band_agl_m = terrain.min_agl_m, terrain.max_agl_m
        return closed.may_cross_return(rest_of(route_m, place, passed), band_agl_m)


def _landing_at(home_m: Point) -> LowFlight:
    """Return the descent and approach to a landing, from any side."""
    return LowFlight(home_m, APPROACH_M, APPROACH_ALT_M, DESCENT_SLOPE)


def _passed(agent: Agent) -> int:
    """Return how many points of its return route a vehicle has passed, the end of its route included."""
    onboard = agent.tasking.onboard
    state = agent.perception.motion.state
    if onboard is None or state is None or not agent.tasking.is_selected:
        return 0
    flown = onboard.items[onboard.first_point : max(state.mission_seq, 0)]
    waypoints = [item.command for item in flown].count(MAV_CMD_NAV_WAYPOINT)
    return max(waypoints - len(onboard.route.points_m) + 1, 0)
