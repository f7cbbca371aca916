"""Obstacle map of a mission: obstacles of its file, GeoJSON and fence, and random ones."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gcs.config import Config
from gcs.fence import drawn_areas
from gcs.model import (
    UNLIMITED,
    FloatArray,
    IntArray,
    LayerHeights,
    LimitReference,
    NoFlyZone,
    VerticalLimits,
)
from gcs.planning.map.grid import Grid, Point, Polygon, free_grid, free_grid_like, random_obstacles
from gcs.planning.map.limited_area import LimitedArea, blocked_by
from gcs.terrain.elevation_grid import Elevation

_PURPOSE = 0x6D6170
"""Separates the map's random numbers from others with the same seed."""
_HALF_DIAGONAL = 0.7072
"""In cells."""
_KEEP_CLEAR_M = 120.0
"""Minimum distance of random obstacles from starts and birth components, in still air."""


@dataclass(frozen=True, slots=True)
class LowFlight:
    """Flight below the altitude layers around a place: the farther from it, the higher."""

    place: Point
    distance_m: float
    """Distance from the place up to which it may be on the ground."""
    height_m: float
    """Height above the ground at that distance."""
    gradient: float
    """Least rise beyond."""

    def reach_m(self, height_m: float) -> float:
        """Return the distance from the place up to which the flight may be lower than a height."""
        if height_m <= self.height_m:
            return self.distance_m
        return self.distance_m + (height_m - self.height_m) / self.gradient


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
    elevation : Elevation or None
        Ground of a mission over terrain.
    """

    full: Grid
    limited: tuple[LimitedArea, ...]
    layers: LayerHeights
    elevation: Elevation | None = None

    @cached_property
    def grid(self) -> Grid:
        """Map of the altitude layers."""
        return blocked_by(self.full, (one for one in self.limited if self.layers.meet(one.limits)))

    @cached_property
    def near_ground(self) -> Grid:
        """Map of climbs: with the obstacles below the layers."""
        return blocked_by(self.grid, self.low_areas)

    @cached_property
    def low_areas(self) -> list[LimitedArea]:
        """Obstacles below the layers."""
        return [one for one in self.limited if self.layers.lie_above(one.limits)]

    def below_layers(self, flights: Iterable[LowFlight]) -> Grid:
        """Return the map of the layers, with what flights below them come too near to."""
        grid = self.grid
        flights = list(flights)
        low_areas = self.low_areas
        if not (flights and low_areas):
            return grid
        blocked = grid.blocked.copy()
        for area in low_areas:
            _, ceiling_m = area.limits.above_level_ground(self.layers.ground_msl_m)
            centres_m = area.centres_m(grid)
            for flight in flights:
                away_m = np.hypot(*(centres_m - flight.place).T)
                reach_m = flight.reach_m(ceiling_m + self.layers.clearance_m)
                blocked.flat[area.cells[away_m < reach_m + _HALF_DIAGONAL * grid.spacing_m]] = True
        return replace(grid, blocked=blocked)

    def with_areas(self, areas: Iterable[LimitedArea]) -> ObstacleMap:
        """Return the map with more areas; those without limits are blocked at all heights."""
        areas = tuple(areas)
        limited = tuple(one for one in areas if not one.limits.are_open)
        full = blocked_by(self.full, (one for one in areas if one.limits.are_open))
        return replace(self, full=full, limited=(*self.limited, *limited))

    def ground_msl_m(self, places_m: FloatArray) -> FloatArray:
        """Return the height of the ground at places, shape (k, 2): level, without an elevation model."""
        if self.elevation is None:
            return np.full(len(places_m), self.layers.ground_msl_m)
        return self.elevation.heights_at(places_m)

    def zero_msl_m(self, reference: LimitReference, places_m: FloatArray) -> FloatArray:
        """Return the height that limits are above, at places, shape (k, 2)."""
        if reference == "ground":
            return self.ground_msl_m(places_m)
        return np.full(len(places_m), 0.0 if reference == "msl" else self.layers.ground_msl_m)


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
    airframes = config.airframes_of_agents.values()
    downwind = max((1.0 + one.wind_m_s / one.speed_m_s for one in airframes), default=1.0)  # wider turns
    full = random_obstacles(full, area.random_threshold, rng, kept_clear, downwind * _KEEP_CLEAR_M)
    return ObstacleMap(full, tuple(limited), config.layer_heights, config.elevation)


def mission_grid(config: Config, seed: int) -> Grid:
    """Return the search grid of a mission: the map of its altitude layers."""
    return mission_map(config, seed).grid


def closed_area(grid: Grid, zone: NoFlyZone) -> LimitedArea:
    """Return the cells of a map that an operator's no-fly zone overlaps."""
    discs_m = [] if zone.disc_m is None else [zone.disc_m]
    polygons_m = [[zone.polygon_m]] if zone.disc_m is None else []
    return LimitedArea(
        _cells(free_grid_like(grid).with_obstacles(discs_m, polygons_m=polygons_m)), zone.limits
    )


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


def _cells(grid: Grid) -> IntArray:
    return np.flatnonzero(grid.blocked)
