"""Records of routes, plans and missions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from gcs.model.basics import FloatArray, Label

APPROACH_M = 500.0
"""Length of a landing approach: from its first point to home."""


HeightReference: TypeAlias = Literal["home", "msl"]
"""What a height is above: the vehicle's home, or mean sea level."""


@dataclass(frozen=True, slots=True)
class Waypoint:
    """Waypoint of a mission."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    accept_radius_m: float
    reference: HeightReference = "home"
    """What `alt_m` is above."""


@dataclass(frozen=True, slots=True)
class LandingWait:
    """Wait of a vehicle on a circle before its landing, in its layer."""

    corner: int
    """Corner of the return route after which it waits; -1: the last point of its route."""
    seconds: int


@dataclass(frozen=True, slots=True)
class Mission:
    """Waypoints for one vehicle, home excluded."""

    mission_id: int
    vehicle: int
    waypoints: tuple[Waypoint, ...]
    loiter_radius_m: float = 0.0
    """Loiter radius at the last waypoint; 0: the autopilot's own."""
    end: Literal["loiter", "land"] = "loiter"
    """Loiter at the last waypoint, or return home from there and land."""
    wait: Waypoint | None = None
    """Centre of the loiter circle; None: the last waypoint."""
    takeoff: Waypoint | None = None
    """End of the climb, for a mission from the ground; None: the first waypoint."""
    return_waypoints: tuple[Waypoint, ...] = ()
    """Corners of the return route up to the approach; empty: straight."""
    landing_wait: LandingWait | None = None


@dataclass(frozen=True, slots=True)
class Route:
    """Route of one vehicle to one target."""

    vehicle: int
    target: Label
    points_m: FloatArray
    """(k, 2) east/north, without the vehicle's position, with the target's."""
    length_m: float
    """Length from the vehicle's position along the points."""
    layer: int = 0
    """Altitude layer; 0 is the lowest (`gcs.planning.layer_assignment`)."""
    wait_m: tuple[float, float] | None = None
    """Centre of the loiter circle that follows, east/north; None: the last point."""
    heights_msl_m: FloatArray | None = None
    """(k,) height above mean sea level of each of `flown_m`; None: that of the layer, above home."""
    target_point: int = -1
    """Index of the point where it meets its target; -1: the last one."""

    @property
    def flown_m(self) -> FloatArray:
        """Points of the route and the centre of the loiter circle that follows, (k, 2)."""
        return self.points_m if self.wait_m is None else np.vstack((self.points_m, self.wait_m))

    @property
    def target_point_m(self) -> tuple[float, float]:
        """Where it meets its target, east/north."""
        east_m, north_m = self.points_m[self.target_point].tolist()
        return east_m, north_m

    def is_same(self, other: Route | None) -> bool:
        """Return True if another route has the same values."""
        if other is None or other is self:
            return other is self
        return (
            self.vehicle == other.vehicle
            and self.target == other.target
            and self.length_m == other.length_m
            and self.layer == other.layer
            and self.wait_m == other.wait_m
            and self.target_point == other.target_point
            and np.array_equal(self.points_m, other.points_m)
            and _are_equal(self.heights_msl_m, other.heights_msl_m)
        )


def _are_equal(one: FloatArray | None, other: FloatArray | None) -> bool:
    return one is other if one is None or other is None else np.array_equal(one, other)


Cause: TypeAlias = Literal[
    "first plan",
    "taken up again",
    "map changed",
    "operator order",
    "agent lost",
    "agent down",
    "agent unfit",
    "agent not tracked",
    "agent set aside",
    "agent joined",
    "agent idle",
    "agent in danger",
    "agent passed its target",
    "layer occupied",
    "target appeared",
    "target lost",
    "target moved",
    "approved plan changed",
    "upload waited",
]
"""Kinds of replanning triggers."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Assignment with routes, and the triggers of the plan."""

    t_ns: int
    picture_t_ns: int
    routes: tuple[Route, ...]
    """Ordered by vehicle."""
    unassigned_vehicles: tuple[int, ...]
    unassigned_targets: tuple[Label, ...]
    reason: str
    """Triggers in words, for operators."""
    changed: tuple[int, ...] = ()
    """Vehicles whose route changed; only these get a new mission."""
    causes: tuple[Cause, ...] = ()
    """Kinds of the triggers, each once."""
