"""Places of a mission on a map: the local frame in degrees, the ground, routes at the heights of layers.

Positions are latitude and longitude in degrees on WGS84, and metres above mean sea level.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

from gcs.config import Config
from gcs.geo import LocalFrame
from gcs.model import Label, Route, target_name, vehicle_name
from gcs.model.vehicle_ids import is_place
from gcs.terrain.elevation_grid import Elevation


class Place(NamedTuple):
    """Position on a map."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float


@dataclass(frozen=True, slots=True)
class PlannedRoute:
    """Route that a plan gave to a vehicle."""

    vehicle: int
    target: Label
    t_ns: int
    places: tuple[Place, ...]
    """From the vehicle's position at that time, if it is known, to the end."""
    replaced_t_ns: int | None = None
    """Time of the plan that gave the vehicle another route, or none; None: it was the last one."""

    @property
    def name(self) -> str:
        """Name for a display."""
        aim = target_name(self.target)
        aim = aim if is_place(self.target) else f"target {aim}"
        return f"route of vehicle {vehicle_name(self.vehicle)} to {aim}"


@dataclass(frozen=True, eq=False)
class MissionFrame:
    """What positions and routes of a mission need to be drawn on a map.

    Attributes
    ----------
    local : LocalFrame
        Local frame of the mission.
    layers_rel_m : tuple of float
        Height of each altitude layer above the origin, over flat ground.
    elevation : Elevation, optional
        The ground; None: it is level.
    """

    local: LocalFrame
    layers_rel_m: tuple[float, ...]
    elevation: Elevation | None = None

    @classmethod
    def of(cls, config: Config) -> Self:
        """Return the frame of a mission file."""
        mission = config.mission
        heights_m = (mission.altitude_rel_m + layer * mission.layer_step_m for layer in range(mission.layers))
        return cls(config.local_frame, tuple(heights_m), config.elevation)

    def place(self, east_m: float, north_m: float) -> Place:
        """Return the position on the ground at a point of the local frame."""
        height_m = math.nan if self.elevation is None else self.elevation.height_msl_m(east_m, north_m)
        known_m = self.local.alt_msl_m if math.isnan(height_m) else height_m
        return Place(*self.local.to_geodetic(east_m, north_m), known_m)

    def to_local(self, place: Place) -> tuple[float, float, float]:
        """Return a position east, north and above the origin, in metres."""
        east_m, north_m = self.local.to_local(place.lat_deg, place.lon_deg)
        return east_m, north_m, place.alt_msl_m - self.local.alt_msl_m

    def route(self, route: Route, t_ns: int) -> PlannedRoute:
        """Return a route with its heights, from its first point on: its own, or those of its layer."""
        points_m = route.flown_m.tolist()
        if route.heights_msl_m is None:
            layer = min(route.layer, len(self.layers_rel_m) - 1)
            heights_m = [self.local.alt_msl_m + self.layers_rel_m[layer]] * len(points_m)
        else:
            heights_m = route.heights_msl_m.tolist()
        places = tuple(
            Place(*self.local.to_geodetic(east_m, north_m), height_m)
            for (east_m, north_m), height_m in zip(points_m, heights_m, strict=True)
        )
        return PlannedRoute(route.vehicle, route.target, t_ns, places)
