"""Fields of an autopilot profile, and the items of a mission.

Items of a mission, in order::

    [home]  [take-off]  waypoint ... waypoint  end

* home: ArduPilot keeps item 0 for its home. It overwrites what is sent; the item is not compared.
* take-off: if the vehicle is on the ground. Its position is the end of the climb along the runway: ArduPlane
  ignores it and holds the runway's heading, PX4 flies towards it.
* end: an unlimited loiter at the last waypoint ("loiter"), since a fixed wing without items would return or
  circle off the planned route; or the waypoints of the return route, an approach and a landing ("land").

Source: https://mavlink.io/en/services/mission.html and MAV_CMD in
https://mavlink.io/en/messages/common.html.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.mission.items import Home, Item, first_item_difference
from gcs.model import APPROACH_M, Mission, VehicleState, Waypoint

_WAYPOINT: Final = dialect.MAV_CMD_NAV_WAYPOINT
_GLOBAL: Final = dialect.MAV_FRAME_GLOBAL
_RELATIVE: Final = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT
_SAME_FRAME: Final = {
    dialect.MAV_FRAME_GLOBAL_INT: _GLOBAL,
    dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: _RELATIVE,
}
_APPROACH_ALT_M: Final = 30.0
"""Glide slope of 3.4 degrees: below PX4's limit of 5 (FW_LND_ANG)."""
_EARTH_M_PER_DEG: Final = 111_195.0
_GROUND_M: Final = 10.0
_GROUND_SPEED_M_S: Final = 3.0
_NO_BOUND: Final = 2**24


@dataclass(frozen=True, slots=True)
class WantedParameter:
    """A parameter and its required range, for the preflight check."""

    names: tuple[str, ...]
    """Names, newest firmware first."""
    low: float
    high: float
    """Required: low <= value <= high."""
    why: str
    """Consequence of a value out of range."""
    must: bool = True
    """True if a wrong value fails the preflight check; else it is a warning."""
    older: WantedParameter | None = None
    """Parameter of older firmware with another name, unit or meaning."""
    allowed: tuple[float, ...] = ()
    """The only allowed values between `low` and `high`; empty for all."""
    meanings: Mapping[float, str] = field(default_factory=dict)
    """Effect of a value, where a pilot must know it."""

    def accepts(self, value: float) -> bool:
        """Return True if a value is allowed."""
        return self.low <= value <= self.high and (not self.allowed or value in self.allowed)

    @property
    def wanted(self) -> str:
        """Required values as text."""
        if self.allowed:
            return " or ".join(f"{value:.6g}" for value in self.allowed)
        low, high = f"{self.low:.6g}", f"{self.high:.6g}"
        if self.high >= _NO_BOUND:
            return f"{low} and above"
        return low if low == high else f"{low} ... {high}"

    @property
    def all_names(self) -> tuple[str, ...]:
        """All names to read."""
        return self.names + (() if self.older is None else self.older.all_names)

    def found(self, values: Mapping[str, float]) -> tuple[WantedParameter, str] | None:
        """Return the parameter and its name on a vehicle; None if the vehicle has neither."""
        name = next((name for name in self.names if name in values), None)
        if name is not None:
            return self, name
        return None if self.older is None else self.older.found(values)


@dataclass(frozen=True, slots=True)
class Envelope:
    """Performance that a mission requires of its vehicles."""

    speed_m_s: float
    bank_deg: float
    lands: bool = False
    """True if missions end in a landing."""


@dataclass(frozen=True, slots=True)
class FenceLimits:
    """Fence settings by a vehicle's parameters."""

    is_on: bool
    polygons: bool
    """True if uploaded polygons and circles are active."""
    max_alt_rel_m: float | None = None
    max_radius_m: float | None = None
    """Around home."""


@dataclass(frozen=True, slots=True)
class AutopilotProfile:
    """Table of one firmware."""

    name: str
    autopilot: int
    """MAV_AUTOPILOT."""
    home_items: int
    """Items before the first that is flown."""
    atomic: bool
    """True if an upload replaces the old mission as a whole, at its end; False if item by item, in place."""
    window: int
    """Items in flight at a time: sent without a request after a timeout, or requested in a download."""
    in_order: bool
    """True if a download must request items in order, and an upload's last item must have been requested."""
    tracks_old_leg: bool
    """True if a leg may start at the waypoint before, not at the vehicle."""
    marks_current: bool
    """True if `current` on an uploaded item makes the mission begin there."""
    ends_in: str
    """Mode after a mission's last item, if that item ends."""
    unused: float
    """Value of unused parameters: NaN or 0."""
    min_radius_m: float
    """Acceptance radius below which the autopilot uses its default."""
    takeoff_pitch_deg: float
    modes: Mapping[tuple[int, int], str]
    """Name by (main, sub) mode, as in parameters 2 and 3 of DO_SET_MODE."""
    split_mode: Callable[[int], tuple[int, int]]
    """Returns a heartbeat's custom_mode as (main, sub)."""
    stored: Callable[[Item], Item]
    """Returns the item as the firmware keeps it, in addition to `normalised`."""
    parameters: tuple[WantedParameter, ...]
    fits: Callable[[Envelope], tuple[WantedParameter, ...]]
    """Returns the parameters that must fit the mission."""
    fence_parameters: tuple[str, ...]
    """Parameters that `fence_limits` reads."""
    fence_limits: Callable[[Mapping[str, float]], FenceLimits]
    ceiling_parameter: str
    """Parameter of a fence's greatest height, in metres above home."""
    return_heights: Callable[[Mapping[str, float], Sequence[float]], Mapping[str, float]]
    """Returns the possible return heights above home in metres, by what sets them, from parameters and the
    heights of rally points."""

    # ------------------------------------------------------------ modes

    def mode_name(self, custom_mode: int) -> str:
        """Return the name of a heartbeat's mode."""
        main, sub = self.split_mode(custom_mode)
        return self.modes.get((main, sub)) or self.modes.get((main, 0)) or f"MODE({custom_mode})"

    def mode_numbers(self, name: str) -> tuple[int, int]:
        """Return (main, sub) for parameters 2 and 3 of MAV_CMD_DO_SET_MODE.

        Raises
        ------
        KeyError
            The autopilot has no such mode.
        """
        for numbers, known in self.modes.items():
            if known == name:
                return numbers
        raise KeyError(name)

    # ------------------------------------------------------------ missions

    def items(self, mission: Mission, home: Home, *, from_ground: bool = False) -> tuple[Item, ...]:
        """Return the items of a mission.

        Raises
        ------
        ValueError
            The mission has no waypoint.
        """
        if not mission.waypoints:
            raise ValueError(f"mission {mission.mission_id} of vehicle {mission.vehicle} has no waypoint")
        at_home = _e7(home.lat_deg), _e7(home.lon_deg)
        items = [Item(_WAYPOINT, _GLOBAL, *at_home, round(home.alt_msl_m, 2))] * self.home_items
        flown = [self._waypoint(point) for point in mission.waypoints]
        if from_ground:
            pitch, takeoff = self.takeoff_pitch_deg, dialect.MAV_CMD_NAV_TAKEOFF
            climbed = flown[0] if mission.takeoff is None else self._waypoint(mission.takeoff)
            items.append(climbed._replace(command=takeoff, param1=pitch, param2=0.0))
        items += flown
        if mission.end == "land":
            items += self._landing(
                flown[-1], [self._waypoint(point) for point in mission.return_waypoints], home
            )
        else:
            unlimited, radius_m = dialect.MAV_CMD_NAV_LOITER_UNLIM, round(mission.loiter_radius_m)
            circle = flown[-1]._replace(command=unlimited, param2=0.0, param3=float(radius_m))
            if mission.wait_deg is not None:
                circle = circle._replace(x=_e7(mission.wait_deg[0]), y=_e7(mission.wait_deg[1]))
            items.append(circle)
        return tuple(items)

    def _waypoint(self, point: Waypoint) -> Item:
        return Item(
            _WAYPOINT,
            _RELATIVE,
            _e7(point.lat_deg),
            _e7(point.lon_deg),
            round(point.alt_rel_m, 2),
            param2=max(self.min_radius_m, point.accept_radius_m),
            param4=self.unused,
        )

    def _landing(self, last: Item, return_items: list[Item], home: Home) -> list[Item]:
        """Return the return route, approach and landing; a straight line if there is no return route."""
        *corners, approach = return_items or [self._straight_approach(last, home)]
        approach = approach._replace(z_m=min(last.z_m, _APPROACH_ALT_M))
        touch_down = approach._replace(
            command=dialect.MAV_CMD_NAV_LAND, x=_e7(home.lat_deg), y=_e7(home.lon_deg), z_m=0.0, param2=0.0
        )
        return [*corners, approach, touch_down]

    @staticmethod
    def _straight_approach(last: Item, home: Home) -> Item:
        """Return the start of the approach on the straight line from the last waypoint."""
        metres_east = _EARTH_M_PER_DEG * math.cos(math.radians(home.lat_deg))
        north_m = (last.x * 1e-7 - home.lat_deg) * _EARTH_M_PER_DEG
        east_m = (last.y * 1e-7 - home.lon_deg) * metres_east
        scale = APPROACH_M / max(math.hypot(east_m, north_m), 1.0)
        return last._replace(
            x=_e7(home.lat_deg + scale * north_m / _EARTH_M_PER_DEG),
            y=_e7(home.lon_deg + scale * east_m / metres_east),
        )

    def first_flown(self, points_passed: int, *, from_ground: bool, still_on_ground: bool) -> int:
        """Return the first item for a vehicle that has passed the first points of its route."""
        if from_ground and still_on_ground:
            return self.home_items
        return self.home_items + int(from_ground) + points_passed

    def normalised(self, item: Item) -> Item:
        """Return the item as the autopilot stores and returns it.

        Frames of MISSION_ITEM_INT and MISSION_ITEM are equivalent. A missing parameter is NaN or 0.
        `autocontinue` is not kept.
        """
        params = (item.param1, item.param2, item.param3, item.param4)
        param1, param2, param3, param4 = (0.0 if math.isnan(value) else value for value in params)
        frame = _SAME_FRAME.get(item.frame, item.frame)
        return self.stored(
            Item(item.command, frame, item.x, item.y, item.z_m, param1, param2, param3, param4, 1)
        )

    def difference(self, sent: Sequence[Item], held: Sequence[Item]) -> str:
        """Return the first difference between sent and stored items, without home; empty if equal."""
        return first_item_difference(sent, held, self.normalised, self.home_items)


def is_on_ground(state: VehicleState | None, home: Home | None) -> bool:
    """Return True if a vehicle is on the ground as far as known: disarmed, or slow and low."""
    if state is None or not state.mode:
        return False
    if not state.armed:
        return True
    low = home is not None and state.alt_msl_m - home.alt_msl_m < _GROUND_M
    return low and state.ground_speed_m_s < _GROUND_SPEED_M_S


def _e7(degrees: float) -> int:
    return round(degrees * 1e7)
