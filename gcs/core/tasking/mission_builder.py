"""Missions from routes: waypoints with altitudes and acceptance radii (items: `gcs.mavlink.autopilots`)."""

from __future__ import annotations

import numpy as np

from gcs.config import Config
from gcs.config.airframe import AgentAirframe
from gcs.config.schema import MissionTable
from gcs.core.state import Agent
from gcs.model import NS_PER_S, FloatArray, HeightReference, Mission, Route, VehicleState, Waypoint
from gcs.model.vehicle_ids import hold_label
from gcs.planning.forward_simulation import LoiterCircle, RemainingMission
from gcs.planning.manoeuvres.climb import Climb
from gcs.planning.manoeuvres.landing import ReturnRoute
from gcs.planning.map.grid import Point
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.route_progress import CORRIDOR_M, next_point

MAX_RADIUS_M = 255.0
"""Maximum radius in a mission item."""


class MissionBuilder:
    """Makes missions from routes."""

    def __init__(self, config: Config) -> None:
        self._table = config.mission
        self._frame = config.local_frame
        self._airframes = config.airframes_of_agents
        self._default = config.default_airframe

    def of(
        self,
        route: Route,
        mission_id: int,
        state: VehicleState | None,
        return_route: ReturnRoute | None = None,
        climb: Climb | None = None,
    ) -> Mission:
        """Return the mission of a route for a vehicle in this state.

        It begins with the climb and ends with the return route, if given.
        """
        table = self._table
        airframe = self._airframes.get(route.vehicle, self._default)
        altitude_rel_m = table.altitude_rel_m + route.layer * table.layer_step_m
        radii_m = _acceptance_m(airframe, route, state, climb).tolist()
        is_over_terrain = route.heights_msl_m is not None
        reference: HeightReference = "msl" if is_over_terrain else "home"
        heights_m = (
            [altitude_rel_m] * len(route.flown_m)
            if route.heights_msl_m is None
            else route.heights_msl_m.tolist()
        )
        flown = [
            Waypoint(*self._frame.to_geodetic(east_m, north_m), height_m, radius_m, reference)
            for (east_m, north_m), height_m, radius_m in zip(
                route.flown_m.tolist(), heights_m, [*radii_m, radii_m[-1]][: len(heights_m)], strict=True
            )
        ]
        waypoints = tuple(flown[: len(route.points_m)])
        wait = None if route.wait_m is None else flown[-1]
        return_waypoints = (
            ()
            if return_route is None
            else self._return_waypoints(airframe, route, return_route, altitude_rel_m)
        )
        takeoff = None
        if climb is not None:
            end_deg = self._frame.to_geodetic(*climb.latest_end_m)
            takeoff = Waypoint(*end_deg, climb.altitude_rel_m, airframe.accept_radius_m)
        landing_wait = None if return_route is None else return_route.wait
        loiter_radius_m = airframe.loiter_radius_m
        if landing_wait is not None and loiter_radius_m > 0.0:
            # PX4 counts the time on this circle only
            loiter_radius_m = max(loiter_radius_m, airframe.turn_radius_m)
        return Mission(
            mission_id,
            route.vehicle,
            waypoints,
            loiter_radius_m,
            "loiter" if is_hold(route) or (is_over_terrain and return_route is None) else airframe.end,
            wait,
            takeoff,
            return_waypoints,
            landing_wait,
        )

    def empty(self, vehicle: int) -> Mission:
        """Return a mission that is never sent, for a task that only clears."""
        frame = self._frame
        origin = Waypoint(frame.lat_deg, frame.lon_deg, self._table.altitude_rel_m, MAX_RADIUS_M)
        return Mission(0, vehicle, (origin,))

    def _return_waypoints(
        self, airframe: AgentAirframe, route: Route, return_route: ReturnRoute, altitude_rel_m: float
    ) -> tuple[Waypoint, ...]:
        """Return the corners of a return route; none for a straight one, which profiles add themselves."""
        if return_route.is_straight:
            return ()
        points_m = np.concatenate((route.points_m[-1:], return_route.points_m))
        wanted = corners_of(airframe).accept_radii_m(points_m)
        radii_m = np.minimum(np.round(wanted, 0), MAX_RADIUS_M)
        heights_msl_m = return_route.heights_msl_m
        reference: HeightReference = "home" if heights_msl_m is None else "msl"
        heights_m = np.full(len(radii_m), altitude_rel_m) if heights_msl_m is None else heights_msl_m
        return tuple(
            Waypoint(*self._frame.to_geodetic(east_m, north_m), height_m, radius_m, reference)
            for (east_m, north_m), height_m, radius_m in zip(
                return_route.points_m[:-1].tolist(),
                heights_m[:-1].tolist(),
                radii_m[:-1].tolist(),
                strict=True,
            )
        )


def is_hold(route: Route) -> bool:
    """Return True if the route of a vehicle that holds ends with a circle, whatever its missions end with."""
    return route.target == hold_label(route.vehicle)


def _acceptance_m(
    airframe: AgentAirframe, route: Route, state: VehicleState | None, climb: Climb | None
) -> FloatArray:
    """Return the acceptance radius of each waypoint: wide enough to turn to the next one in time."""
    start = route.points_m[:1] if state is None else [(state.east_m, state.north_m)]
    if climb is not None:
        start = [climb.latest_end_m]
    wanted = corners_of(airframe).accept_radii_m(np.concatenate((start, route.points_m)))
    return np.minimum(np.round(wanted, 0), MAX_RADIUS_M)


def route_heights_msl_m(route: Route, home_msl_m: float, table: MissionTable) -> FloatArray:
    """Return the heights above mean sea level of a route's `flown_m` (k,): its own, or that of its layer."""
    if route.heights_msl_m is not None:
        return route.heights_msl_m
    height_m = home_msl_m + table.altitude_rel_m + route.layer * table.layer_step_m
    return np.full(len(route.flown_m), height_m)


def mission_ahead(route: Route, start_m: Point, airframe: AgentAirframe) -> RemainingMission:
    """Return what a vehicle flies on a route from a place on, with the loiter circle at its end."""
    radii_m = corners_of(airframe).accept_radii_m(np.vstack((start_m, route.points_m)))
    circle = None
    if airframe.end == "loiter":
        east_m, north_m = route.flown_m[-1].tolist()
        circle = LoiterCircle((east_m, north_m), airframe.circle_radius_m)
    points_m = tuple((east_m, north_m) for east_m, north_m in route.points_m.tolist())
    return RemainingMission(points_m, tuple(radii_m.tolist()), circle=circle)


def corners_of(airframe: AgentAirframe) -> TurnAnticipation:
    """Return the turn anticipation of vehicles."""
    return TurnAnticipation(
        airframe.turn_radius_m, airframe.turn_lag_m, airframe.accept_radius_m, airframe.wind_m_s
    )


def flown_points(agent: Agent, route: Route, state: VehicleState | None) -> int:
    """Return how many points of a route its vehicle has passed.

    The mission item that the vehicle flies to tells it: it never falls back, on no circle and beside no leg.
    Before the vehicle has the route on board, its position must do.
    """
    onboard = agent.tasking.onboard
    if (
        state is None
        or state.mission_seq < 0
        or onboard is None
        or not agent.tasking.is_selected
        or not route.is_same(onboard.route)
    ):
        return points_passed(route, agent.routes.made_t_ns, state)
    return min(max(state.mission_seq - onboard.first_point, 0), len(route.points_m))


def points_passed(route: Route, planned_t_ns: int, state: VehicleState | None) -> int:
    """Return how many points of a route its vehicle has passed since it was planned."""
    if state is None:
        return 0
    max_m = state.ground_speed_m_s * (state.t_ns - planned_t_ns) / NS_PER_S
    return next_point(route.points_m, (state.east_m, state.north_m), CORRIDOR_M, max_m)
