"""Replanning triggers: how far a target, a vehicle or the map may differ from the routes before a new plan.

Agents and targets that come or go, and a changed map, trigger a plan at once. So does a target that is far
from the end of its route. The other triggers are checked once a period: agents without a route, targets that
moved, agents that would hit an obstacle, agents that passed their targets, and vehicles without a route in
the layers of others.

A route that waits for an operator's approval, or that was rejected, is compared like one that is flown.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping

from gcs.config import Config
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.replanning import reasons
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.plan_targets import PlanTargets, is_arriving, place_of, vehicle_options
from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.replanning.reasons import Reason
from gcs.core.replanning.replanning_state import ReplanningState
from gcs.core.state import Agent
from gcs.core.tasking.mission_builder import flown_points
from gcs.model import NS_PER_S, Label, Route, Track, target_name
from gcs.planning.route_joining import simulate_until_blocked, turn_around_s
from gcs.planning.route_progress import remaining_length_m

_URGENT_FACTOR = 3.0
"""Multiple of its tolerance that a target must have moved to trigger a plan between two periods."""


class Triggers:
    """Compares routes with the picture."""

    def __init__(
        self,
        config: Config,
        plan_targets: PlanTargets,
        layers: AltitudeLayers,
        zones: NoFlyZones,
        agents: Mapping[int, Agent],
        state: ReplanningState,
    ) -> None:
        self._layers = layers
        self._plan_targets = plan_targets
        self._zones = zones
        self._agents = agents
        self._state = state
        meets = config.planning.aim == "intercept"
        self._moved = "will be met {:.0f} m from the planned place" if meets else "moved {:.0f} m"
        self._options = vehicle_options(config)
        self._period_ns = int(config.planning.period_s * NS_PER_S)

    @property
    def newest(self) -> dict[int, Route]:
        """Proposed route of each vehicle, else the flown one, ordered by vehicle."""
        routes = {vehicle: agent.routes.newest for vehicle, agent in sorted(self._agents.items())}
        return {vehicle: route for vehicle, route in routes.items() if route is not None}

    def note_planned(self, vehicles: Container[int], targets: Iterable[Label]) -> None:
        """Note the agents and targets of a new plan."""
        for vehicle, agent in self._agents.items():
            agent.routes.is_planned = vehicle in vehicles
        self._state.planned_targets = tuple(sorted(targets))

    def changes(self, inputs: PlanningInputs) -> list[Reason]:
        """Return the agents and targets that came or went since the last plan, and the added triggers."""
        news = self._state.news
        self._state.news = []
        planned = self._planned()
        gone = planned - set(inputs.agents) - inputs.arrived
        came = set(inputs.agents) - planned
        gone_targets = {route.target for route in self.newest.values()} - set(inputs.targets)
        gone_targets -= inputs.ignored  # the order is the reason
        came_targets = set(inputs.targets) - set(self._state.planned_targets)
        return [
            *news,
            *(
                reasons.agent_gone(
                    v, inputs.untaskable.get(v), is_lost=v in inputs.lost, is_down=v in inputs.down
                )
                for v in sorted(gone)
            ),
            *(reasons.of_agent("agent joined", v, "joined") for v in sorted(came)),
            *(reasons.of_target("target appeared", t, "appeared") for t in sorted(came_targets)),
            *(reasons.of_target("target lost", t, "is not tracked any more") for t in sorted(gone_targets)),
        ]

    def improvements(self, inputs: PlanningInputs, *, is_regular: bool) -> list[Reason]:
        """Return the routes that a plan may improve.

        Between two regular checks these are only targets that are far from the ends of their routes, each
        once: a plan may be unable to help, for example when a target is over an obstacle.
        """
        tried: set[Label] = set() if is_regular else set(self._state.tried)
        moved_m = self._moved_m(inputs, 1.0 if is_regular else _URGENT_FACTOR)
        moved = [
            reasons.of_target("target moved", target, self._moved.format(far_m))
            for target, far_m in moved_m.items()
            if target not in tried
        ]
        self._state.tried = tuple(sorted(tried | moved_m.keys()))
        if not is_regular:
            return moved
        followed = list(self._followed(inputs))
        endangered = [
            reasons.of_agent("agent in danger", v, "would hit an obstacle")
            for v, _, _ in followed
            if self.is_endangered(v, inputs)
        ]
        passed = [
            reasons.of_agent("agent passed its target", v, f"passed target {target_name(route.target)}")
            for v, route, _ in followed
            if self.has_passed_target(v, inputs)
        ]
        occupied = [reasons.occupied(v) for v in sorted(self.in_occupied_layers(inputs))]
        return self._idle(inputs) + moved + endangered + passed + occupied

    def _idle(self, inputs: PlanningInputs) -> list[Reason]:
        """Return the agents without a route, if a target needs one."""
        newest = self.newest
        if not self._is_needed(newest, inputs):
            return []
        idle = sorted(set(inputs.agents) & (self._planned() - set(newest)))
        return [reasons.of_agent("agent idle", v, "has no route") for v in idle]

    def _planned(self) -> set[int]:
        """Return the vehicles that the last plan was made for."""
        return {vehicle for vehicle, agent in self._agents.items() if agent.routes.is_planned}

    def _is_needed(self, newest: Mapping[int, Route], inputs: PlanningInputs) -> bool:
        """Return True if a target has fewer agents on the way than it needs."""
        coming = Counter(route.target for route in newest.values())
        there = inputs.at_targets
        return any(coming[t] + there.get(t, 0) < self._plan_targets.needed(t) for t in inputs.targets)

    def _moved_m(self, inputs: PlanningInputs, factor: float) -> dict[Label, float]:
        """Return the targets that are farther from the ends of their routes than `factor` tolerances."""
        return {
            route.target: moved_m
            for vehicle, route, agent in self._followed(inputs)
            if self.is_settled(vehicle, inputs)
            and (moved_m := self._off_m(vehicle, route, inputs))
            > factor * self._plan_targets.tolerance_m(agent, route)
            and not self.is_arriving(route, inputs)
        }

    def _followed(self, inputs: PlanningInputs) -> Iterator[tuple[int, Route, Track]]:
        """Yield vehicle, newest route and track of each agent whose target is confirmed."""
        for vehicle, route in self.newest.items():
            if vehicle in inputs.agents and route.target in inputs.targets:
                yield vehicle, route, inputs.agents[vehicle]

    def _off_m(self, vehicle: int, route: Route, inputs: PlanningInputs) -> float:
        """Return the distance of a route's end from where its target will be then."""
        agent = self._agents[vehicle]
        target = inputs.targets[route.target]
        climb = inputs.climbs.get(vehicle)
        place = place_of(inputs.agents[vehicle])
        begins_s = inputs.left_s.get(vehicle, 0.0)
        if climb is not None:
            place = climb.latest_end_m
            begins_s = climb.duration_s
        passed = flown_points(agent, route, agent.perception.motion.state)
        to_go_m = remaining_length_m(route.points_m, place, passed)
        return self._plan_targets.off_m(route, to_go_m, target, begins_s)

    def is_within_tolerance(self, vehicle: int, route: Route, inputs: PlanningInputs) -> bool:
        """Return True if a route ends near enough to where its target will be then."""
        tolerance_m = self._plan_targets.tolerance_m(inputs.agents[vehicle], route)
        return self._off_m(vehicle, route, inputs) <= tolerance_m

    def is_settled(self, vehicle: int, inputs: PlanningInputs) -> bool:
        """Return True if a vehicle's newest route is older than a period, and than its upload takes.

        Estimates jitter: a route that is replaced before the vehicle follows it is worse than one that is
        slightly off.
        """
        age_ns = inputs.t_ns - self._agents[vehicle].routes.made_t_ns
        return age_ns >= max(self._period_ns, inputs.late_s.get(vehicle, 0.0) * NS_PER_S)

    def is_endangered(self, vehicle: int, inputs: PlanningInputs) -> bool:
        """Return True if an agent will hit an obstacle on its onboard mission, and no other is on its way.

        Over terrain one that is inside an obstacle keeps its way out: another would begin with another turn.
        """
        options = self._options[vehicle]
        motion = inputs.motion(vehicle)
        flown = self._agents[vehicle].routes.flown
        if (
            flown is not None
            and flown.heights_msl_m is not None
            and not self._zones.grid.is_free(motion.place_m)
        ):
            return False
        if options.shape != "flyable" or self._has_newer(vehicle, inputs) or not motion.ahead.points_m:
            return False
        horizon_s = turn_around_s(motion, options.turn_radius_m, options.turn_lag_s)
        is_clear, last = simulate_until_blocked(
            self._zones.grid, motion, horizon_s, options.turn_lag_s, options.clearance_m
        )
        return not is_clear and bool(last.ahead.points_m)

    def has_passed_target(self, vehicle: int, inputs: PlanningInputs) -> bool:
        """Return True if an agent passed its target without having reached it, and has no newer route."""
        has_newer = self._has_newer(vehicle, inputs)
        return vehicle in inputs.passed and not has_newer and self.is_settled(vehicle, inputs)

    def in_occupied_layers(self, inputs: PlanningInputs) -> set[int]:
        """Return the agents that will meet, in their layers, vehicles that fly no routes."""
        return self._layers.occupied(self._settled(inputs), inputs)

    def meeting(self, inputs: PlanningInputs) -> list[tuple[int, float]]:
        """Return the agents that soon meet any others at one height, and when, those first that do first.

        Those that hold for others are not among them, nor those that meet them: they are kept apart by that.
        """
        routes = {
            v: route
            for v, route in self.newest.items()
            if v in inputs.agents and self._agents[v].separation.avoidance is None
        }
        met = self._layers.first_met(list(routes.values()), inputs)
        settled = {route.vehicle for route in self._settled(inputs)}
        return [
            (v, after_s)
            for v, after_s in met.items()
            if v in settled and not self.is_arriving(routes[v], inputs)
        ]

    def _settled(self, inputs: PlanningInputs) -> list[Route]:
        return [
            route
            for v, route in self.newest.items()
            if v in inputs.agents and self.is_settled(v, inputs) and not self._has_newer(v, inputs)
        ]

    def _has_newer(self, vehicle: int, inputs: PlanningInputs) -> bool:
        """Return True if a newer route than the flown one is proposed or being uploaded."""
        return self._agents[vehicle].routes.proposed is not None or vehicle in inputs.left_s

    def is_arriving(self, route: Route, inputs: PlanningInputs) -> bool:
        """Return True if a vehicle is about to reach its target on the route that it flies."""
        vehicle = route.vehicle
        routes = self._agents[vehicle].routes
        if not route.is_same(routes.flown) or routes.is_blocked or vehicle in inputs.passed:
            return False
        if vehicle not in inputs.agents or route.target not in inputs.targets:
            return False
        agent = inputs.agents[vehicle]
        target = inputs.targets[route.target]
        return is_arriving(agent, target) and not self.is_endangered(vehicle, inputs)
