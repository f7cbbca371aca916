"""Warm-up of the kernels of routes over terrain, by a small plan."""

from __future__ import annotations

import numpy as np

from gcs import jit
from gcs.planning.map.grid import free_grid
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.planner_inputs import AgentState, LoiterSpec, PlanOptions
from gcs.planning.terrain.ground import Terrain
from gcs.planning.terrain.loiter_circles import circle_heights
from gcs.planning.terrain.terrain_search import TerrainSearch
from gcs.terrain.elevation import Elevation


def warm_up_calls() -> list[jit.Call]:
    """Return one call of a short kernel, and a plan that calls all others."""
    return [(circle_heights, np.zeros((2, 2, 2), dtype=np.float32), 1.0, 0, 1, 0, 1), (_plan,)]


def _plan() -> None:
    """Plan a route over a slope."""
    at = np.arange(0.0, 1500.0, 20.0)
    east, north = np.meshgrid(at, at)
    ground = Elevation((0.0, 0.0), 20.0, 0.05 * east + 10.0 * np.sin(north / 200.0))
    turns = TurnAnticipation(40.0, 15.0, 10.0)
    options = PlanOptions(
        shape="flyable", turns=turns, loiter=LoiterSpec(60.0, 40.0, 1.0, turns), turn_lag_s=1.0
    )
    agent = AgentState(300.0, 300.0, 0.0, height_msl_m=100.0)
    grid = free_grid((76, 76), 20.0)
    search = TerrainSearch(Terrain(ground, 50.0, 120.0), grid, [agent], [(1000.0, 1000.0)], options)
    search.route(0, 0, 0)
