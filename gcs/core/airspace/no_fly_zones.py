"""No-fly zones: discs and polygons that an operator closes in flight.

A zone blocks every grid cell that it overlaps, like an obstacle of the map, at the heights that it has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from gcs.core.airspace.airspace_state import AirspaceState
from gcs.core.airspace.obstacle_map import LowFlight, ObstacleMap, closed_area
from gcs.model import BoolArray, FloatArray, NoFlyZone, VerticalLimits
from gcs.planning.map.grid import Grid, Point, free_grid_like
from gcs.planning.map.limited_area import LimitedArea, blocked_by
from gcs.planning.map.line_of_sight import line_of_sight


@dataclass(frozen=True, eq=False)
class ClosedZone:
    """A closed zone on the map."""

    grid: Grid
    """Its cells."""
    limits: VerticalLimits
    obstacles: ObstacleMap
    """Map of the mission without zones: its ground, home and layers."""

    @property
    def is_in_layers(self) -> bool:
        """True if vehicles meet it in their altitude layers."""
        return self.limits.are_open or self.obstacles.layers.meet(self.limits)

    def contains(self, place: Point) -> bool:
        """Return True if a position is in its area, at any height."""
        return not line_of_sight(self.grid, place, place)

    def is_met(
        self, start: Point, end: Point, heights_msl_m: tuple[float, float], margin_m: float = 0.0
    ) -> bool:
        """Return True if a leg between two heights leads through it, or nearer over or under it."""
        if line_of_sight(self.grid, start, end):
            return False
        places_m = self._places_m(start, end)
        heights_m = np.linspace(*heights_msl_m, len(places_m))
        return self._is_met_at(places_m, heights_m - margin_m, heights_m + margin_m)

    def is_met_in_band(self, start: Point, end: Point, band_agl_m: tuple[float, float]) -> bool:
        """Return True if a leg somewhere between two heights above the ground may lead through it."""
        if line_of_sight(self.grid, start, end):
            return False
        places_m = self._places_m(start, end)
        ground_m = self.obstacles.ground_msl_m(places_m)
        return self._is_met_at(places_m, ground_m + band_agl_m[0], ground_m + band_agl_m[1])

    def _places_m(self, start: Point, end: Point) -> FloatArray:
        """Return places on a leg, from its start to its end, no farther apart than the cells."""
        return np.linspace(start, end, 2 + int(math.dist(start, end) / self.grid.spacing_m))

    def _is_met_at(self, places_m: FloatArray, lowest_msl_m: FloatArray, highest_msl_m: FloatArray) -> bool:
        """Return True if a flight between heights at places leads through it."""
        floor_m, ceiling_m = self.limits.bounds_m
        zero_m = self.obstacles.zero_msl_m(self.limits.reference, places_m)
        is_level: BoolArray = (lowest_msl_m - zero_m < ceiling_m) & (highest_msl_m - zero_m > floor_m)
        legs = pairwise(zip(map(tuple, places_m.tolist()), is_level.tolist(), strict=True))
        return any((a[1] or b[1]) and not line_of_sight(self.grid, a[0], b[0]) for a, b in legs)


class NoFlyZones:
    """The map of the mission with the closed zones.

    Attributes
    ----------
    closed : dict of str to ClosedZone
    closed_cells : Grid
        Map of all closed zones, at any height.
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
        self.closed_cells = blocked_by(free_grid_like(full), areas.values())
        self.obstacles = self._open.with_areas(areas.values())
        self.__dict__.pop("limited", None)
        self.__dict__.pop("limited_cells", None)

    def _closed(self, area: LimitedArea) -> ClosedZone:
        cells = blocked_by(free_grid_like(self._open.full), [area])
        return ClosedZone(cells, area.limits, self._open)

    @cached_property
    def limited(self) -> list[ClosedZone]:
        """All areas with vertical limits, those of the mission as well."""
        return [self._closed(area) for area in self.obstacles.limited]

    @cached_property
    def limited_cells(self) -> Grid:
        """Map of all areas with vertical limits."""
        return blocked_by(free_grid_like(self._open.full), self.obstacles.limited)

    def contain(self, place: Point) -> bool:
        """Return True if a position in an altitude layer is in a closed zone."""
        return any(zone.contains(place) for zone in self.closed.values() if zone.is_in_layers)

    def change(self, zone: NoFlyZone) -> MapChange:
        """Close or open a zone; return what is newly blocked."""
        before = self.obstacles
        self._state.zones.pop(zone.name, None)
        if zone.disc_m is not None or zone.polygon_m:
            self._state.zones[zone.name] = zone
        self._draw()
        return MapChange(before, self.obstacles, self.closed.get(zone.name))


@dataclass(frozen=True, eq=False)
class MapChange:
    """Map before and after a zone was closed or opened."""

    before: ObstacleMap
    after: ObstacleMap
    zone: ClosedZone | None
    """None: it was opened."""

    @cached_property
    def layers(self) -> Grid:
        """Cells that are newly blocked in the altitude layers."""
        return _newly_blocked(self.before.grid, self.after.grid)

    def below_layers(self, flight: LowFlight) -> Grid:
        """Return the cells that are newly blocked in the layers, and for a flight below them."""
        if not (self.before.limited or self.after.limited):
            return self.layers
        return _newly_blocked(self.before.below_layers([flight]), self.after.below_layers([flight]))

    def is_crossed(self, path_m: FloatArray) -> bool:
        """Return True if a path over terrain meets the zone, or comes too near over or under it.

        Parameters
        ----------
        path_m : ndarray, shape (k, 3)
            East, north, and height above mean sea level.
        """
        if self.zone is None:
            return False
        points = path_m.tolist()
        if len(points) == 1:
            points *= 2
        legs = ((a[:2], b[:2], (a[2], b[2])) for a, b in pairwise(map(tuple, points)))
        clearance_m = self.after.layers.clearance_m
        return any(self.zone.is_met(*leg, clearance_m) for leg in legs)

    def may_cross_return(self, path_m: FloatArray, band_agl_m: tuple[float, float]) -> bool:
        """Return True if a return in a flight band may meet the zone.

        Parameters
        ----------
        path_m : ndarray, shape (k, 2)
            East and north.
        band_agl_m : (float, float)
            Least and greatest height above the ground.
        """
        if self.zone is None:
            return False
        clearance_m = self.after.layers.clearance_m
        wide_m = band_agl_m[0] - clearance_m, band_agl_m[1] + clearance_m
        legs = pairwise(map(tuple, path_m.tolist()))
        return any(self.zone.is_met_in_band(*leg, wide_m) for leg in legs)


def _newly_blocked(before: Grid, after: Grid) -> Grid:
    return replace(after, blocked=after.blocked & ~before.blocked)
