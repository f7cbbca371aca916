"""No-fly zones: discs and polygons that an operator closes in flight.

A zone blocks every grid cell that it overlaps, like an obstacle of the map, at the heights that it has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

from gcs.core.airspace.obstacle_map import LowFlight, ObstacleMap, closed_area
from gcs.core.airspace.records import AirspaceState
from gcs.model import NoFlyZone
from gcs.planning.map.grid import Grid, Point, free_grid_like
from gcs.planning.map.limited_area import LimitedArea, blocked_by
from gcs.planning.map.line_of_sight import line_of_sight


@dataclass(frozen=True, eq=False)
class ClosedZone:
    """A closed zone on the map."""

    grid: Grid
    """Its cells."""
    floor_msl_m: float
    """Minus infinity: it begins on the ground."""
    ceiling_msl_m: float
    is_in_layers: bool
    """True if vehicles meet it in their altitude layers."""

    @property
    def is_limited(self) -> bool:
        """True if it has a floor or a ceiling."""
        return math.isfinite(self.floor_msl_m) or math.isfinite(self.ceiling_msl_m)

    def contains(self, place: Point) -> bool:
        """Return True if a position is in its area, at any height."""
        return not line_of_sight(self.grid, place, place)

    def is_met(self, start: Point, end: Point, heights_msl_m: tuple[float, float]) -> bool:
        """Return True if a leg between two heights leads through it."""
        is_level_with_it = min(heights_msl_m) < self.ceiling_msl_m and max(heights_msl_m) > self.floor_msl_m
        return is_level_with_it and not line_of_sight(self.grid, start, end)


class NoFlyZones:
    """The map of the mission with the closed zones.

    Attributes
    ----------
    closed : dict of str to ClosedZone
    obstacles : ObstacleMap
        The current map.
    """

    def __init__(self, state: AirspaceState, obstacles: ObstacleMap) -> None:
        self._state = state
        self._open = obstacles
        self._draw()

    @property
    def grid(self) -> Grid:
        """The current map of the altitude layers."""
        return self.obstacles.grid

    def _draw(self) -> None:
        full = self._open.full
        areas = {name: closed_area(full, zone) for name, zone in self._state.zones.items()}
        self.closed = {name: self._closed(area) for name, area in areas.items()}
        self.obstacles = self._open.with_areas(areas.values())

    def _closed(self, area: LimitedArea) -> ClosedZone:
        layers = self._open.layers
        cells = blocked_by(free_grid_like(self._open.full), [area])
        floor_m, ceiling_m = area.limits.above_level_ground(layers.ground_msl_m)
        bounds_m = floor_m + layers.ground_msl_m, ceiling_m + layers.ground_msl_m
        return ClosedZone(cells, *bounds_m, layers.meet(area.limits))

    def contain(self, place: Point) -> bool:
        """Return True if a position in an altitude layer is in a closed zone."""
        return any(zone.contains(place) for zone in self.closed.values() if zone.is_in_layers)

    def change(self, zone: NoFlyZone) -> MapChange:
        """Close or open a zone; return the cells that are newly blocked."""
        before = self.obstacles
        self._state.zones.pop(zone.name, None)
        if zone.disc_m is not None or zone.polygon_m:
            self._state.zones[zone.name] = zone
        self._draw()
        return MapChange(before, self.obstacles)


@dataclass(frozen=True, eq=False)
class MapChange:
    """Map before and after a zone was closed or opened."""

    before: ObstacleMap
    after: ObstacleMap

    @cached_property
    def layers(self) -> Grid:
        """Cells that are newly blocked in the altitude layers."""
        return _newly_blocked(self.before.grid, self.after.grid)

    def below_layers(self, flight: LowFlight) -> Grid:
        """Return the cells that are newly blocked in the layers, and for a flight below them."""
        if not (self.before.limited or self.after.limited):
            return self.layers
        return _newly_blocked(self.before.below_layers([flight]), self.after.below_layers([flight]))


def _newly_blocked(before: Grid, after: Grid) -> Grid:
    return replace(after, blocked=after.blocked & ~before.blocked)
