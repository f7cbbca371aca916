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
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from gcs.config import Config
from gcs.core.airspace.no_fly_zones import MapChange, NoFlyZones
from gcs.core.replanning import reasons
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.kept_routes import KeptRoutes
from gcs.core.replanning.reasons import Reason
from gcs.core.replanning.replanning_state import ReplanningState
from gcs.core.replanning.route_crossing import leads_through
from gcs.core.replanning.route_starts import RouteStarts
from gcs.core.replanning.triggers import Triggers
from gcs.core.state import Agent, flown_routes
from gcs.core.tasking.mission_builder import flown_points
from gcs.model import NS_PER_S, Label, NoticeCode, Plan, Route, VehicleState
from gcs.planning.plan_notes import PlanNote, changes
from gcs.planning.plan_result import Choice, PlanResult, choose_new
from gcs.planning.planner import plan_mission

_FIRST_PLAN_WAIT_S = 5.0
_LAYER_PERIOD_NS = 15 * NS_PER_S
"""Time between two searches for another layer for one vehicle."""
_MAX_LAYER_TRIES = 3
"""Number of vehicles for which one is looked for at a check."""
_LAYER_GAIN_S = 20.0
"""Time by which a route in another layer must meet another vehicle later."""


class Replanner:
    """Plans when a trigger asks for it, and changes the routes of all vehicles."""

    def __init__(
        self, config: Config, zones: NoFlyZones, agents: Mapping[int, Agent], state: ReplanningState
    ) -> None:
        self._agents = agents
        self._state = state
        self._planning = config.planning
        self.starts = RouteStarts(config, zones, agents, state)
        self._mission = self.starts.mission
        self.plan_targets = self.starts.plan_targets
        self.layers = self.starts.layers
        self._period_ns = int(config.planning.period_s * NS_PER_S)
        self._triggers = Triggers(config, self.plan_targets, self.layers, zones, agents, state)
        self._kept = KeptRoutes(self._mission, self.layers, self._triggers, agents)

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
            routes.layer_t_ns = 0  # what was flown before may lead through the zone
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
        """Plan if there is a trigger; `take_notes` returns what else the operator should know.

        With `urgent_only` other triggers wait for the next check.
        """
        state = self._state
        state.other_vehicles = inputs.other_vehicles
        if state.next_check_t_ns is None:
            return self._first_plan(inputs)
        regular = self._is_regular(inputs.t_ns)
        while state.next_check_t_ns <= inputs.t_ns:  # checks that no scan came for are not made up for
            state.next_check_t_ns += self._period_ns
        changes = self._triggers.changes(inputs)
        improvements = self._triggers.improvements(inputs, is_regular=regular)
        why = [*changes, *improvements]
        if not why and regular:
            return self._lead_apart(inputs)
        if not why or (urgent_only and not any(reason.cause in reasons.URGENT for reason in why)):
            return None
        plan = self._plan(inputs, why)
        if regular and (apart := self._lead_apart(inputs)) is not None:
            return _joined(plan, apart)
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

    def renew_flown(self, vehicle: int, planned_t_ns: int, inputs: PlanningInputs) -> Plan | None:
        """Plan the route of a vehicle whose upload waited again from where it is now, to the same target.

        Return None if there is no such route. One that was only to lead a vehicle apart from another one is
        dropped where it would now lead below the flight band: the vehicle flies on by its onboard mission.

        Parameters
        ----------
        planned_t_ns : int
            Time of the plan that waited.
        """
        routes = self._agents[vehicle].routes
        if routes.flown is None:
            return None
        made = self._made_again({vehicle: routes.flown.target}, inputs)
        if vehicle not in made.paths_m:
            return None
        (route,) = (one for one in made.routes if one.vehicle == vehicle)
        onboard = self._flown_on(vehicle, inputs)
        was_led_apart = routes.layer_t_ns == planned_t_ns
        if onboard is not None and was_led_apart and self._kept.is_low(route):
            routes.flown = onboard
            routes.latest = onboard
            why = reasons.of_agent(
                "upload waited", vehicle, "keeps its mission: a new one would now be too low"
            )
            return self._flown_plan(inputs.t_ns, inputs.picture_t_ns, why)
        self._note_made(made, inputs.t_ns)
        why = reasons.of_agent("upload waited", vehicle, "gets its mission later than planned")
        return self._fly_instead(route, why, inputs)

    def _flown_on(self, vehicle: int, inputs: PlanningInputs) -> Route | None:
        """Return the route of the onboard mission that a vehicle flies in AUTO, if it may fly on by it."""
        agent = self._agents[vehicle]
        flown = agent.routes.flown
        onboard = agent.tasking.onboard
        is_led = bool(inputs.motion(vehicle).ahead.points_m) and agent.separation.avoidance is None
        if onboard is None or flown is None or not (is_led and agent.tasking.is_selected):
            return None
        is_clear = not agent.routes.is_blocked and not self._triggers.is_endangered(vehicle, inputs)
        return onboard.route if is_clear and onboard.route.target == flown.target else None

    def _fly_instead(self, route: Route, why: Reason, inputs: PlanningInputs) -> Plan:
        """Make a route, planned on the present map, the flown one of its vehicle; return the plan of all."""
        routes = self._agents[route.vehicle].routes
        routes.flown = route
        routes.is_blocked = False
        return self._flown_plan(inputs.t_ns, inputs.picture_t_ns, why, (route.vehicle,))

    def _lead_apart(self, inputs: PlanningInputs) -> Plan | None:
        """Lead a vehicle that soon meets another one over terrain to its target at other heights, if it can.

        Those that meet others first are tried first, each once in `_LAYER_PERIOD_NS`.
        """
        if self._mission.terrain is None or self._planning.retask != "auto":
            return None
        tries = 0
        for vehicle, after_s in self._triggers.meeting(inputs):
            routes = self._agents[vehicle].routes
            is_new = routes.made_t_ns == inputs.t_ns
            if routes.flown is None or is_new or inputs.t_ns - routes.layer_t_ns < _LAYER_PERIOD_NS:
                continue
            routes.layer_t_ns = inputs.t_ns
            made = self._made_again({vehicle: routes.flown.target}, inputs)
            first_s = min((one.after_s for one in made.conflicts), default=math.inf)
            is_whole = vehicle in made.paths_m and vehicle not in made.stops_short
            new = [route for route in made.routes if route.vehicle == vehicle and is_whole]
            if new and first_s > after_s + _LAYER_GAIN_S and not self._kept.is_low(new[0]):
                self._note_made(made, inputs.t_ns)
                return self._fly_instead(new[0], reasons.occupied(vehicle), inputs)
            tries += 1
            if tries == _MAX_LAYER_TRIES:
                break
        return None

    def _renewed(self, assignment: Mapping[int, Label], inputs: PlanningInputs) -> dict[int, Route]:
        """Return routes from the current positions of vehicles to the same targets."""
        made = self._note_made(self._made_again(assignment, inputs), inputs.t_ns)
        return {route.vehicle: route for route in made.routes if route.vehicle in made.paths_m}

    def _made_again(self, assignment: Mapping[int, Label], inputs: PlanningInputs) -> PlanResult:
        """Plan from the current positions of vehicles to the same targets."""
        self._state.other_vehicles = inputs.other_vehicles
        there = {
            vehicle: label
            for vehicle, label in assignment.items()
            if vehicle in inputs.agents and label in inputs.targets
        }
        mission = self.starts.mission_inputs(there, set(there.values()), there, inputs, fixed=True)

        def choose(result: PlanResult) -> Choice:
            new = [route for route in choose_new(result).new if route.target == there[route.vehicle]]
            routed = {route.vehicle for route in new}
            kept = [r for v, r in self._triggers.newest.items() if v in inputs.agents and v not in routed]
            kept = self.layers.that_may_meet(new, kept, inputs)
            return Choice(new, kept, self.layers.flights(kept, new, inputs))

        return plan_mission(mission, choose)

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
        mission = self.starts.mission_inputs(free, open_targets, pursued, replace(inputs, at_targets=there))
        self._triggers.note_planned(inputs.agents, inputs.targets)
        occupied = self._triggers.in_occupied_layers(inputs)
        settled = self._kept.settled(mission, occupied, inputs)
        starts = {
            vehicle: replace(mission.agents[vehicle], settled=route.target)
            for vehicle, route in settled.items()
        }
        mission = replace(mission, agents={**mission.agents, **starts})
        choose = partial(self._kept.choose, mission.agents, arriving, settled, occupied, inputs)
        result = self._note_made(plan_mission(mission, choose), inputs.t_ns)
        pairs = [conflict.vehicles for conflict in result.conflicts]  # distances would be news at every check
        noted = {note.parameters["vehicles"] for note in state.noted if note.code is NoticeCode.NO_LAYER_LEFT}
        if left := noted - set(pairs):  # the plan compares new routes with others only
            pairs += [
                one.vehicles for one in self.layers.conflicts(result.routes, inputs) if one.vehicles in left
            ]
        near = [PlanNote(NoticeCode.NO_LAYER_LEFT, None, {"vehicles": pair}) for pair in pairs]
        kept = [
            note
            for note in state.noted
            if (note.vehicle in result.settled or note.vehicle in keeping) and "target" in note.parameters
        ]
        self._note((*result.notes, *kept, *near))
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

    def _note(self, notes: tuple[PlanNote, ...]) -> None:
        """Replace the notes of the last plan."""
        self._state.new_notes += changes(self._state.noted, notes)
        self._state.noted = notes

    def end_notes(self) -> None:
        """End what holds of the last plan: there is no other for the time being."""
        self._note(())

    def take_notes(self) -> tuple[PlanNote, ...]:
        """Return, once, the notes that began or ended since the last call."""
        notes = self._state.new_notes
        self._state.new_notes = ()
        return notes

    def _decide(self, kept: Iterable[Route], inputs: PlanningInputs) -> None:
        """Make the routes of a plan the flown ones, or propose those that differ."""
        planned = {route.vehicle: route for route in kept}
        for vehicle, agent in self._agents.items():
            routes = agent.routes
            route = planned.get(vehicle)
            if self._planning.retask == "auto":
                routes.flown = route
                routes.is_blocked = routes.is_blocked and routes.stacked is not None
                continue
            routes.proposed = None if route is None or route.is_same(routes.flown) else route
            if routes.declined is not None and not routes.declined.is_same(routes.proposed):
                routes.declined = None
            if routes.flown is None or routes.flown.target not in inputs.targets:
                routes.drop_flown()


def _joined(plan: Plan, later: Plan) -> Plan:
    """Return two plans of one time as one; `later` has the routes of both."""
    return replace(
        later,
        reason="; ".join((plan.reason, later.reason)),
        changed=tuple(dict.fromkeys((*plan.changed, *later.changed))),
        causes=tuple(dict.fromkeys((*plan.causes, *later.causes))),
    )
