"""Inputs of a plan that the mission file states."""

from __future__ import annotations

import math

from gcs.config import Config
from gcs.core.replanning.plan_targets import plan_options, vehicle_options
from gcs.planning.map.grid import Grid
from gcs.planning.planner_inputs import AgentState, MissionInputs


def mission_inputs(config: Config, grid: Grid) -> MissionInputs:
    """Return the inputs of a plan from the starts of agents to the birth components of targets."""
    speeds_m_s = config.speeds_m_s
    options = vehicle_options(config)
    layers = config.mission.layers if config.mission.layer_step_m > 0.0 else 1
    agents = {
        one.vehicle: AgentState(
            one.east_m,
            one.north_m,
            math.radians(one.course_deg),
            speeds_m_s[one.vehicle],
            options=options[one.vehicle],
        )
        for one in config.agents
    }
    return MissionInputs(
        grid,
        plan_options(config),
        layers,
        config.planning.separation_m,
        agents,
        {(0, number): (birth.east_m, birth.north_m) for number, birth in enumerate(config.births)},
        {one.vehicle: number % layers for number, one in enumerate(config.agents)},
    )
