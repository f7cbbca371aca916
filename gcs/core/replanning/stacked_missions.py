"""Stacked returns and holds: missions at heights of their own, where RTL or LOITER would meet.

In RTL all vehicles fly straight to one place, each at the return height of its autopilot. Where that leads
one near another, a mission leads it home instead: a route clear of obstacles in an altitude layer of its own.
It ends as missions do: with a circle at home, or beside it where all layers there are taken, or with a
landing in the landing order.

LOITER keeps the height. A vehicle whose circle comes near that of another one gets a mission with the circle
in a free layer.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gcs.config import Config
from gcs.core.airspace.no_fly_zones import MapChange, NoFlyZones
from gcs.core.replanning.mission_inputs import mission_inputs, terrain_of
from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.replanning.return_routes import ReturnRoutes
from gcs.core.replanning.route_crossing import leads_through
from gcs.core.replanning.route_starts import begin_height_msl_m
from gcs.core.separation.minima import min_distance_m
from gcs.core.separation.order_check import OrderCheck
from gcs.core.separation.predicted_flights import PredictedFlights
from gcs.core.state import Agent
from gcs.core.tasking.mission_builder import flown_points, is_hold
from gcs.core.tasking.upload_latency import DELIVERY_S, late_s
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import APPROACH_M, Effect, Label, Route, VehicleState
from gcs.model.vehicle_ids import hold_label, home_label
from gcs.planning.forward_simulation import predict_motion
from gcs.planning.map.grid import Point
from gcs.planning.plan_result import PlanResult, choose_new
from gcs.planning.planner_inputs import AgentState
from gcs.planning.team_routes import plan_routes

_SIDES_DEG: Final = (0.0, 60.0, -60.0, 120.0, -120.0, 180.0)
"""Sides of home on which a route may end, from that of the vehicle."""
_MARGIN_M: Final = 20.0
"""Beyond the separation of two circles beside each other."""
_MAX_ROUTES: Final = 2
"""Number of places to which routes are planned for one vehicle at most."""


class StackedMissions:
    """Plans returns and holds by missions, and sends them."""

    def __init__(
        self,
        config: Config,
        zones: NoFlyZones,
        fleet: Fleet,
        agents: Mapping[int, Agent],
        tasking: UploadManager,
        layers: AltitudeLayers,
        return_routes: ReturnRoutes,
        order_check: OrderCheck,
    ) -> None:
        self._config = config
        self._zones = zones
        self._fleet = fleet
        self._agents = agents
        self._tasking = tasking
        self._layers = layers
        self._return_routes = return_routes
        self._order_check = order_check
        self._intents = order_check.intents
        self._airframes = config.airframes_of_agents
        self._frame = config.local_frame
        self._mission = mission_inputs(config, zones.obstacles)
        self._options = self._mission.options
        self._beside_m = min_distance_m(config) + _MARGIN_M

    def plan_returns(
        self, vehicles: Collection[int], modes: Mapping[int, str], t_ns: int
    ) -> dict[int, Route]:
        """Return routes home for vehicles that return at one time, as far as they are clear of all others.

        Parameters
        ----------
        vehicles : collection of int
            In the order in which they get their layers.
        modes : mapping of int to str
            Modes that are ordered now, by vehicle.
        """
        states = {state.system_id: state for state in self._intents.in_air(t_ns)}
        flights = self._order_check.predict(t_ns)
        planned: dict[int, Route] = {}
        for vehicle in vehicles:
            state = states.get(vehicle)
            home = self._fleet.home(vehicle)
            if state is None or home is None:
                continue
            ends_m = self._ends(state, self._frame.to_local(home.lat_deg, home.lon_deg))
            route = self._route(state, ends_m, home_label(vehicle), planned, modes, flights)
            if route is not None:
                planned[vehicle] = route
        return planned

    def plan_hold(self, vehicle: int, flights: PredictedFlights) -> Route | None:
        """Return a route to a circle where a vehicle holds, in a layer clear of all others; None without one.

        One that holds by a mission gets a circle beside that.
        """
        state = self._fleet.state(vehicle)
        agent = self._agents[vehicle]
        place_m = agent.separation.hold_m
        if state is None:
            return None
        ends_m: Iterable[Point] = [] if place_m is None else [place_m]
        if place_m is None and agent.routes.stacked is not None:
            east_m, north_m = agent.routes.stacked.flown_m[-1].tolist()
            ends_m = self._beside(vehicle, (east_m, north_m), state.course_rad)
        planned = self._not_flown_yet(vehicle)
        return self._route(state, ends_m, hold_label(vehicle), planned, {}, flights)

    def plan_clear_circle(
        self, vehicle: int, other: int, search: int, flights: PredictedFlights
    ) -> Route | None:
        """Return a route to a circle clear of all others, for a vehicle that circles at its target.

        That is a circle there in another layer, or one beside it. None if each of them, or the flight there,
        would come near another vehicle.

        Parameters
        ----------
        other : int
            Vehicle that comes near. Places away from it come first.
        search : int
            Number of the search. Over terrain, where routes take longer to plan, each looks at one place, and
            the next one at the next place.
        """
        onboard = self._agents[vehicle].tasking.onboard
        if onboard is None or not {vehicle, other} <= flights.states.keys():
            return None
        east_m, north_m = onboard.route.flown_m[-1].tolist()
        from_m = flights.states[other]
        side_rad = math.atan2(east_m - from_m.east_m, north_m - from_m.north_m)
        ends_m = [(east_m, north_m), *self._beside(vehicle, (east_m, north_m), side_rad)]
        if self._mission.terrain is not None:
            ends_m = [ends_m[search % len(ends_m)]]
        planned = self._not_flown_yet(vehicle)
        state = flights.states[vehicle]
        label = hold_label(vehicle)
        return self._route(state, ends_m, label, planned, {}, flights, only_clear=True)

    def _not_flown_yet(self, vehicle: int) -> dict[int, Route]:
        """Return the routes of others that are sent home, or to a layer, and still fly something else."""
        routes = {v: agent.routes.stacked for v, agent in self._agents.items() if v != vehicle}
        return {v: route for v, route in routes.items() if route is not None and not self.is_flown(v)}

    def lands(self, vehicle: int) -> bool:
        """Return True if a vehicle's missions end with a landing."""
        return self._airframes[vehicle].end == "land"

    def is_flown(self, vehicle: int) -> bool:
        """Return True if a vehicle flies the mission that returns it, or holds it in a layer."""
        agent = self._agents[vehicle]
        state = self._fleet.state(vehicle)
        onboard = agent.tasking.onboard
        is_stored = onboard is not None and onboard.route.is_same(agent.routes.stacked)
        is_settled = is_stored and not self._tasking.state.has_pending(vehicle)
        return is_settled and state is not None and state.mode == AUTO

    def send(self, route: Route, t_ns: int) -> list[Effect]:
        """Send a mission, at once."""
        self._agents[route.vehicle].routes.stack(route)
        return_route, warnings = self._return_routes.plan(route, t_ns)
        return [*warnings, *self._tasking.enqueue_upload(route, t_ns, return_route, at_once=True)]

    def avoid(
        self, closed: MapChange, states: Mapping[int, VehicleState], t_ns: int
    ) -> dict[int, list[Effect]]:
        """Lead vehicles round a zone that was closed, and that their missions lead through.

        Where there was no way round a zone, another one is looked for when a zone is opened.

        Returns
        -------
        dict of int to list
            Effects by vehicle; none of a vehicle for which there is no other route.
        """
        effects: dict[int, list[Effect]] = {}
        for vehicle, agent in self._agents.items():
            route = agent.routes.stacked
            if route is None or self._tasking.overrides.of(vehicle).taken_by:
                continue
            passed = flown_points(agent, route, agent.perception.motion.state)
            is_met = leads_through(closed, route, states.get(vehicle), passed)
            if not is_met and (closed.zone is not None or not agent.routes.is_blocked):
                continue
            agent.routes.is_blocked = True
            if is_hold(route):
                other = self.plan_hold(vehicle, self._order_check.predict(t_ns))
            else:
                other = self.plan_returns([vehicle], {}, t_ns).get(vehicle)
            effects[vehicle] = [] if other is None else self.send(other, t_ns)
        return effects

    def _nearest_layers(self, vehicle: int) -> list[int]:
        """Return all layers, that of a vehicle first."""
        own = self._layers.of(vehicle)
        return sorted(range(self._mission.layers), key=lambda layer: (abs(layer - own), layer))

    def _route(
        self,
        state: VehicleState,
        ends_m: Iterable[Point],
        label: Label,
        planned: Mapping[int, Route],
        modes: Mapping[int, str],
        flights: PredictedFlights,
        *,
        only_clear: bool = False,
    ) -> Route | None:
        """Return a route to one of some places in a layer that is clear; None without one.

        Rather one whose way there comes near no other vehicle; with `only_clear`, no other. None also if it
        can get no mission now.
        """
        vehicle = state.system_id
        grid = self._zones.grid
        problem = self._order_check.stacking_problem
        if self._fleet.profile(vehicle) is None or self._intents.is_climbing_out(state):
            return None
        tries = 0
        for end_m in filter(grid.is_free, ends_m):
            circle = Route(vehicle, label, np.array([end_m]), 0.0)
            layers = [
                layer
                for layer in self._nearest_layers(vehicle)
                if self._mission.terrain is not None  # the height of the circle is not known yet
                or not problem(replace(circle, layer=layer), planned, modes, flights, circles_only=True)
            ]
            if not layers:
                continue
            second: Route | None = None
            for route in self._in_layers(state, end_m, label, layers, flights.t_ns):
                if not problem(route, planned, modes, flights, is_strict=True):
                    return route
                if not only_clear and second is None and not problem(route, planned, modes, flights):
                    second = route
            if second is not None:
                return second
            tries += 1
            if tries == _MAX_ROUTES and not only_clear:
                return None
        return None

    def _in_layers(
        self, state: VehicleState, end_m: Point, label: Label, layers: Sequence[int], t_ns: int
    ) -> Iterator[Route]:
        """Yield routes to a place in each of some layers; over terrain each at heights of its own."""
        start = self._start(state, t_ns)

        def plan(layer: int = 0) -> PlanResult:
            starts = {state.system_id: replace(start, layer=layer)}
            return plan_routes(self._zones.grid, starts, {label: end_m}, {}, self._options, terrain=terrain)

        terrain = terrain_of(self._config, self._zones.obstacles)
        if terrain is not None:
            for layer in layers:
                for route in plan(layer).routes:
                    yield replace(route, layer=layer)
            return
        made = plan()
        for route in () if made.stops_short else choose_new(made).new:
            yield from (replace(route, layer=layer) for layer in layers)

    def _ends(self, state: VehicleState, home_m: Point) -> Iterator[Point]:
        """Yield where a route home may end: at home and round it, or where a landing begins."""
        vehicle = state.system_id
        side_rad = math.atan2(state.east_m - home_m[0], state.north_m - home_m[1])
        if self.lands(vehicle):
            yield from _around(home_m, APPROACH_M, side_rad)
            return
        yield home_m
        yield from self._beside(vehicle, home_m, side_rad)

    def _beside(self, vehicle: int, place_m: Point, side_rad: float) -> Iterator[Point]:
        """Yield centres of circles beside that at a place, from one side of it on."""
        yield from _around(place_m, 2.0 * self._airframes[vehicle].circle_radius_m + self._beside_m, side_rad)

    def _start(self, state: VehicleState, t_ns: int) -> AgentState:
        """Return where and how a vehicle begins a route that is planned now."""
        vehicle = state.system_id
        agent = self._mission.agents[vehicle]
        motion = self._tasking.motion(state, t_ns)
        lag_s = 0.0 if agent.options is None else agent.options.turn_lag_s
        delivery_s = DELIVERY_S + late_s(self._agents[vehicle].tasking)
        in_air = self._layers.wind_m_s(vehicle), self._airframes[vehicle].still_air_radius_m
        turns = predict_motion(self._zones.grid, motion, delivery_s + 0.5 * lag_s, lag_s, *in_air)
        east_m, north_m = turns.place_m
        return replace(
            agent,
            east_m=east_m,
            north_m=north_m,
            course_rad=turns.course_rad,
            motion=predict_motion(self._zones.grid, motion, delivery_s, lag_s, *in_air),
            height_msl_m=begin_height_msl_m(state, delivery_s),
        )


def _around(place_m: Point, away_m: float, side_rad: float) -> Iterator[Point]:
    """Yield places at a distance from one, from one side of it on."""
    for turn_deg in _SIDES_DEG:
        angle = side_rad + math.radians(turn_deg)
        yield place_m[0] + away_m * math.sin(angle), place_m[1] + away_m * math.cos(angle)
