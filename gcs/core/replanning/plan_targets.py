"""What is asked of the planner for each target, and how far a route is from what it should be by now."""

from __future__ import annotations

import math

from gcs.config import Config
from gcs.config.tables import PlanningTable
from gcs.core.tasking.mission_builder import corners_of
from gcs.model import Label, Route, Track
from gcs.planning.intercept import shrunk_velocity
from gcs.planning.map.grid import Point
from gcs.planning.planner_inputs import AgentState, LoiterSpec, PlanOptions, TargetDemand
from gcs.planning.route_progress import CORRIDOR_M, remaining_length_m
from gcs.planning.vehicle_model import Motion

LAST_M = 50.0
"""An agent this near to its target, and closing in, keeps it, and its route."""
_CLOSE_FRACTION = 0.25
_UNKNOWN_RADIUS_M = 80.0
"""Of circles that are left to autopilots: PX4's NAV_LOITER_RAD, more than ArduPlane's WP_LOITER_RAD of 60."""
_FAR_FRACTION = 0.1
"""Of the way to go: a meeting that is off by less costs next to nothing to correct later."""


def plan_options(config: Config) -> PlanOptions:
    """Return how a mission is planned."""
    planning = config.planning
    return PlanOptions(
        clearance_m=planning.clearance_m,
        shape=planning.shape,
        search_cost=planning.search_cost,
        switch_gain_m=planning.switch_gain_m,
        turn_radius_m=config.airframe.planned_radius_m,
        horizon_s=planning.horizon_s if planning.aim == "intercept" else 0.0,
        cost=planning.cost,
        objective=planning.objective,
        surplus=planning.surplus,
        loiter=_loiter(config),
    )


def _loiter(config: Config) -> LoiterSpec | None:
    """How agents circle at the ends of their routes; None when they go home instead."""
    mission, airframe = config.mission, config.airframe
    if mission.end != "loiter":
        return None
    return LoiterSpec(
        max(mission.loiter_radius_m or _UNKNOWN_RADIUS_M, airframe.turn_radius_m),
        config.planning.capture_radius_m,
        airframe.turn_lag_s,
        corners_of(mission, airframe),
    )


class PlanTargets:
    """Starts of agents, terms of targets, and the tolerance for routes that end where a target is not."""

    def __init__(self, config: Config) -> None:
        self._planning: PlanningTable = config.planning
        self._births = config.births
        self._speeds_m_s = {agent.vehicle: config.speed_m_s(agent.vehicle) for agent in config.agents}
        highest = max((birth.priority for birth in config.births), default=0)
        self._ranks = [highest - birth.priority for birth in config.births]
        self._rank = highest

    def start(self, vehicle: int, turns: Motion, takes_up: Motion, late_s: float) -> AgentState:
        """Where an agent begins its route: how it moves when it turns, and when it takes the route up."""
        return AgentState(*turns.place_m, turns.course_rad, self._speeds_m_s[vehicle], late_s, takes_up)

    def place(self, target: Track, ahead_s: float) -> Point:
        """Where a target will be; with `planning.aim = "position"` where it is."""
        east_m, north_m = place_of(target)
        if self._planning.aim == "position":
            return east_m, north_m
        v_east, v_north = shrunk_velocity(target)
        return east_m + v_east * ahead_s, north_m + v_north * ahead_s

    def terms(self, label: Label, track: Track, arrived: int) -> TargetDemand:
        """What a target still needs, `arrived` agents being there."""
        known = label[1] < len(self._births)
        rank, needed = (self._ranks[label[1]], self.needed(label)) if known else (self._rank, 1)
        return TargetDemand(shrunk_velocity(track), rank, max(1, needed - arrived))

    def needed(self, label: Label) -> int:
        """How many agents a target needs."""
        return self._births[label[1]].agents if label[1] < len(self._births) else 1

    def off_m(self, vehicle: int, agent: Track, route: Route, target: Track, begins_s: float) -> float:
        """How far a route, which is flown from in `begins_s` on, ends from where its target will be then."""
        to_go = remaining_length_m(route.points_m, place_of(agent), CORRIDOR_M)
        arrives_s = begins_s + to_go / self._speeds_m_s[vehicle]
        place = self.place(target, min(arrives_s, self._planning.horizon_s))
        return math.dist(place, route.points_m[-1])

    def tolerance_m(self, agent: Track, route: Route) -> float:
        """How far off a route may end.

        `target_moved_m` when the agent is far away, as in the paper, and less as it closes in: with a fixed
        threshold an agent may wait at the end of its route while the target walks around just inside it.
        """
        planning, (east_m, north_m) = self._planning, place_of(agent)
        beeline_m = math.hypot(east_m - float(route.points_m[-1, 0]), north_m - float(route.points_m[-1, 1]))
        most_m = planning.target_moved_m
        if planning.aim == "intercept":
            most_m = max(most_m, _FAR_FRACTION * beeline_m)
        return min(most_m, max(0.5 * planning.capture_radius_m, _CLOSE_FRACTION * beeline_m))


def is_arriving(agent: Track, target: Track) -> bool:
    """Return True if an agent closes in on a target over its last `LAST_M`: no mission gets there in time."""
    (east_m, north_m), (v_east, v_north) = target.mean[:2] - agent.mean[:2], agent.mean[2:4]
    is_closing = east_m * v_east + north_m * v_north > 0.0
    return bool(is_closing and math.hypot(east_m, north_m) <= LAST_M)


def place_of(track: Track) -> Point:
    """East and north of a track."""
    return float(track.mean[0]), float(track.mean[1])


def course_of(track: Track) -> float:
    """Course of a track over ground, in radians clockwise from north."""
    return math.atan2(float(track.mean[2]), float(track.mean[3]))
