"""Search over terrain: costs of all pairs of agents and targets, and the route of one pair.

Maps of the band are made once for each grid and airframe, and fields once for each place. Costs are those to
where targets are at the begin of the routes. The route to a moving one leads to where the agent meets it: the
predicted place is corrected by the length of the path there, and is inside the map and the band.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from gcs.model import FloatArray
from gcs.planning.map.grid import Grid, Point
from gcs.planning.planner_inputs import AgentState, PlanOptions
from gcs.planning.terrain.band import FlightBand, Vertical, make_band
from gcs.planning.terrain.detour import AvoidedFlight, band_beside
from gcs.planning.terrain.first_rise import with_low_first_point
from gcs.planning.terrain.flown_route import ALLOWED_M, MARGINS_M, FlightModel, plan_flown_route
from gcs.planning.terrain.goal import cost_matrix, goal_at
from gcs.planning.terrain.ground import Terrain
from gcs.planning.terrain.leaving import band_to_leave, is_inside, without_areas_at
from gcs.planning.terrain.limited_band import block_closed, limit_band
from gcs.planning.terrain.loiter_circles import (
    CircleMap,
    goal_at_target,
    make_circle_map,
    nearest_circles,
)
from gcs.planning.terrain.route import TerrainRoute
from gcs.planning.terrain.terrain_map import BandPose, Goal, TerrainMap, make_terrain_map

_MAX_CORRECTIONS: Final = 8
"""Predicted places of a target that are tried."""
_MEETING_TOLERANCE_M: Final = 10.0


@dataclass(frozen=True, eq=False)
class Level:
    """Terrain and loiter circles with one tracking margin."""

    terrain: TerrainMap
    circles: CircleMap


class TerrainSearch:
    """Paths of n agents to m targets inside the band.

    Attributes
    ----------
    agents : sequence of AgentState
    costs : ndarray, shape (n, m)
        Lengths in metres; inf without a path.
    """

    def __init__(
        self,
        terrain: Terrain,
        grid: Grid,
        agents: Sequence[AgentState],
        targets: Sequence[Point],
        options: PlanOptions,
        velocities_m_s: Sequence[Point] = (),
    ) -> None:
        self.agents = agents
        self._velocities_m_s = velocities_m_s
        self._terrain = terrain
        self._grid = grid
        self._targets = targets
        self._options = options
        self._ways_out: dict[int, _WayOut] = {}
        self.costs: FloatArray = np.full((len(agents), len(targets)), math.inf)
        for own in dict.fromkeys(map(self._options_of, agents)):
            same = [i for i, agent in enumerate(agents) if self._options_of(agent) == own]
            level = levels_of(terrain, grid, own)[0]
            goals = [_goal(level, target, own) for target in targets]
            self.costs[same] = cost_matrix(level.terrain, [_start(agents[i]) for i in same], goals)
            for i in same:
                self._look_for_way_out(i, level.terrain.band, own)

    def _look_for_way_out(self, i: int, band: FlightBand, options: PlanOptions) -> None:
        """Prepare the way out of an area for an agent that is inside one."""
        start = _start(self.agents[i])
        if not is_inside(band, start):
            return
        near_m = options.clearance_m + max(MARGINS_M) + 2.0 * self._terrain.elevation.spacing_m
        place_m = start.east_m, start.north_m
        free = without_areas_at(self._terrain, self._grid, place_m, near_m)
        if free is None or is_inside(band_of(*free, options.clearance_m, MARGINS_M[0]), start):
            return
        way_out = self._ways_out[i] = _WayOut((self._terrain, self._grid), free, start, options)
        goals = [way_out.goal(way_out.levels[0], target) for target in self._targets]
        self.costs[i] = cost_matrix(way_out.levels[0].terrain, [start], goals)

    def route(
        self, i: int, j: int, layer: int, avoided: Sequence[AvoidedFlight] = ()
    ) -> tuple[TerrainRoute, Point | None] | None:
        """Return the route of agent i to target j, and the place where it meets it; None without a route.

        No place for an agent that leaves an area that the target is inside, too.

        It is planned with the least margin with which the simulated flight stays in the band.

        Parameters
        ----------
        avoided : sequence of AvoidedFlight
            Parts of other flights that the route leads round, over or under; no route from inside of them.
        """
        agent = self.agents[i]
        options = self._options_of(agent)
        assert options.turns is not None
        model = FlightModel(agent.speed_m_s, options.turn_lag_s, options.turns, agent.wind_m_s)
        way_out = self._ways_out.get(i)
        target_m = self._targets[j]
        tries: Iterable[tuple[TerrainMap, Goal | None]]
        if way_out is None:
            target_m = self._meeting_m(i, j)
            band = band_of(self._terrain, self._grid, options.clearance_m, 0.0)
            levels = levels_of(self._terrain, self._grid, options)
            tries = [(level.terrain, _goal(level, target_m, options)) for level in levels]
            if avoided:
                band = band_beside(band, avoided)
                if is_inside(band, _start(agent)):
                    return None
                tries = _tries_beside(levels, avoided, target_m, options)
        elif avoided:
            return None
        else:
            band = way_out.band(0.0)
            tries = [(level.terrain, way_out.goal(level, target_m)) for level in way_out.levels]
        share = self._terrain.share(layer)
        found = plan_flown_route(band, tries, _start(agent), model, share, ALLOWED_M, is_quick=bool(avoided))
        if found is None:
            return None
        route, goal = found
        if agent.climbs_first:
            route = with_low_first_point(route, agent.height_msl_m)
        if way_out is not None and way_out.ends_short(goal):
            return route, None
        return route, goal.place_m or target_m

    def _meeting_m(self, i: int, j: int) -> Point:
        """Return where agent i meets target j, as far as paths lead there within the horizon."""
        east_m, north_m = self._targets[j]
        agent = self.agents[i]
        options = self._options_of(agent)
        v_east, v_north = self._velocities_m_s[j] if self._velocities_m_s else (0.0, 0.0)
        speed_m_s = math.hypot(v_east, v_north)
        level = levels_of(self._terrain, self._grid, options)[0]
        length_m = float(self.costs[i, j])
        reached_s = 0.0
        meets_s = math.inf
        for _ in range(_MAX_CORRECTIONS):
            wanted_s = min(agent.start_delay_s + length_m / agent.speed_m_s, options.horizon_s)
            meets_s = min(wanted_s, meets_s)
            if speed_m_s * abs(meets_s - reached_s) <= _MEETING_TOLERANCE_M:
                break
            place_m = east_m + v_east * meets_s, north_m + v_north * meets_s
            goal = _goal(level, place_m, options) if self._grid.contains(place_m) else None
            there_m = float(cost_matrix(level.terrain, [_start(agent)], [goal])[0, 0])
            if math.isfinite(there_m):
                length_m = there_m
                reached_s = meets_s
                meets_s = math.inf
            else:
                meets_s = 0.5 * (reached_s + meets_s)
        return east_m + v_east * reached_s, north_m + v_north * reached_s

    def _options_of(self, agent: AgentState) -> PlanOptions:
        return agent.options or self._options


class _WayOut:
    """Way of an agent out of the areas that it is inside.

    Parameters
    ----------
    all_areas, free : (Terrain, Grid)
        Ground and map with all areas, and without those around the agent.
    """

    def __init__(
        self,
        all_areas: tuple[Terrain, Grid],
        free: tuple[Terrain, Grid],
        start: BandPose,
        options: PlanOptions,
    ) -> None:
        self._all_areas = all_areas
        self._free = free
        self._start = start
        self._options = options
        self._short: tuple[Goal, ...] = ()
        vertical = _vertical(options)
        self.levels = [
            Level(make_terrain_map(self.band(margin_m), vertical, options.turn_radius_m), one.circles)
            for margin_m, one in zip(MARGINS_M, levels_of(*all_areas, options), strict=True)
        ]

    def band(self, margin_m: float) -> FlightBand:
        """Return the band with a tracking margin."""
        clearance_m = self._options.clearance_m
        band = band_of(*self._all_areas, clearance_m, margin_m)
        free = band_of(*self._free, clearance_m, margin_m)
        vertical = _vertical(self._options)
        return band_to_leave(band, free, self._start, vertical, self._options.turn_radius_m)

    def goal(self, level: Level, target_m: Point) -> Goal | None:
        """Return the goal at a target, or where the target is in an area, on circles near it."""
        assert self._options.loiter is not None
        outside = levels_of(*self._all_areas, self._options)[self.levels.index(level)]
        if _goal(outside, target_m, self._options) is not None:
            return goal_at_target(level.terrain, level.circles, target_m, self._options.loiter.reach_radius_m)
        near = nearest_circles(level.circles, target_m)
        short = goal_at(level.terrain, near) if near else None
        self._short += () if short is None else (short,)
        return short

    def ends_short(self, goal: Goal) -> bool:
        """Return True if a goal is near a target, and not at it."""
        return goal in self._short


def _tries_beside(
    levels: Sequence[Level], avoided: Sequence[AvoidedFlight], target_m: Point, options: PlanOptions
) -> Iterator[tuple[TerrainMap, Goal | None]]:
    """Yield the map and the goal of each margin for a route beside other flights; circles are as without."""
    assert options.loiter is not None
    for level in levels:
        band = band_beside(level.terrain.band, avoided)
        terrain = make_terrain_map(band, level.terrain.vertical, level.terrain.turn_radius_m)
        yield terrain, goal_at_target(terrain, level.circles, target_m, options.loiter.reach_radius_m)


def _vertical(options: PlanOptions) -> Vertical:
    return Vertical(options.climb_gradient, options.sink_gradient)


def _start(agent: AgentState) -> BandPose:
    return BandPose(agent.east_m, agent.north_m, agent.course_rad, agent.height_msl_m, agent.height_msl_m)


def levels_of(terrain: Terrain, grid: Grid, options: PlanOptions) -> list[Level]:
    """Return the maps of an airframe, with the least margin first."""
    loiter = options.loiter
    assert loiter is not None
    vertical = _vertical(options)
    radii_m = options.turn_radius_m, max(loiter.radius_m, options.turn_radius_m)
    return [_level(terrain, grid, options.clearance_m, margin_m, radii_m, vertical) for margin_m in MARGINS_M]


@lru_cache(maxsize=8)
def band_of(terrain: Terrain, grid: Grid, clearance_m: float, margin_m: float) -> FlightBand:
    """Return the band with a tracking margin."""
    heights_m = terrain.min_agl_m, terrain.max_agl_m
    band = make_band(terrain.elevation, *heights_m, grid, clearance_m, margin_m)
    if not terrain.areas:
        return band
    clearances_m = clearance_m + margin_m, terrain.vertical_clearance_m
    limits = terrain.home_msl_m, clearances_m
    blocked, passed = block_closed(band, terrain.elevation, grid, terrain.areas, *limits)
    if blocked is not grid:
        band = make_band(terrain.elevation, *heights_m, blocked, clearance_m, margin_m)
    return limit_band(band, terrain.elevation, grid, passed, *limits)


@lru_cache(maxsize=8)
def _level(
    terrain: Terrain,
    grid: Grid,
    clearance_m: float,
    margin_m: float,
    radii_m: tuple[float, float],
    vertical: Vertical,
) -> Level:
    """Return the maps for one margin; `radii_m`: of turns and of loiter circles."""
    band = band_of(terrain, grid, clearance_m, margin_m)
    return Level(make_terrain_map(band, vertical, radii_m[0]), make_circle_map(band, radii_m[1]))


def _goal(level: Level, target_m: Point, options: PlanOptions) -> Goal | None:
    assert options.loiter is not None
    return _goal_at(level, target_m, options.loiter.reach_radius_m)


@lru_cache(maxsize=64)  # 1.3 MB each for 25 square kilometres
def _goal_at(level: Level, target_m: Point, reach_radius_m: float) -> Goal | None:
    return goal_at_target(level.terrain, level.circles, target_m, reach_radius_m)
