"""When to plan again, and what the plan changes.

The picture is held against what the vehicles fly: an agent died or came back, a target appeared, was lost,
or is not where its route ends. Only then the planner runs, and only vehicles whose route changed get a new
mission. That happens every period (the paper, Algorithm 1 at 0.2 Hz), or at every scan, so that events are
answered at once; what could not be done is tried again every period in any case.

Where an operator confirms each plan, new routes are `proposed` until then. What is proposed, waiting or
rejected, is held against the picture like what is flown: as long as it is still good, it is not news.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

from gcs.config import Config
from gcs.core.replanning import triggers
from gcs.core.replanning.altitude_layers import AltitudeLayers
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.options import PlanTargets, is_arriving, plan_options
from gcs.core.replanning.triggers import Reason
from gcs.core.tasking.mission_builder import corners_of
from gcs.core.tasking.upload_latency import DELIVERY_S
from gcs.mavlink.mission.upload_stages import UploadTiming
from gcs.model import NS_PER_S, FloatArray, Label, Plan, Route, Track
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight
from gcs.planning.options import AgentState
from gcs.planning.planner import PlanResult, plan_routes
from gcs.planning.route_capture import (
    capture_length_m,
    has_explicit_turn,
    simulate_until_blocked,
    turn_around_s,
)
from gcs.planning.route_progress import CORRIDOR_M, next_point
from gcs.planning.vehicle_model import Motion, predict_motion

_FIRST_PLAN_WAIT_S = 5.0
_SAME_PLACE_M = 1.0
_FAR_OFF = 3.0
"""A target so many times farther from where its route ends than it may be cannot wait for the next look."""


class Replanner:
    """Keeps the routes being flown and decides when to plan anew."""

    def __init__(self, config: Config, grid: Grid) -> None:
        planning = config.planning
        self._grid = grid
        self._options = plan_options(config)
        self.plan_targets = PlanTargets(config)
        self._layers = AltitudeLayers(config)
        self._planning = planning
        self._lag_s, self._corners = config.airframe.turn_lag_s, corners_of(config.mission, config.airframe)
        self._ahead_s = DELIVERY_S + 0.5 * self._lag_s
        self._period_ns = int(planning.period_s * NS_PER_S)
        self._expected_agents = len(config.agents)
        self._expected_targets = len(config.births)
        self._started_t_ns: int | None = None
        self._next_check_t_ns: int | None = None
        self._tried: set[Label] = set()
        """Targets that moved, for which a plan was made since the last regular look."""
        self._planned_agents: frozenset[int] = frozenset()
        self._planned_targets: frozenset[Label] = frozenset()
        self._noted: frozenset[str] = frozenset()
        self.notes: list[str] = []
        """What the last look has to say that the one before did not."""
        self.routes: dict[int, Route] = {}
        """What each vehicle flies, or is being told to fly."""
        self.proposed: dict[int, Route] = {}
        """What was put to the operator, with `planning.retask = "confirm"`."""
        self.blocked: set[int] = set()
        """Vehicles whose way was closed since they got it."""
        self._news: list[Reason] = []
        self._given_t_ns: dict[int, int] = {}
        """When each vehicle's newest route was made."""
        self.short: frozenset[int] = frozenset()
        """Vehicles whose newest routes end before their targets."""
        self.unrouted: frozenset[int] = frozenset()
        """Vehicles whose proposed routes could not be planned anew the last time."""

    @property
    def grid(self) -> Grid:
        """The map that plans are made by."""
        return self._grid

    def layer(self, vehicle: int) -> int:
        """Altitude layer that a vehicle has, or gets if it can."""
        return self._layers.of(vehicle)

    @property
    def assigned(self) -> dict[int, Label]:
        """Target of each tasked vehicle."""
        return {vehicle: route.target for vehicle, route in self.routes.items()}

    @property
    def planned(self) -> Container[int]:
        """Vehicles that the last plan was made for."""
        return self._planned_agents

    @property
    def _newest(self) -> dict[int, Route]:
        """Of each vehicle what was last decided or proposed."""
        return self.routes | self.proposed

    def drop(self, vehicle: int) -> None:
        """Forget what a vehicle flies and might: it arrived, died, or is not ours to task."""
        self.drop_route(vehicle)
        self.proposed.pop(vehicle, None)

    def drop_route(self, vehicle: int) -> None:
        """Forget what a vehicle flies: its mission could not be delivered."""
        self.routes.pop(vehicle, None)
        self.blocked.discard(vehicle)

    def adopt(self, route: Route) -> None:
        """Take a route that was proposed for the one that is flown."""
        self.drop(route.vehicle)
        self.routes[route.vehicle] = route

    def use_map(self, grid: Grid) -> None:
        """Plan by another map than the mission's own."""
        self._grid = grid

    def resume(self, t_ns: int, routes: Mapping[int, Route], targets: Iterable[Label]) -> None:
        """Begin with routes that are flown already, and look at once."""
        self.routes = dict(routes)
        self._planned_agents, self._planned_targets = frozenset(routes), frozenset(targets)
        self._news.append(triggers.TAKEN_UP)
        self._next_check_t_ns = t_ns

    def keep_only(self, vehicles: Container[int]) -> None:
        """Forget what others fly: the plan has no route for them."""
        self.routes = {vehicle: route for vehicle, route in self.routes.items() if vehicle in vehicles}

    def change_map(
        self,
        t_ns: int,
        grid: Grid,
        closed: Grid,
        places: Mapping[int, Point],
        news: str,
        without_return: Container[int] = (),
    ) -> list[int]:
        """Plan by another map from now on, and look at once.

        Parameters
        ----------
        closed
            What is newly blocked; routes through it are given up at the next look.
        places
            Where vehicles are, east and north.
        without_return
            Vehicles whose ways home lead through what is closed.

        Returns
        -------
        list of int
            Vehicles that fly through what is closed as long as they have no other route.
        """
        self._grid = grid
        crossed = {v for v, r in self.routes.items() if is_crossed(closed, r.flown_m, places.get(v))}
        self.blocked |= crossed | {v for v in self.routes if v in without_return}
        self.proposed = {
            v: r for v, r in self.proposed.items() if not is_crossed(closed, r.flown_m, places.get(v))
        }
        self._news.append(triggers.map_changed(news))
        self._next_check_t_ns = None if self._next_check_t_ns is None else t_ns
        return sorted(self.blocked)

    def is_due(self, t_ns: int) -> bool:
        """Whether the time for a look has come; where events count, every scan may bring one."""
        return self._planning.when == "events" or self._is_regular(t_ns)

    def _is_regular(self, t_ns: int) -> bool:
        return self._next_check_t_ns is None or t_ns >= self._next_check_t_ns

    def check(self, inputs: PlanningInputs, *, urgent_only: bool = False) -> Plan | None:
        """Look whether something changed; if so, plan. What else there is to say stands in `notes`.

        With `urgent_only` nothing is planned for reasons that can wait; they stand until the next look.
        """
        self.notes = []
        if self._next_check_t_ns is None:
            return self._first_plan(inputs)
        regular = self._is_regular(inputs.t_ns)
        while self._next_check_t_ns <= inputs.t_ns:  # looks missed without scans are not made up for
            self._next_check_t_ns += self._period_ns
        changes, moved_m = self._changes(inputs), self._moves(inputs, 1.0 if regular else _FAR_OFF)
        # What one plan could not mend is not tried again at every scan: a target over an obstacle, say.
        self._tried = self._tried if not regular else set()
        wants = [triggers.moved(*move) for move in moved_m.items() if move[0] not in self._tried]
        self._tried |= moved_m.keys()
        if regular:
            wants = self._idle(inputs) + wants + self._endangered(inputs) + self._missed(inputs)
        if not changes and not wants:
            return None
        if urgent_only and not any(reason.cause in triggers.URGENT for reason in (*changes, *wants)):
            return None
        plan = self._plan(inputs, [*changes, *wants])
        # A target over an obstacle "moves" at every look, though no route gets nearer, and an agent with no
        # way to any target wants a route at every look: that is no news.
        return plan if changes or plan.changed else None

    def plan_anew(self, inputs: PlanningInputs, why: str) -> Plan:
        """Plan whatever changed or not: an operator confirmed a plan that cannot be flown as it was shown."""
        return self._plan(inputs, [triggers.approved_changed(why)])

    def withdraw_arriving(self, inputs: PlanningInputs) -> None:
        """Propose nothing to vehicles that are about to reach their targets by the routes that they fly."""
        self.proposed = {
            vehicle: route
            for vehicle, route in self.proposed.items()
            if vehicle not in self.routes or not self._is_arriving(self.routes[vehicle], inputs)
        }

    def renew(self, assignment: Mapping[int, Label], inputs: PlanningInputs) -> dict[int, Route]:
        """Plan proposed routes anew from where their vehicles are now, each to the target that it has.

        Vehicles, targets and ways that are not there now have none; `unrouted` says whose way is missing.
        """
        there = {
            vehicle: label
            for vehicle, label in assignment.items()
            if vehicle in inputs.agents and label in inputs.targets
        }
        starts = {vehicle: self._start(vehicle, inputs) for vehicle in there}
        result = self._routed(starts, set(there.values()), there, inputs, fixed=True)
        renewed = [
            self._captured(route, inputs) for route in result.routes if route.target == there[route.vehicle]
        ]
        vehicles = {route.vehicle for route in renewed}
        others = [r for v, r in self._newest.items() if v in inputs.agents and v not in vehicles]
        self._layers.other_vehicles = inputs.other_vehicles
        given, _ = self._layers.give([*others, *renewed], vehicles, inputs.agents, inputs.arrived)
        self.short = self.short - vehicles | result.stops_short & vehicles
        self.unrouted = frozenset(there.keys() - vehicles)
        routes = {route.vehicle: route for route in given if route.vehicle in vehicles}
        self.proposed |= routes
        self._given_t_ns |= dict.fromkeys(vehicles, inputs.t_ns)
        return routes

    def is_separated(self, route: Route, places: Mapping[int, Point]) -> bool:
        """Return True if a route that is flown again keeps clear of those that are flown now.

        `places` (east, north) are where vehicles are.
        """
        return self._layers.is_clear(route, list(self.routes.values()), places)

    def separation_m(self, inputs: PlanningInputs) -> dict[int, float]:
        """Return how near each vehicle will come to another at its altitude; infinite: no other is there."""
        routes = [route for v, route in sorted(self._newest.items()) if v in inputs.agents]
        return self._layers.separation_m(routes, self.proposed, inputs.agents, inputs.arrived)

    def _first_plan(self, inputs: PlanningInputs) -> Plan | None:
        """Plan as soon as everybody expected is there, or after a short wait with whoever is."""
        if self._started_t_ns is None:
            self._started_t_ns = inputs.t_ns
        everybody = (
            len(inputs.agents) >= self._expected_agents and len(inputs.targets) >= self._expected_targets
        )
        waited = inputs.t_ns - self._started_t_ns >= _FIRST_PLAN_WAIT_S * NS_PER_S
        if not (everybody or (waited and inputs.agents and inputs.targets)):
            return None
        self._next_check_t_ns = inputs.t_ns + self._period_ns
        return self._plan(inputs, [triggers.FIRST_PLAN])

    def _changes(self, inputs: PlanningInputs) -> list[Reason]:
        """Who and what came or went since the last plan."""
        gone = self._planned_agents - set(inputs.agents) - inputs.arrived
        news, self._news = self._news, []
        came = set(inputs.agents) - self._planned_agents
        gone_targets = {route.target for route in self._newest.values()} - set(inputs.targets)
        came_targets = set(inputs.targets) - self._planned_targets
        return [
            *news,
            *(triggers.gone(v, inputs.untaskable.get(v), is_lost=v in inputs.lost) for v in sorted(gone)),
            *(triggers.joined(v) for v in sorted(came)),
            *(triggers.appeared(t) for t in sorted(came_targets)),
            *(triggers.lost(t) for t in sorted(gone_targets)),
        ]

    def _idle(self, inputs: PlanningInputs) -> list[Reason]:
        """Who has no route although there are targets to spare."""
        newest = self._newest
        if self._planning.surplus == "hold" and not self._is_needed(inputs):
            return []
        idle = set(inputs.agents) & self._planned_agents - set(newest)
        return [triggers.idle(v) for v in sorted(idle)]

    def _is_needed(self, inputs: PlanningInputs) -> bool:
        """Whether some target has fewer agents on the way than it needs."""
        flown = Counter(route.target for route in self._newest.values())
        there = inputs.at_targets
        return any(flown[t] + there.get(t, 0) < self.plan_targets.needed(t) for t in inputs.targets)

    def _moves(self, inputs: PlanningInputs, times: float) -> dict[Label, float]:
        """Which targets are so many times too far from where their routes end, and how far, in metres."""
        return {
            route.target: moved_m
            for vehicle, route, agent in self._flown(inputs)
            if self._is_settled(vehicle, inputs)
            and not self._is_arriving(route, inputs)
            and (moved_m := self._off_m(vehicle, route, inputs))
            > times * self.plan_targets.tolerance_m(agent, route)
        }

    def _off_m(self, vehicle: int, route: Route, inputs: PlanningInputs) -> float:
        """How far a route ends from where its target will be then."""
        agent, target = inputs.agents[vehicle], inputs.targets[route.target]
        return self.plan_targets.off_m(vehicle, agent, route, target, inputs.left_s.get(vehicle, 0.0))

    def _is_settled(self, vehicle: int, inputs: PlanningInputs) -> bool:
        """Whether a vehicle had its route for a period, and long enough for the route to get there.

        Estimates jitter: a route that is corrected again before it was taken up is flown worse than one that
        is a little off.
        """
        had_ns = inputs.t_ns - self._given_t_ns.get(vehicle, 0)
        return had_ns >= max(self._period_ns, inputs.late_s.get(vehicle, 0.0) * NS_PER_S)

    def _endangered(self, inputs: PlanningInputs) -> list[Reason]:
        """Who would fly into something."""
        return [
            triggers.in_danger(vehicle)
            for vehicle, _, _ in self._flown(inputs)
            if self._is_endangered(vehicle, inputs)
        ]

    def _missed(self, inputs: PlanningInputs) -> list[Reason]:
        """Who passed its target, and was not seen to reach it."""
        return [
            triggers.passed(vehicle, route.target)
            for vehicle, route, _ in self._flown(inputs)
            if self._has_missed(vehicle, inputs)
        ]

    def _has_missed(self, vehicle: int, inputs: PlanningInputs) -> bool:
        is_helped = vehicle in self.proposed or vehicle in inputs.left_s
        return vehicle in inputs.passed and not is_helped and self._is_settled(vehicle, inputs)

    def _flown(self, inputs: PlanningInputs) -> Iterator[tuple[int, Route, Track]]:
        """Yield every vehicle that is there and flies to a target that is there, its route and its track."""
        for vehicle, route in sorted(self._newest.items()):
            if vehicle in inputs.agents and route.target in inputs.targets:
                yield vehicle, route, inputs.agents[vehicle]

    def _is_endangered(self, vehicle: int, inputs: PlanningInputs) -> bool:
        """Whether an agent hits something before the end of what it holds, and gets nothing else anyway."""
        options, motion = self._options, inputs.motion(vehicle)
        is_helped = vehicle in self.proposed or vehicle in inputs.left_s
        if options.shape != "flyable" or is_helped or not motion.ahead.points_m:
            return False
        look_s = turn_around_s(motion, options.turn_radius_m, self._lag_s)
        is_clear, last = simulate_until_blocked(self._grid, motion, look_s, self._lag_s, options.clearance_m)
        return not is_clear and bool(last.ahead.points_m)

    def _is_arriving(self, route: Route, inputs: PlanningInputs) -> bool:
        """Whether a vehicle is about to reach its target by the route that it flies: it keeps both."""
        vehicle = route.vehicle
        if self.routes.get(vehicle) is not route or vehicle in self.blocked or vehicle in inputs.passed:
            return False
        if vehicle not in inputs.agents or route.target not in inputs.targets:
            return False
        agent, target = inputs.agents[vehicle], inputs.targets[route.target]
        return is_arriving(agent, target) and not self._is_endangered(vehicle, inputs)

    def _plan(self, inputs: PlanningInputs, why: Sequence[Reason]) -> Plan:
        arriving = [route for _, route in sorted(self.routes.items()) if self._is_arriving(route, inputs)]
        keeping = {route.vehicle for route in arriving}
        there = Counter(inputs.at_targets) + Counter(route.target for route in arriving)
        kept_targets = {r.target for r in arriving if there[r.target] >= self.plan_targets.needed(r.target)}
        starts = {v: self._start(v, inputs) for v in inputs.agents if v not in keeping}
        open_targets = [label for label in inputs.targets if label not in kept_targets]
        pursued = {v: route.target for v, route in self._newest.items() if v not in keeping}
        result = self._routed(starts, open_targets, pursued, replace(inputs, at_targets=there))
        self._planned_agents = frozenset(inputs.agents)
        self._planned_targets = frozenset(inputs.targets)
        kept: list[Route] = arriving
        changed: list[int] = []
        for route in result.routes:
            flown, shown = self.routes.get(route.vehicle), self.proposed.get(route.vehicle)
            if route.vehicle in self.blocked:
                flown = None
            short = route.vehicle in result.stops_short
            if shown is not None and self._is_still_good(shown, route, inputs, short):
                kept.append(shown)  # what waits to be confirmed stays as long as it is good
            elif flown is not None and self._is_still_good(flown, route, inputs, short):
                kept.append(flown)
            else:
                kept.append(self._captured(route, inputs))
                changed.append(route.vehicle)
                self._given_t_ns[route.vehicle] = inputs.t_ns
        self.short = self.short - set(changed) | result.stops_short & set(changed)
        kept.sort(key=lambda route: route.vehicle)
        self._layers.other_vehicles = inputs.other_vehicles
        kept, near = self._layers.give(kept, changed, inputs.agents, inputs.arrived)
        notes = (*result.notes, *near)
        self.notes = [note for note in notes if note not in self._noted]
        self._noted = frozenset(notes)
        self._decide(kept, inputs)
        return Plan(
            t_ns=inputs.t_ns,
            picture_t_ns=inputs.picture_t_ns,
            routes=tuple(kept),
            unassigned_vehicles=tuple(result.unassigned_vehicles),
            unassigned_targets=tuple(result.unassigned_targets),
            reason=triggers.in_words(why),
            changed=tuple(changed),
            causes=triggers.kinds(why),
        )

    def _routed(
        self,
        starts: Mapping[int, AgentState],
        labels: Iterable[Label],
        flown: Mapping[int, Label],
        inputs: PlanningInputs,
        *,
        fixed: bool = False,
    ) -> PlanResult:
        """Plan for some agents and some targets; `fixed`: each agent to the target that it flies to."""
        targets = {label: inputs.targets[label] for label in labels}
        counts = Counter(flown.values())
        demands = {
            label: self.plan_targets.terms(label, track, inputs.at_targets.get(label, 0))
            for label, track in targets.items()
        }
        if fixed:
            demands = {label: replace(one, agents=counts[label]) for label, one in demands.items()}
        return plan_routes(
            self._grid,
            starts,
            {label: self._place(track, inputs) for label, track in targets.items()},
            flown,
            replace(self._options, switch_gain_m=math.inf) if fixed else self._options,
            demands=demands,
        )

    def _captured(self, route: Route, inputs: PlanningInputs) -> Route:
        """Return a route without the turn on to it, where its vehicle turns soon enough by itself."""
        vehicle, options = route.vehicle, self._options
        start = self._start(vehicle, inputs)
        if options.shape != "flyable" or not has_explicit_turn(start, route.points_m):
            return route
        plain = self._routed({vehicle: replace(start, course_rad=None)}, [route.target], {}, inputs)
        motion = self._expected(vehicle, inputs, 0.0)
        for one in plain.routes if vehicle not in plain.stops_short else ():
            look_s = turn_around_s(motion, options.turn_radius_m, self._lag_s)
            length_m = capture_length_m(
                self._grid, motion, one.points_m, self._corners, look_s, self._lag_s, options.clearance_m
            )
            if length_m < route.length_m:
                return replace(one, length_m=length_m)
        return route

    def _start(self, vehicle: int, inputs: PlanningInputs) -> AgentState:
        """Where an agent's turn on to a route that is planned now begins."""
        turns = self._expected(vehicle, inputs, 0.5 * self._lag_s)
        takes_up = self._expected(vehicle, inputs, 0.0)
        late_s = inputs.late_s.get(vehicle, 0.0)
        if vehicle in inputs.climbs:
            late_s += inputs.climbs[vehicle].duration_s
        return self.plan_targets.start(vehicle, turns, takes_up, late_s)

    def _expected(self, vehicle: int, inputs: PlanningInputs, more_s: float) -> Motion:
        """How an agent will move a while after it got a route that is planned now, or at its climb's end."""
        if vehicle in inputs.climbs:
            return predict_motion(self._grid, inputs.motion(vehicle), more_s, self._lag_s)
        motion, late_s = inputs.motion(vehicle), inputs.late_s.get(vehicle, 0.0)
        until_hold_s = max(0.0, motion.ahead.next_s - UploadTiming().guard_s)
        ahead_s = DELIVERY_S + motion.ahead.wait_s + min(late_s, until_hold_s) + more_s
        return predict_motion(self._grid, motion, ahead_s, self._lag_s)

    def _place(self, target: Track, inputs: PlanningInputs) -> Point:
        """Where a target will be when agents take up routes that are planned now."""
        return self.plan_targets.place(target, (inputs.t_ns - inputs.picture_t_ns) / NS_PER_S + self._ahead_s)

    def _decide(self, kept: list[Route], inputs: PlanningInputs) -> None:
        """Make the routes of a plan those that are flown, or propose those that differ."""
        if self._planning.retask == "auto":
            self.routes = {route.vehicle: route for route in kept}
            self.blocked.clear()
            return
        self.proposed = {r.vehicle: r for r in kept if r is not self.routes.get(r.vehicle)}
        self.routes = {v: r for v, r in self.routes.items() if r.target in inputs.targets}
        self.blocked &= set(self.routes)

    def _is_still_good(self, flown: Route, new: Route, inputs: PlanningInputs, short: bool) -> bool:
        """Whether a vehicle should fly on what it has; `short`: the new route does not reach its target."""
        vehicle, agent = new.vehicle, inputs.agents[new.vehicle]
        if flown.target != new.target:
            return False
        if self._is_endangered(vehicle, inputs):
            return False
        if short:
            return True
        if self._has_missed(vehicle, inputs):
            return False
        if _distance_m(new.points_m[-1], flown.points_m[-1]) < _SAME_PLACE_M:
            return True
        if not self._is_settled(vehicle, inputs):
            return True
        return self._off_m(vehicle, flown, inputs) <= self.plan_targets.tolerance_m(agent, flown)


def is_crossed(closed: Grid, way_m: FloatArray, place: Point | None) -> bool:
    """Whether what is left of a way leads through what is closed."""
    points = [(float(east_m), float(north_m)) for east_m, north_m in way_m]
    if place is not None:
        points = [place, *points[next_point(way_m, place, CORRIDOR_M) :]]
    if len(points) == 1:
        points *= 2
    return not all(line_of_sight(closed, a, b) for a, b in pairwise(points))


def _distance_m(a: FloatArray, b: FloatArray) -> float:
    return math.hypot(float(a[0]) - float(b[0]), float(a[1]) - float(b[1]))
