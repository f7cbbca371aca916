"""Obstacle map of a mission: obstacles of its file, GeoJSON and fence, and random ones."""

from __future__ import annotations

import numpy as np

from gcs.config import Config
from gcs.fence import drawn_areas
from gcs.planning.map.grid import Grid, free_grid, random_obstacles

_PURPOSE = 0x6D6170
"""Separates the map's random numbers from others with the same seed."""
_KEEP_CLEAR_M = 120.0
"""Minimum distance of random obstacles from starts and birth components."""


def mission_grid(config: Config, seed: int) -> Grid:
    """Return the search grid of a mission; random obstacles depend on `seed` alone."""
    area = config.map
    grid = free_grid((area.nodes_north, area.nodes_east), config.spacing_m[0])
    zones = config.zones
    circles_m = [(east, north, radius) for (east, north), radius in zones.circles]
    grid = grid.with_obstacles(
        [*area.discs_m, *circles_m],
        area.boxes_m,
        polygons_m=[*([ring] for ring in area.polygons_m), *zones.polygons],
    )
    if zones.boundary:
        grid = grid.within(zones.boundary)
    for fenced in drawn_areas(config, config.name):
        ring = fenced.outline_m(config.local_frame)
        grid = grid.within([[ring]]) if fenced.stay_in else grid.with_obstacles(polygons_m=[[ring]])
    kept_clear = [(agent.east_m, agent.north_m) for agent in config.agents]
    kept_clear += [(birth.east_m, birth.north_m) for birth in config.births]
    rng = np.random.default_rng([seed, _PURPOSE])
    return random_obstacles(grid, area.random_threshold, rng, kept_clear, _KEEP_CLEAR_M)
