"""Planner options from the mission file, demands of targets, and how far routes may differ."""

from __future__ import annotations

import math

from gcs.config import Config
from gcs.config.airframe import AgentAirframe
from gcs.config.schema import PlanningTable
from gcs.core.tasking.mission_builder import corners_of
from gcs.model import Label, Route, Track
from gcs.planning.intercept import shrunk_velocity
from gcs.planning.map.grid import Point
from gcs.planning.planner_inputs import LoiterSpec, PlanOptions, TargetDemand

ARRIVING_M = 50.0
"""Distance to its target at which an approaching agent keeps its route."""
_CLOSE_FRACTION = 0.25
"""Greatest tolerated error at the end of a route, as a fraction of the distance."""
_FAR_FRACTION = 0.2
"""Tolerated error of an intercept, as a fraction of the distance.

Flying to a place that is off by e, and turning at the distance e / a from it, costs about a e / 2 of detour.
A noisy velocity moves a far intercept at each check, and each correction is an upload.
"""


def plan_options(config: Config, airframe: AgentAirframe | None = None) -> PlanOptions:
    """Return the planner options of a mission, for vehicles of an airframe; by default of `[airframe]`."""
    planning = config.planning
    airframe = airframe or config.default_airframe
    return PlanOptions(
        clearance_m=planning.clearance_m,
        shape=planning.shape,
        switch_gain_m=planning.switch_gain_m,
        turn_radius_m=airframe.planned_radius_m,
        horizon_s=planning.horizon_s if planning.aim == "intercept" else 0.0,
        cost=planning.cost,
        loiter=_loiter(airframe, planning.capture_radius_m, over_terrain=config.terrain is not None),
        turns=corners_of(airframe),
        turn_lag_s=airframe.turn_lag_s,
        climb_gradient=airframe.climb_gradient,
        sink_gradient=airframe.sink_gradient,
    )


def vehicle_options(config: Config) -> dict[int, PlanOptions]:
    """Return the planner options of each vehicle, by its airframe."""
    airframes = config.airframes_of_agents
    options = {airframe: plan_options(config, airframe) for airframe in airframes.values()}
    return {vehicle: options[airframe] for vehicle, airframe in airframes.items()}


def _loiter(airframe: AgentAirframe, capture_radius_m: float, *, over_terrain: bool) -> LoiterSpec | None:
    """Return the loiter circle at the ends of routes.

    Missions that end with a landing have none. In wind their routes end where there is room for one. Over
    terrain all routes end on a circle.
    """
    corners = corners_of(airframe)
    if airframe.end == "loiter" or over_terrain:
        return LoiterSpec(airframe.circle_radius_m, capture_radius_m, airframe.turn_lag_s, corners)
    if airframe.wind_m_s > 0.0:
        return LoiterSpec(
            airframe.turn_radius_m, capture_radius_m, airframe.turn_lag_s, corners, is_left=True
        )
    return None


class PlanTargets:
    """Demands of targets, and tolerances of routes."""

    def __init__(self, config: Config) -> None:
        self._planning: PlanningTable = config.planning
        self._births = config.births
        self._speeds_m_s = config.speeds_m_s
        highest = max((birth.priority for birth in config.births), default=0)
        self._ranks = [highest - birth.priority for birth in config.births]
        self._rank = highest

    def position(self, target: Track, ahead_s: float) -> Point:
        """Return the predicted position of a target; with `planning.aim = "position"` the current one."""
        east_m, north_m = place_of(target)
        if self._planning.aim == "position":
            return east_m, north_m
        v_east, v_north = shrunk_velocity(target)
        return east_m + v_east * ahead_s, north_m + v_north * ahead_s

    def demand(self, label: Label, track: Track, arrived: int, priority: int | None = None) -> TargetDemand:
        """Return the remaining demand of a target with `arrived` agents, and a priority by order."""
        known = label[1] < len(self._births)
        rank, needed = (self._ranks[label[1]], self.needed(label)) if known else (self._rank, 1)
        rank = rank if priority is None else self._rank - priority
        return TargetDemand(shrunk_velocity(track), rank, max(1, needed - arrived))

    def needed(self, label: Label) -> int:
        """Return the number of agents that a target needs."""
        return self._births[label[1]].agents if label[1] < len(self._births) else 1

    def off_m(self, route: Route, to_go_m: float, target: Track, begins_s: float) -> float:
        """Return the distance from a route's end to its target at arrival, if flown in `begins_s`."""
        arrives_s = begins_s + to_go_m / self._speeds_m_s[route.vehicle]
        position = self.position(target, min(arrives_s, self._planning.horizon_s))
        return math.dist(position, route.target_point_m)

    def tolerance_m(self, agent: Track, route: Route) -> float:
        """Return the tolerated distance from a route's end to its target.

        It is `target_moved_m` far away, as in the paper, and less near the target: with a fixed threshold an
        agent may wait at the end of its route while the target moves within it.
        """
        planning = self._planning
        distance_m = math.dist(place_of(agent), route.target_point_m)
        max_m = planning.target_moved_m
        if planning.aim == "intercept":
            max_m = max(max_m, _FAR_FRACTION * distance_m)
        return min(max_m, max(0.5 * planning.capture_radius_m, _CLOSE_FRACTION * distance_m))


def is_arriving(agent: Track, target: Track) -> bool:
    """Return True if an agent approaches its target within `ARRIVING_M`: a new mission would be late."""
    east_m, north_m = target.mean[:2] - agent.mean[:2]
    v_east, v_north = agent.mean[2:4]
    is_closing = east_m * v_east + north_m * v_north > 0.0
    return bool(is_closing and math.hypot(east_m, north_m) <= ARRIVING_M)


def place_of(track: Track) -> Point:
    """Return east and north of a track."""
    return float(track.mean[0]), float(track.mean[1])
