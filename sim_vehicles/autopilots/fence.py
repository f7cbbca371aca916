"""Simulated fence and rally points: breaches, and what the vehicle does then.

ArduPlane with FENCE_ACTION 1: a breach of an enabled fence changes the mode to RTL, once, with a text.
Simulated kinds (FENCE_TYPE): greatest height (bit 0), circle round home (bit 1), uploaded areas (bit 2). PX4
always watches GF_MAX_VER_DIST, GF_MAX_HOR_DIST and uploaded areas; GF_ACTION sets the reaction (2 Hold, 3
return). RTL goes to the nearest rally point within RALLY_LIMIT_KM, or home if there is none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gcs.fence import Area
from gcs.mavlink.mission.geofence_rally import fence_from_items
from gcs.mavlink.mission.items import Item as MissionItem
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.autopilots.mission_protocol import FENCE, RALLY, Item, MissionStore
from sim_vehicles.autopilots.parameters import Parameters
from sim_vehicles.vehicle.geodesy import Geodesy

_PX4_REACTIONS = {2: Mode.LOITER, 3: Mode.RTL}
_PX4_TEXTS = {
    "Max Alt": "Geofence: exceeding maximum altitude above Home",
    "Circle": "Geofence: exceeding maximum distance from Home",
    "Polygon": "Geofence: approaching or outside geofence",
}
_RTL = 1
_HEIGHT = 1
_CIRCLE = 2
_AREAS = 4


class FenceGuard:
    """Fence and rally points of the autopilot, and their breaches."""

    def __init__(self, parameters: Parameters, geodesy: Geodesy, px4: bool = False) -> None:
        self._px4 = px4
        self.stores = {FENCE: MissionStore(FENCE), RALLY: MissionStore(RALLY)}
        self._parameters = parameters
        self._geodesy = geodesy
        self._items: tuple[Item, ...] = ()
        self._areas: tuple[Area, ...] = ()
        self._breached = ""
        self.ceiling_m: float | None = None
        """Above home, of a ceiling that was lowered; None for the fence as it is set."""

    @property
    def is_enabled(self) -> bool:
        """True if the fence is watched."""
        return self._px4 or self.ceiling_m is not None or bool(self._parameters["FENCE_ENABLE"])

    @property
    def is_breached(self) -> bool:
        """True if the vehicle was beyond its enabled fence at the last check."""
        return bool(self._breached)

    def check(self, place_m: tuple[float, float], home_m: tuple[float, float], alt_m: float) -> str:
        """Return the notice about the fence, if any."""
        kind = self.breach(place_m, home_m, alt_m)
        was = self._breached
        self._breached = kind
        if kind and not was:
            return _PX4_TEXTS[kind] if self._px4 else f"{kind} fence breached"
        return "Fence breach cleared" if was and not kind and not self._px4 else ""

    @property
    def reaction(self) -> Mode | None:
        """Mode after a breach; None for no change."""
        if self._px4:
            return _PX4_REACTIONS.get(int(self._parameters["GF_ACTION"]))
        return Mode.RTL if int(self._parameters["FENCE_ACTION"]) == _RTL else None

    def breach(self, place_m: tuple[float, float], home_m: tuple[float, float], alt_m: float) -> str:
        """Return the kind of fence that is breached; empty if none is, or the fence is off.

        `alt_m` is above home.
        """
        parameters = self._parameters
        if self.ceiling_m is not None and alt_m > self.ceiling_m:
            return "Max Alt"
        if self._px4:
            return self._px4_breach(place_m, home_m, alt_m)
        if not self.is_enabled:
            return ""
        kinds = int(parameters["FENCE_TYPE"])
        if kinds & _HEIGHT and alt_m > parameters["FENCE_ALT_MAX"]:
            return "Max Alt"
        if kinds & _CIRCLE and math.dist(place_m, home_m) > parameters["FENCE_RADIUS"]:
            return "Circle"
        return "Polygon" if kinds & _AREAS and self._is_beyond(place_m) else ""

    def _px4_breach(self, place_m: tuple[float, float], home_m: tuple[float, float], alt_m: float) -> str:
        ceiling_m, radius_m = (self._parameters[f"GF_MAX_{axis}_DIST"] for axis in ("VER", "HOR"))
        if 0.0 < ceiling_m < alt_m:
            return "Max Alt"
        if 0.0 < radius_m < math.dist(place_m, home_m):
            return "Circle"
        return "Polygon" if self._is_beyond(place_m) else ""

    def _is_beyond(self, place_m: tuple[float, float]) -> bool:
        items = tuple(self.stores[FENCE])
        if items != self._items:
            self._items = items
            held = fence_from_items([MissionItem(i.command, i.frame, i.x, i.y, i.z, i.param1) for i in items])
            self._areas = () if held is None else held.areas
        point = np.array([place_m])
        frame = self._geodesy.frame
        return any(bool(area.contains(point, frame)[0]) != area.stay_in for area in self._areas)

    def return_point(self, place_m: tuple[float, float]) -> tuple[float, float, float] | None:
        """Return the rally point for RTL: east, north, height above home; None for home."""
        points = [(*self._geodesy.to_local(i.x * 1e-7, i.y * 1e-7), i.z) for i in self.stores[RALLY]]
        return _nearest(points, place_m, 1000.0 * self._parameters["RALLY_LIMIT_KM"])


def _nearest(
    points: Sequence[tuple[float, float, float]], place_m: tuple[float, float], limit_m: float
) -> tuple[float, float, float] | None:
    near = min(points, key=lambda point: math.dist(point[:2], place_m), default=None)
    if near is None or (limit_m > 0.0 and math.dist(near[:2], place_m) > limit_m):
        return None
    return near
