"""Who flies where, and the missions that this becomes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from gcs.model.basics import FloatArray, Label

APPROACH_M = 500.0
"""How far before home the last leg of a landing begins."""


@dataclass(frozen=True, slots=True)
class Waypoint:
    """One place to fly to."""

    lat_deg: float
    lon_deg: float
    alt_rel_m: float
    accept_radius_m: float


@dataclass(frozen=True, slots=True)
class Mission:
    """Waypoints for one vehicle, home excluded."""

    mission_id: int
    vehicle: int
    waypoints: tuple[Waypoint, ...]
    loiter_radius_m: float = 0.0
    """Of the circle at the last waypoint; 0 leaves it to the autopilot."""
    end: Literal["loiter", "land"] = "loiter"
    """Circle at the last waypoint, or go home from there and land."""
    wait_deg: tuple[float, float] | None = None
    """Latitude and longitude of the circle, when it is not round the last waypoint."""
    takeoff: Waypoint | None = None
    """Where the climb along the runway ends, of a mission from the ground; None: at the first waypoint."""
    homeward: tuple[Waypoint, ...] = ()
    """Corners of the way home, the last of them where its approach begins; none: straight."""


@dataclass(frozen=True, slots=True)
class Route:
    """A way for one vehicle to one target."""

    vehicle: int
    target: Label
    points_m: FloatArray
    """(k, 2) east/north, the vehicle's position excluded, the target's included."""
    length_m: float
    """From the vehicle's position along the points."""
    lane: int = 0
    """Altitude lane, from 0, the lowest (see `gcs.planning.deconfliction`)."""
    wait_m: tuple[float, float] | None = None
    """East and north of the circle that it goes on to afterwards; None: round the last point."""

    @property
    def flown_m(self) -> FloatArray:
        """(k, 2): `points_m`, and the centre of a circle that it goes on to."""
        return self.points_m if self.wait_m is None else np.vstack((self.points_m, self.wait_m))


Cause: TypeAlias = Literal[
    "first plan",
    "taken up again",
    "map changed",
    "agent lost",
    "agent not tracked",
    "agent set aside",
    "agent joined",
    "agent idle",
    "agent in danger",
    "agent passed its target",
    "target appeared",
    "target lost",
    "target moved",
    "approved plan changed",
]
"""Why a plan was made, in kinds: what pictures and counts go by."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Who flies where, and why this was decided."""

    t_ns: int
    picture_t_ns: int
    routes: tuple[Route, ...]
    """Ordered by vehicle."""
    unassigned_vehicles: tuple[int, ...]
    unassigned_targets: tuple[Label, ...]
    reason: str
    """In words, for an operator."""
    changed: tuple[int, ...] = ()
    """Vehicles whose route differs from what they fly now: only these get a new mission."""
    causes: tuple[Cause, ...] = ()
    """Kinds of what `reason` says, each once; recordings of earlier versions have none."""
