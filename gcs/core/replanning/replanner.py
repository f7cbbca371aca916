"""Replanning: when a plan is made, and which routes it changes.

A check compares the picture with the routes that vehicles have (`gcs.core.replanning.triggers`). Only a
trigger makes the planner run, and only vehicles whose route changed get a new mission. Checks come every
period (the paper, Algorithm 1 at 0.2 Hz), or at every scan, so that events are answered at once. What a plan
could not achieve is tried again once a period.

Where an operator approves each plan, new routes are `proposed` until then.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from gcs.config import Config
from gcs.core.airspace.no_fly_zones import MapChange, NoFlyZones
from gcs.core.airspace.obstacle_map import LowFlight
from gcs.core.replanning import reasons
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.mission_inputs import mission_inputs, terrain_of
from gcs.core.replanning.plan_targets import PlanTargets, vehicle_options
from gcs.core.replanning.planned_flights import AltitudeLayers, begin_m
from gcs.core.replanning.reasons import Reason
from gcs.core.replanning.records import ReplanningState
from gcs.core.replanning.triggers import Triggers
from gcs.core.state import Agent, flown_routes
from gcs.core.tasking.mission_builder import flown_points
from gcs.core.tasking.upload_latency import DELIVERY_S
from gcs.mavlink.mission.upload_limits import UploadLimits
from gcs.model import NS_PER_S, FloatArray, Label, NoticeCode, Plan, Route, VehicleState
from gcs.planning.forward_simulation import Motion, predict_motion
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight
from gcs.planning.plan_notes import PlanNote
from gcs.planning.plan_result import Choice, PlanResult, choose_new
from gcs.planning.planner import plan_mission
from gcs.planning.planner_inputs import AgentState, MissionInputs
from gcs.planning.route_joining import total_turn_rad

_FIRST_PLAN_WAIT_S = 5.0
_SAME_PLACE_M = 1.0
_NEAR_END_M = 100.0
_MAX_TURN_NEAR_END_RAD = math.radians(270.0)
"""Turns beyond which a vehicle near its target, or near the end of its route, keeps the route it flies."""
_LOW_M = 10.0
"""Height below the lowest layer from which a vehicle counts as below the layers."""
_CLIMB_SLOPE = 0.1
"""Slope at which a vehicle below the layers climbs at least."""
_LOOP_RADII = 4.0
"""Extent of a loop's waypoints, in turn radii."""


class Replanner:
    """Plans when a trigger asks for it, and changes the routes of all vehicles."""

    def __init__(
        self, config: Config, zones: NoFlyZones, agents: Mapping[int, Agent], state: ReplanningState
    ) -> None:
        self._zones = zones
        self._agents = agents
        self._state = state
        self._config = config
        self._planning = config.planning
        self._mission = mission_inputs(config, zones.obstacles)
        self.plan_targets = PlanTargets(config)
        self.layers = AltitudeLayers(config, self._mission, agents, state)
        self._turn_lags_s = {v: one.turn_lag_s for v, one in vehicle_options(config).items()}
        self._lag_s = min(self._turn_lags_s.values())
        self._ahead_s = DELIVERY_S + 0.5 * self._lag_s
        self._period_ns = int(config.planning.period_s * NS_PER_S)
        self._triggers = Triggers(config, self.plan_targets, self.layers, zones, agents, state)

    def taken_up(self, t_ns: int, picture_t_ns: int) -> list[Plan]:
        """Return the plan that goes on after a restart; empty if none has been made.

        The planner does not run: a restart by itself changes no route.
        """
        if self._state.next_check_t_ns is None:
            return []
        return [self._flown_plan(t_ns, picture_t_ns, Reason("taken up again", "taken up again"))]

    def _flown_plan(self, t_ns: int, picture_t_ns: int, why: Reason, changed: tuple[int, ...] = ()) -> Plan:
        """Return the plan of the routes that are flown."""
        routes = flown_routes(self._agents)
        targets = self._state.planned_targets
        planned = [vehicle for vehicle, agent in self._agents.items() if agent.routes.is_planned]
        assigned = {route.target for route in routes.values()}
        return Plan(
            t_ns=t_ns,
            picture_t_ns=picture_t_ns,
            routes=tuple(routes.values()),
            unassigned_vehicles=tuple(vehicle for vehicle in planned if vehicle not in routes),
            unassigned_targets=tuple(label for label in targets if label not in assigned),
            reason=why.text,
            changed=changed,
            causes=(why.cause,),
        )

    @property
    def has_planned(self) -> bool:
        """True after the first plan."""
        return self._state.next_check_t_ns is not None

    def hurry(self, t_ns: int) -> None:
        """Check at once; before the first plan there is nothing to change."""
        if self._state.next_check_t_ns is not None:
            self._state.next_check_t_ns = t_ns

    def note_unfit(self, vehicle: int, cause: str, t_ns: int) -> None:
        """Check at once whether another vehicle can take the target of one that has become unfit."""
        if self._agents[vehicle].routes.newest is not None:
            self._state.news.append(reasons.of_agent("agent unfit", vehicle, f"is unfit: {cause}"))
            self.hurry(t_ns)

    def order_plan(self, t_ns: int, text: str) -> None:
        """Check at once, by an operator's order; before the first plan there is nothing to change."""
        if self._state.next_check_t_ns is not None:
            self._state.news.append(Reason("operator order", text))
            self.hurry(t_ns)

    def change_map(
        self,
        t_ns: int,
        change: MapChange,
        states: Mapping[int, VehicleState],
        news: str,
        without_return: Collection[int] = (),
    ) -> list[int]:
        """Check at once on a changed map.

        Parameters
        ----------
        change
            What is newly blocked; routes through it are given up at the next check.
        states
            States of the vehicles.
        news
            Which no-fly zone was closed or opened.
        without_return
            Vehicles whose return routes lead through the zone.

        Returns
        -------
        list of int
            Vehicles that will fly through the zone unless they get another route.
        """
        for vehicle, agent in self._agents.items():
            routes = agent.routes
            state = agent.perception.motion.state
            flown = routes.flown
            proposed = routes.proposed
            heard = states.get(vehicle)
            if flown is not None:
                passed = flown_points(agent, flown, state)
                is_blocked = vehicle in without_return or leads_through(change, flown, heard, passed)
                routes.is_blocked = routes.is_blocked or is_blocked
            if proposed is not None:
                passed = flown_points(agent, proposed, state)
                if leads_through(change, proposed, heard, passed):
                    routes.proposed = None
        self._state.news.append(Reason("map changed", news))
        self.hurry(t_ns)
        return [vehicle for vehicle, agent in sorted(self._agents.items()) if agent.routes.is_blocked]

    def is_due(self, t_ns: int) -> bool:
        """Return True if it is time for a check; with `planning.when = "events"` that is every scan."""
        return self._planning.when == "events" or self._is_regular(t_ns)

    def _is_regular(self, t_ns: int) -> bool:
        due_t_ns = self._state.next_check_t_ns
        return due_t_ns is None or t_ns >= due_t_ns

    def check(self, inputs: PlanningInputs, *, urgent_only: bool = False) -> Plan | None:
        """Plan if there is a trigger; `ReplanningState.new_notes` has what else the operator should know.

        With `urgent_only` other triggers wait for the next check.
        """
        state = self._state
        state.new_notes = ()
        state.other_vehicles = inputs.other_vehicles
        if state.next_check_t_ns is None:
            return self._first_plan(inputs)
        regular = self._is_regular(inputs.t_ns)
        while state.next_check_t_ns <= inputs.t_ns:  # checks that no scan came for are not made up for
            state.next_check_t_ns += self._period_ns
        changes = self._triggers.changes(inputs)
        improvements = self._triggers.improvements(inputs, is_regular=regular)
        why = [*changes, *improvements]
        if not why or (urgent_only and not any(reason.cause in reasons.URGENT for reason in why)):
            return None
        plan = self._plan(inputs, why)
        # A plan that improves nothing is no news: a target over an obstacle "moves" at every check, and an
        # agent with no path to any target wants a route at every check.
        return plan if changes or plan.changed else None

    def plan_anew(self, inputs: PlanningInputs, why: str) -> Plan:
        """Plan without a trigger: an operator confirmed a plan that cannot be flown as it was shown."""
        self._state.other_vehicles = inputs.other_vehicles
        return self._plan(inputs, [Reason("approved plan changed", why)])

    def withdraw_arriving(self, inputs: PlanningInputs) -> None:
        """Drop the proposed routes of vehicles that are about to reach their targets on the flown ones."""
        for agent in self._agents.values():
            flown = agent.routes.flown
            if flown is not None and self._triggers.is_arriving(flown, inputs):
                agent.routes.proposed = None

    def renew(self, assignment: Mapping[int, Label], inputs: PlanningInputs) -> dict[int, Route]:
        """Plan proposed routes again from the current positions of their vehicles, to the same targets.

        A vehicle or target that is not there now gets no route, nor does a vehicle without a path.
        """
        routes = self._renewed(assignment, inputs)
        for vehicle, route in routes.items():
            self._agents[vehicle].routes.proposed = route
        return routes

    def renew_flown(self, vehicle: int, inputs: PlanningInputs) -> Plan | None:
        """Plan the route of a vehicle whose upload waited again from where it is now, to the same target.

        Return None if there is no such route.
        """
        routes = self._agents[vehicle].routes
        renewed = {} if routes.flown is None else self._renewed({vehicle: routes.flown.target}, inputs)
        if vehicle not in renewed:
            return None
        routes.flown = renewed[vehicle]
        routes.is_blocked = False
        why = reasons.of_agent("upload waited", vehicle, "gets its mission later than planned")
        return self._flown_plan(inputs.t_ns, inputs.picture_t_ns, why, (vehicle,))

    def _renewed(self, assignment: Mapping[int, Label], inputs: PlanningInputs) -> dict[int, Route]:
        """Return routes from the current positions of vehicles to the same targets."""
        self._state.other_vehicles = inputs.other_vehicles
        there = {
            vehicle: label
            for vehicle, label in assignment.items()
            if vehicle in inputs.agents and label in inputs.targets
        }
        mission = self._mission_inputs(there, set(there.values()), there, inputs, fixed=True)

        def choose(result: PlanResult) -> Choice:
            new = [route for route in choose_new(result).new if route.target == there[route.vehicle]]
            routed = {route.vehicle for route in new}
            kept = [r for v, r in self._triggers.newest.items() if v in inputs.agents and v not in routed]
            return Choice(new, kept, self.layers.flights(kept, new, inputs))

        made = self._note_made(plan_mission(mission, choose), inputs.t_ns)
        return {route.vehicle: route for route in made.routes if route.vehicle in made.paths_m}

    def _note_made(self, made: PlanResult, t_ns: int) -> PlanResult:
        """Note the routes of a plan, and which are new."""
        for route in made.routes:
            routes = self._agents[route.vehicle].routes
            routes.latest = route
            if route.vehicle in made.paths_m:
                routes.made_t_ns = t_ns
                routes.is_short = route.vehicle in made.stops_short
        return made

    def separation_m(self, inputs: PlanningInputs) -> dict[int, float]:
        """Return the minimum distance of each vehicle to others of its layer; infinite without others."""
        routes = [route for v, route in self._triggers.newest.items() if v in inputs.agents]
        proposed = {v for v, agent in self._agents.items() if agent.routes.proposed is not None}
        return self.layers.separation_m(routes, proposed, inputs)

    def _first_plan(self, inputs: PlanningInputs) -> Plan | None:
        """Plan when all expected agents and targets are there, or after a short wait without the rest."""
        state = self._state
        if state.started_t_ns is None:
            state.started_t_ns = inputs.t_ns
        agents = len(self._mission.agents)
        targets = len(self._mission.targets)
        is_complete = len(inputs.agents) >= agents and len(inputs.targets) >= targets
        waited = inputs.t_ns - state.started_t_ns >= _FIRST_PLAN_WAIT_S * NS_PER_S
        if not (is_complete or (waited and inputs.agents and inputs.targets)):
            return None
        state.next_check_t_ns = inputs.t_ns + self._period_ns
        return self._plan(inputs, [Reason("first plan", "first plan")])

    def _plan(self, inputs: PlanningInputs, why: Sequence[Reason]) -> Plan:
        state = self._state
        routes = flown_routes(self._agents).values()
        arriving = [route for route in routes if self._triggers.is_arriving(route, inputs)]
        keeping = {route.vehicle for route in arriving}
        there = Counter(inputs.at_targets) + Counter(route.target for route in arriving)
        kept_targets = {r.target for r in arriving if there[r.target] >= self.plan_targets.needed(r.target)}
        free = [vehicle for vehicle in inputs.agents if vehicle not in keeping]
        open_targets = [label for label in inputs.targets if label not in kept_targets]
        pursued = {v: route.target for v, route in self._triggers.newest.items() if v not in keeping}
        mission = self._mission_inputs(free, open_targets, pursued, replace(inputs, at_targets=there))
        self._triggers.note_planned(inputs.agents, inputs.targets)
        occupied = self._triggers.in_occupied_layers(inputs)
        settled = self._settled(mission, occupied, inputs)
        starts = {
            vehicle: replace(mission.agents[vehicle], settled=route.target)
            for vehicle, route in settled.items()
        }
        mission = replace(mission, agents={**mission.agents, **starts})
        choose = partial(self._choose, mission.agents, arriving, settled, occupied, inputs)
        result = self._note_made(plan_mission(mission, choose), inputs.t_ns)
        pairs = [conflict.vehicles for conflict in result.conflicts]  # distances would be news at every check
        near = [PlanNote(NoticeCode.NO_LAYER_LEFT, None, {"vehicles": pair}) for pair in pairs]
        kept = [
            note for note in state.noted if note.vehicle in result.settled and "target" in note.parameters
        ]
        notes = (*result.notes, *kept, *near)
        state.new_notes = tuple(note for note in notes if note not in state.noted)
        state.noted = notes
        self._decide(result.routes, inputs)
        return Plan(
            t_ns=inputs.t_ns,
            picture_t_ns=inputs.picture_t_ns,
            routes=result.routes,
            unassigned_vehicles=result.unassigned_vehicles,
            unassigned_targets=result.unassigned_targets,
            reason="; ".join(reason.text for reason in why),
            changed=tuple(result.paths_m),
            causes=tuple(dict.fromkeys(reason.cause for reason in why)),
        )

    def _choose(
        self,
        starts: Mapping[int, AgentState],
        arriving: Sequence[Route],
        settled: Mapping[int, Route],
        occupied: Container[int],
        inputs: PlanningInputs,
        result: PlanResult,
    ) -> Choice:
        """Choose between new routes and those that vehicles have."""
        kept = [*arriving, *(settled[vehicle] for vehicle in sorted(result.settled))]
        kept += self._without_end(result, inputs)
        new: list[Route] = []
        for route, changed in zip(result.routes, choose_new(result).new, strict=True):
            current = self._agents[route.vehicle].routes
            is_flyable = not current.is_blocked and route.vehicle not in occupied
            turns_back = self._turns_back(changed, starts[route.vehicle], inputs)
            # A route that waits for approval stays as long as it is good.
            good = [
                one
                for one in (current.proposed, current.flown if is_flyable else None)
                if one is not None
                and self._is_still_good(one, route, inputs, route.vehicle in result.stops_short, turns_back)
            ]
            kept += good[:1]
            new += [] if good else [changed]
        return Choice(new, kept, self.layers.flights(kept, new, inputs))

    def _settled(
        self, mission: MissionInputs, occupied: Container[int], inputs: PlanningInputs
    ) -> dict[int, Route]:
        """Return the routes that vehicles keep if they keep their targets, whatever new ones would be.

        They are those that `_is_still_good` accepts for any other route.
        """
        triggers = self._triggers
        found: dict[int, Route] = {}
        for vehicle in mission.agents:
            routes = self._agents[vehicle].routes
            is_flyable = not routes.is_blocked and vehicle not in occupied
            route = routes.flown if routes.proposed is None and is_flyable else routes.proposed
            if (
                route is not None
                and route.target in mission.targets
                and self._is_near_enough(vehicle, route, inputs)
                and not triggers.has_passed_target(vehicle, inputs)
                and not triggers.is_endangered(vehicle, inputs)
            ):
                found[vehicle] = route
        return found

    def _is_near_enough(self, vehicle: int, route: Route, inputs: PlanningInputs) -> bool:
        """Return True if a route ends near enough to its target, or is too new to be changed."""
        triggers = self._triggers
        return not triggers.is_settled(vehicle, inputs) or triggers.is_within_tolerance(
            vehicle, route, inputs
        )

    def _without_end(self, result: PlanResult, inputs: PlanningInputs) -> list[Route]:
        """Return the flown routes to targets where no new route has a clear end: they are kept."""
        flown = {vehicle: self._agents[vehicle].routes for vehicle in sorted(result.endless)}
        return [
            routes.flown
            for vehicle, routes in flown.items()
            if routes.flown is not None
            and routes.flown.target in inputs.targets
            and not routes.is_blocked
            and not self._triggers.is_endangered(vehicle, inputs)
        ]

    def _mission_inputs(
        self,
        vehicles: Iterable[int],
        labels: Iterable[Label],
        flown: Mapping[int, Label],
        inputs: PlanningInputs,
        *,
        fixed: bool = False,
    ) -> MissionInputs:
        """Return the planner's inputs for some agents and targets; `fixed`: agents keep those in `flown`."""
        agents = {vehicle: self._start(vehicle, inputs) for vehicle in vehicles}
        targets = {label: inputs.targets[label] for label in labels}
        counts = Counter(flown.values())
        demands = {
            label: self.plan_targets.demand(
                label, track, inputs.at_targets.get(label, 0), inputs.priorities.get(label)
            )
            for label, track in targets.items()
        }
        pinned = flown if fixed else {vehicle: self._agents[vehicle].orders.pinned for vehicle in agents}
        agents = {vehicle: replace(agent, pinned=pinned.get(vehicle)) for vehicle, agent in agents.items()}
        if fixed:
            demands = {label: replace(one, agents=counts[label]) for label, one in demands.items()}
        ahead_s = (inputs.t_ns - inputs.picture_t_ns) / NS_PER_S + self._ahead_s  # begin of the routes
        return replace(
            self._mission,
            grid=self._zones.obstacles.below_layers(self._low_flights(agents, inputs)),
            agents=agents,
            targets={label: self.plan_targets.position(track, ahead_s) for label, track in targets.items()},
            preferred_layers={vehicle: self.layers.of(vehicle) for vehicle in agents},
            begins_m={vehicle: begin_m(vehicle, inputs) for vehicle in agents},
            flown_to=flown,
            demands=demands,
            terrain=terrain_of(self._config, self._zones.obstacles),
        )

    def _low_flights(self, vehicles: Iterable[int], inputs: PlanningInputs) -> Iterator[LowFlight]:
        """Yield the climbs of vehicles that are below the layers in flight."""
        layers = self._zones.obstacles.layers
        for vehicle in vehicles:
            state = self._agents[vehicle].perception.motion.state
            if state is None or vehicle in inputs.climbs or vehicle in inputs.grounded:
                continue
            height_m = state.alt_msl_m - layers.ground_msl_m
            if height_m < layers.lowest_m - _LOW_M:
                yield LowFlight((state.east_m, state.north_m), 0.0, height_m, _CLIMB_SLOPE)

    def _start(self, vehicle: int, inputs: PlanningInputs) -> AgentState:
        """Return where and how an agent begins a route that is planned now."""
        lag_s = self._turn_lags_s[vehicle]
        turns = self._expected(vehicle, inputs, 0.5 * lag_s)
        takes_up = self._expected(vehicle, inputs, 0.0)
        late_s = inputs.late_s.get(vehicle, 0.0) + 0.5 * (lag_s - self._lag_s)
        if vehicle in inputs.climbs:
            late_s += inputs.climbs[vehicle].duration_s
        home_m, range_m = inputs.ranges.get(vehicle, ((0.0, 0.0), math.inf))
        east_m, north_m = turns.place_m
        return replace(
            self._mission.agents[vehicle],
            east_m=east_m,
            north_m=north_m,
            course_rad=turns.course_rad,
            start_delay_s=late_s,
            motion=takes_up,
            height_msl_m=inputs.heights_msl_m.get(vehicle, self._mission.agents[vehicle].height_msl_m),
            climbs_first=vehicle in inputs.climbing_first and vehicle not in inputs.climbs,
            is_grounded=vehicle in inputs.grounded,
            is_unfit=vehicle in inputs.unfit,
            is_doubtful=vehicle in inputs.doubtful,
            home_m=home_m,
            range_m=range_m,
        )

    def _expected(self, vehicle: int, inputs: PlanningInputs, more_s: float) -> Motion:
        """Return an agent's motion `more_s` after it got a route that is planned now, or after its climb."""
        lag_s = self._turn_lags_s[vehicle]
        if vehicle in inputs.climbs:
            return predict_motion(self._zones.grid, inputs.motion(vehicle), more_s, lag_s)
        ahead_s = self.delivery_s(vehicle, inputs) + more_s
        return predict_motion(self._zones.grid, inputs.motion(vehicle), ahead_s, lag_s)

    def delivery_s(self, vehicle: int, inputs: PlanningInputs) -> float:
        """Return the time until an agent in flight gets a route that is planned now."""
        ahead = inputs.motion(vehicle).ahead
        late_s = inputs.late_s.get(vehicle, 0.0)
        until_hold_s = max(0.0, ahead.next_s - UploadLimits().guard_s)
        return DELIVERY_S + ahead.wait_s + min(late_s, until_hold_s)

    def _decide(self, kept: Iterable[Route], inputs: PlanningInputs) -> None:
        """Make the routes of a plan the flown ones, or propose those that differ."""
        planned = {route.vehicle: route for route in kept}
        for vehicle, agent in self._agents.items():
            routes = agent.routes
            route = planned.get(vehicle)
            if self._planning.retask == "auto":
                routes.flown = route
                routes.is_blocked = False
                continue
            routes.proposed = None if route is None or route.is_same(routes.flown) else route
            if routes.declined is not None and not routes.declined.is_same(routes.proposed):
                routes.declined = None
            if routes.flown is None or routes.flown.target not in inputs.targets:
                routes.drop_flown()

    def _is_still_good(
        self, flown: Route, new: Route, inputs: PlanningInputs, short: bool, turns_back: bool
    ) -> bool:
        """Return True if a vehicle should keep its route.

        `short`: the new one ends before its target. `turns_back`: it makes a full turn near its end.
        """
        vehicle = new.vehicle
        triggers = self._triggers
        if flown.target != new.target or triggers.is_endangered(vehicle, inputs):
            return False
        if short or turns_back:
            return True
        if triggers.has_passed_target(vehicle, inputs):
            return False
        if math.dist(new.target_point_m, flown.target_point_m) < _SAME_PLACE_M:
            return True
        return self._is_near_enough(vehicle, flown, inputs)

    def _turns_back(self, new: Route, start: AgentState, inputs: PlanningInputs) -> bool:
        """Return True if a vehicle near its target, or near the end of its route, would make a full turn."""
        newest = self._agents[new.vehicle].routes.newest
        agent = inputs.agents[new.vehicle]
        if newest is None or new.vehicle in inputs.passed:
            return False
        to_target_m = _distance_m(agent.mean, inputs.targets[new.target].mean)
        if min(to_target_m, _distance_m(agent.mean, newest.target_point_m)) > _NEAR_END_M:
            return False
        options = self._mission.agents[new.vehicle].options or self._mission.options
        loop_m = _LOOP_RADII * options.turn_radius_m
        return total_turn_rad(start, new.points_m, _NEAR_END_M + loop_m) > _MAX_TURN_NEAR_END_RAD


def is_crossed(closed: Grid, route_m: FloatArray, place: Point | None, passed: int = 0) -> bool:
    """Return True if the rest of a route leads through closed cells.

    Parameters
    ----------
    route_m : ndarray, shape (k, 2)
        East and north of the route.
    place : tuple of float or None
        Position of its vehicle; None: the whole route is left.
    passed : int
        Number of points that the vehicle has passed.
    """
    points = [(east_m, north_m) for east_m, north_m in rest_of(route_m, place, passed).tolist()]
    if len(points) == 1:
        points *= 2
    return not all(line_of_sight(closed, a, b) for a, b in pairwise(points))


def leads_through(change: MapChange, route: Route, state: VehicleState | None, passed: int) -> bool:
    """Return True if the rest of a route leads through what is newly blocked."""
    place = None if state is None else (state.east_m, state.north_m)
    if is_crossed(change.layers, route.flown_m, place, passed):
        return True
    if route.heights_msl_m is None:
        return False
    path_m = np.column_stack((route.flown_m, route.heights_msl_m))
    begin = None if state is None else (state.east_m, state.north_m, state.alt_msl_m)
    return change.is_crossed(rest_of(path_m, begin, passed))


def rest_of(path_m: FloatArray, begin: Sequence[float] | None, passed: int) -> FloatArray:
    """Return a path from where its vehicle is, without the points that it has passed."""
    return path_m if begin is None else np.vstack((begin, path_m[min(passed, len(path_m) - 1) :]))


def _distance_m(a: FloatArray, b: FloatArray | Point) -> float:
    return math.hypot(float(a[0]) - float(b[0]), float(a[1]) - float(b[1]))
