"""Inputs of a plan that the mission file states: map, airframes, terrain."""

from __future__ import annotations

import math
from functools import lru_cache

from gcs.config import Config
from gcs.core.airspace.obstacle_map import ObstacleMap
from gcs.core.replanning.plan_targets import plan_options, vehicle_options
from gcs.core.separation.minima import PREDICTED_SHARE, layer_step_m
from gcs.planning.planner_inputs import AgentState, MissionInputs
from gcs.planning.terrain.ground import Terrain


def mission_inputs(config: Config, obstacles: ObstacleMap) -> MissionInputs:
    """Return the inputs of a plan from the starts of agents to the birth components of targets."""
    speeds_m_s = config.speeds_m_s
    options = vehicle_options(config)
    layers = _layers(config)
    terrain = terrain_of(config, obstacles)
    agents = {
        one.vehicle: AgentState(
            one.east_m,
            one.north_m,
            math.radians(one.course_deg),
            speeds_m_s[one.vehicle],
            options=options[one.vehicle],
            height_msl_m=_start_msl_m(terrain, one.east_m, one.north_m),
        )
        for one in config.agents
    }
    return MissionInputs(
        obstacles.grid,
        plan_options(config),
        layers,
        config.planning.separation_m,
        agents,
        {(0, number): (birth.east_m, birth.north_m) for number, birth in enumerate(config.births)},
        {one.vehicle: number % layers for number, one in enumerate(config.agents)},
        terrain=terrain,
        min_height_m=PREDICTED_SHARE * layer_step_m(config),
    )


def terrain_of(config: Config, obstacles: ObstacleMap | None = None) -> Terrain | None:
    """Return ground and flight band, with the areas of a map; None if the ground is flat."""
    table = config.terrain
    elevation = config.elevation
    if table is None or elevation is None:
        return None
    return _terrain(
        elevation,
        table.min_agl_m,
        table.max_agl_m,
        _layers(config),
        () if obstacles is None else obstacles.limited,
        config.frame.alt_msl_m,
        config.planning.vertical_clearance_m,
    )


_terrain = lru_cache(maxsize=4)(Terrain)
"""The planner makes its maps once for each terrain."""


def _layers(config: Config) -> int:
    return config.mission.layers if config.mission.layer_step_m > 0.0 else 1


def _start_msl_m(terrain: Terrain | None, east_m: float, north_m: float) -> float:
    """Return the height of a vehicle that is not heard yet: in the middle of the band."""
    if terrain is None:
        return math.nan
    ground_m = terrain.elevation.height_msl_m(east_m, north_m)
    return ground_m + 0.5 * (terrain.min_agl_m + terrain.max_agl_m)
