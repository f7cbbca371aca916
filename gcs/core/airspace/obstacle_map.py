"""Obstacle map of a mission: obstacles of its file, GeoJSON and fence, and random ones."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gcs.config import Config
from gcs.fence import drawn_areas
from gcs.model import UNLIMITED, IntArray, LayerHeights, NoFlyZone, VerticalLimits
from gcs.planning.map.grid import Grid, Point, Polygon, free_grid, random_obstacles
from gcs.planning.map.zone_heights import LimitedArea, blocked_by

_PURPOSE = 0x6D6170
"""Separates the map's random numbers from others with the same seed."""
_KEEP_CLEAR_M = 120.0
"""Minimum distance of random obstacles from starts and birth components."""


@dataclass(frozen=True, eq=False)
class ObstacleMap:
    """Obstacles in the altitude layers, and below them.

    Attributes
    ----------
    full : Grid
        Cells that are blocked from the ground to the sky.
    limited : tuple of LimitedArea
        Areas with vertical limits.
    layers : LayerHeights
    """

    full: Grid
    limited: tuple[LimitedArea, ...]
    layers: LayerHeights

    @cached_property
    def grid(self) -> Grid:
        """Map of the altitude layers."""
        return blocked_by(self.full, (one for one in self.limited if self.layers.meet(one.limits)))

    @cached_property
    def near_ground(self) -> Grid:
        """Map of climbs and landings: with the obstacles below the layers."""
        return blocked_by(self.grid, (one for one in self.limited if self.layers.lie_above(one.limits)))

    @property
    def has_low(self) -> bool:
        """True if there are obstacles below the layers."""
        return self.near_ground is not self.grid

    def around(self, places: Iterable[tuple[Point, float]]) -> Grid:
        """Return the map of the layers; within a distance in metres of each place that of climbs."""
        grid = self.grid
        if not self.has_low:
            return grid
        discs_m = [(*place, distance_m) for place, distance_m in places]
        is_near = _free(grid).with_obstacles(discs_m).blocked
        return replace(grid, blocked=grid.blocked | (self.near_ground.blocked & is_near))

    def with_areas(self, areas: Iterable[LimitedArea]) -> ObstacleMap:
        """Return the map with more areas; those without limits are blocked at all heights."""
        areas = tuple(areas)
        limited = tuple(one for one in areas if not one.limits.are_open)
        full = blocked_by(self.full, (one for one in areas if one.limits.are_open))
        return ObstacleMap(full, (*self.limited, *limited), self.layers)


@dataclass(slots=True)
class _Shapes:
    """Obstacles with the same vertical limits."""

    discs_m: list[Sequence[float]] = field(default_factory=list)
    boxes_m: list[Sequence[float]] = field(default_factory=list)
    polygons_m: list[Polygon] = field(default_factory=list)

    def on(self, grid: Grid) -> Grid:
        return grid.with_obstacles(self.discs_m, self.boxes_m, polygons_m=self.polygons_m)


def mission_map(config: Config, seed: int) -> ObstacleMap:
    """Return the obstacle map of a mission; random obstacles depend on `seed` alone."""
    area = config.map
    free = free_grid((area.nodes_north, area.nodes_east), config.spacing_m[0])
    shapes = _shapes(config)
    full = shapes.pop(UNLIMITED, _Shapes()).on(free)
    limited = [LimitedArea(_cells(some.on(free)), limits) for limits, some in shapes.items()]
    if config.zones.boundary:
        full = full.within(config.zones.boundary)
    for fenced in drawn_areas(config, config.name):
        if fenced.stay_in:
            full = full.within([[fenced.outline_m(config.local_frame)]])
    kept_clear = [(agent.east_m, agent.north_m) for agent in config.agents]
    kept_clear += [(birth.east_m, birth.north_m) for birth in config.births]
    rng = np.random.default_rng([seed, _PURPOSE])
    full = random_obstacles(full, area.random_threshold, rng, kept_clear, _KEEP_CLEAR_M)
    return ObstacleMap(full, tuple(limited), config.layer_heights)


def mission_grid(config: Config, seed: int) -> Grid:
    """Return the search grid of a mission: the map of its altitude layers."""
    return mission_map(config, seed).grid


def closed_area(grid: Grid, zone: NoFlyZone) -> LimitedArea:
    """Return the cells of a map that an operator's no-fly zone overlaps."""
    discs_m = [] if zone.disc_m is None else [zone.disc_m]
    polygons_m = [[zone.polygon_m]] if zone.disc_m is None else []
    return LimitedArea(_cells(_free(grid).with_obstacles(discs_m, polygons_m=polygons_m)), zone.limits)


def _shapes(config: Config) -> dict[VerticalLimits, _Shapes]:
    """Return the obstacles of a mission by their vertical limits, without those of its boundary."""
    area = config.map
    shapes: dict[VerticalLimits, _Shapes] = defaultdict(_Shapes)
    shapes[UNLIMITED] = _Shapes([*area.discs_m], [*area.boxes_m], [[ring] for ring in area.polygons_m])
    for obstacle in area.obstacles:
        some = shapes[obstacle.limits]
        some.discs_m += [] if obstacle.disc_m is None else [obstacle.disc_m]
        some.boxes_m += [] if obstacle.box_m is None else [obstacle.box_m]
        some.polygons_m += [] if obstacle.polygon_m is None else [[obstacle.polygon_m]]
    for zone in config.zones.no_fly:
        some = shapes[zone.limits]
        some.discs_m += [] if zone.circle is None else [(*zone.circle[0], zone.circle[1])]
        some.polygons_m += [zone.polygon] if zone.circle is None else []
    for fenced in drawn_areas(config, config.name):
        if not fenced.stay_in:
            shapes[fenced.limits].polygons_m.append([fenced.outline_m(config.local_frame)])
    return shapes


def _free(grid: Grid) -> Grid:
    return free_grid(grid.shape, grid.spacing_m, grid.origin_m)


def _cells(grid: Grid) -> IntArray:
    return np.flatnonzero(grid.blocked)
