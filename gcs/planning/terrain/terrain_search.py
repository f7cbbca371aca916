"""Search over terrain: costs of all pairs of agents and targets, and the route of one pair.

Maps of the band are made once for each grid and airframe, and fields once for each target. A moving target is
flown to where it is at the begin of the routes: its intercept is left to later plans.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gcs.model import FloatArray
from gcs.planning.map.grid import Grid, Point
from gcs.planning.planner_inputs import AgentState, PlanOptions
from gcs.planning.terrain.band import FlightBand, Vertical, make_band
from gcs.planning.terrain.first_rise import with_low_first_point
from gcs.planning.terrain.flown_route import ALLOWED_M, MARGINS_M, FlightModel, plan_flown_route
from gcs.planning.terrain.goal import cost_matrix
from gcs.planning.terrain.ground import Terrain
from gcs.planning.terrain.limited_band import block_closed, limit_band
from gcs.planning.terrain.loiter_circles import CircleMap, goal_at_target, make_circle_map
from gcs.planning.terrain.route import TerrainRoute
from gcs.planning.terrain.terrain_map import BandPose, Goal, TerrainMap, make_terrain_map


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
    ) -> None:
        self.agents = agents
        self._terrain = terrain
        self._grid = grid
        self._targets = targets
        self._options = options
        self.costs: FloatArray = np.full((len(agents), len(targets)), math.inf)
        for own in dict.fromkeys(map(self._options_of, agents)):
            same = [i for i, agent in enumerate(agents) if self._options_of(agent) == own]
            level = levels_of(terrain, grid, own)[0]
            goals = [_goal(level, target, own) for target in targets]
            self.costs[same] = cost_matrix(level.terrain, [_start(agents[i]) for i in same], goals)

    def route(self, i: int, j: int, layer: int) -> tuple[TerrainRoute, Point] | None:
        """Return the route of agent i to target j, and the place where it meets it; None without a route.

        It is planned with the least margin with which the simulated flight stays in the band.
        """
        agent = self.agents[i]
        options = self._options_of(agent)
        assert options.turns is not None
        model = FlightModel(agent.speed_m_s, options.turn_lag_s, options.turns)
        band = band_of(self._terrain, self._grid, options.clearance_m, 0.0)
        levels = levels_of(self._terrain, self._grid, options)
        tries = ((level.terrain, _goal(level, self._targets[j], options)) for level in levels)
        found = plan_flown_route(band, tries, _start(agent), model, self._terrain.share(layer), ALLOWED_M)
        if found is None:
            return None
        route, goal = found
        if agent.climbs_first:
            route = with_low_first_point(route, agent.height_msl_m)
        return route, goal.place_m or self._targets[j]

    def _options_of(self, agent: AgentState) -> PlanOptions:
        return agent.options or self._options


def _start(agent: AgentState) -> BandPose:
    return BandPose(agent.east_m, agent.north_m, agent.course_rad, agent.height_msl_m, agent.height_msl_m)


def levels_of(terrain: Terrain, grid: Grid, options: PlanOptions) -> list[Level]:
    """Return the maps of an airframe, with the least margin first."""
    loiter = options.loiter
    assert loiter is not None
    vertical = Vertical(options.climb_gradient, options.sink_gradient)
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
