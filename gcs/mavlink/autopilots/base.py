"""What an autopilot profile says, and what follows from it for every firmware alike.

A mission's items, in order::

    [home]  [take-off]  waypoint ... waypoint  end

* home: ArduPilot keeps item 0 for its own home; whatever is sent there is overwritten, never compared.
* take-off: when the vehicle stands on the ground. Its place is the end of the climb along the runway:
  ArduPlane ignores it and holds the runway's heading, PX4 flies towards it.
* end: an unlimited loiter at the last waypoint ("loiter"), since a fixed wing that runs out of items would
  return or circle where nobody planned; or the corners of the way home, an approach and a landing ("land").

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
"""3.4 degrees of glide: below PX4's limit of 5 (FW_LND_ANG)."""
_EARTH_M_PER_DEG: Final = 111_195.0
_GROUND_M: Final = 10.0
_GROUND_SPEED_M_S: Final = 3.0
_NO_BOUND: Final = 2**24


@dataclass(frozen=True, slots=True)
class WantedParameter:
    """A parameter that a pre-flight check looks at."""

    names: tuple[str, ...]
    """What it is called, newest firmware first."""
    low: float
    high: float
    """Wanted: low <= value <= high."""
    why: str
    """What goes wrong otherwise."""
    must: bool = True
    """Whether it is refused, or only told."""
    older: WantedParameter | None = None
    """What older firmware has instead, with another name, unit or meaning."""
    allowed: tuple[float, ...] = ()
    """The only values between `low` and `high` that are wanted; empty: all."""
    meanings: Mapping[float, str] = field(default_factory=dict)
    """What a value that is wanted brings about, where a pilot must know."""

    def accepts(self, value: float) -> bool:
        """Return True if a value is wanted."""
        return self.low <= value <= self.high and (not self.allowed or value in self.allowed)

    @property
    def wanted(self) -> str:
        """The values that are wanted, in words."""
        if self.allowed:
            return " or ".join(f"{value:.6g}" for value in self.allowed)
        low, high = f"{self.low:.6g}", f"{self.high:.6g}"
        if self.high >= _NO_BOUND:
            return f"{low} and above"
        return low if low == high else f"{low} ... {high}"

    @property
    def all_names(self) -> tuple[str, ...]:
        """Every name to ask for."""
        return self.names + (() if self.older is None else self.older.all_names)

    def found(self, values: Mapping[str, float]) -> tuple[WantedParameter, str] | None:
        """Return the wish and the name by which a vehicle has it; None when it has neither."""
        name = next((name for name in self.names if name in values), None)
        if name is not None:
            return self, name
        return None if self.older is None else self.older.found(values)


@dataclass(frozen=True, slots=True)
class Envelope:
    """What a mission asks of its vehicles."""

    speed_m_s: float
    bank_deg: float
    lands: bool = False
    """True if missions end in a landing."""


@dataclass(frozen=True, slots=True)
class FenceLimits:
    """What a vehicle's parameters make of its fence."""

    is_on: bool
    polygons: bool
    """Whether uploaded areas count."""
    max_alt_rel_m: float | None = None
    max_radius_m: float | None = None
    """Around home."""


@dataclass(frozen=True, slots=True)
class AutopilotProfile:
    """One firmware's table."""

    name: str
    autopilot: int
    """MAV_AUTOPILOT."""
    home_items: int
    """Items before the first that is flown."""
    atomic: bool
    """Whether an upload replaces the old mission as a whole, at its end; otherwise item by item, in place."""
    window: int
    """Items of a mission that may be on their way at a time: sent without a request after a silence, or asked
    for in a read-back."""
    in_order: bool
    """True if a read-back must ask for one item after the other, and an upload's last item must have been
    asked for."""
    tracks_old_leg: bool
    """True if a leg may start at the waypoint that was flown to before, not where the vehicle is."""
    marks_current: bool
    """Whether `current` on an uploaded item makes the mission begin there."""
    ends_in: str
    """Mode after a mission's last item, when that item ends."""
    unused: float
    """For parameters without a meaning: NaN or 0."""
    min_radius_m: float
    """Acceptance radius below which the autopilot would take its own default."""
    takeoff_pitch_deg: float
    modes: Mapping[tuple[int, int], str]
    """Name by (main, sub) mode, as in parameters 2 and 3 of DO_SET_MODE."""
    split_mode: Callable[[int], tuple[int, int]]
    """A heartbeat's custom_mode as (main, sub)."""
    stored: Callable[[Item], Item]
    """What the firmware keeps of an item, apart from what `normalised` does for all."""
    parameters: tuple[WantedParameter, ...]
    fits: Callable[[Envelope], tuple[WantedParameter, ...]]
    """Parameters that must fit what the mission asks."""
    fence_parameters: tuple[str, ...]
    """What `fence_limits` reads."""
    fence_limits: Callable[[Mapping[str, float]], FenceLimits]
    ceiling_parameter: str
    """Where a fence's greatest height is kept, in metres above home."""
    return_heights: Callable[[Mapping[str, float], Sequence[float]], Mapping[str, float]]
    """Heights above home, in metres, at which it may return: by what sets them, from its parameters and the
    heights of its rally points."""

    # ------------------------------------------------------------ modes

    def mode_name(self, custom_mode: int) -> str:
        """Name of a heartbeat's mode."""
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
            The mission has no waypoint: there is nothing to fly, and nothing to stay at.
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
            items += self._landing(flown[-1], [self._waypoint(point) for point in mission.homeward], home)
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

    def _landing(self, last: Item, homeward: list[Item], home: Home) -> list[Item]:
        """Return the way home, its approach and a landing; without a way straight from the last waypoint."""
        *corners, approach = homeward or [self._straight_approach(last, home)]
        approach = approach._replace(z_m=min(last.z_m, _APPROACH_ALT_M))
        touch_down = approach._replace(
            command=dialect.MAV_CMD_NAV_LAND, x=_e7(home.lat_deg), y=_e7(home.lon_deg), z_m=0.0, param2=0.0
        )
        return [*corners, approach, touch_down]

    @staticmethod
    def _straight_approach(last: Item, home: Home) -> Item:
        """Return the place on the straight line from the last waypoint where an approach begins."""
        metres_east = _EARTH_M_PER_DEG * math.cos(math.radians(home.lat_deg))
        north_m = (last.x * 1e-7 - home.lat_deg) * _EARTH_M_PER_DEG
        east_m = (last.y * 1e-7 - home.lon_deg) * metres_east
        scale = APPROACH_M / max(math.hypot(east_m, north_m), 1.0)
        return last._replace(
            x=_e7(home.lat_deg + scale * north_m / _EARTH_M_PER_DEG),
            y=_e7(home.lon_deg + scale * east_m / metres_east),
        )

    def first_flown(self, points_passed: int, *, from_ground: bool, still_on_ground: bool) -> int:
        """Item to begin with, for a vehicle that has passed the first points of its route."""
        if from_ground and still_on_ground:
            return self.home_items
        return self.home_items + int(from_ground) + points_passed

    def normalised(self, item: Item) -> Item:
        """Return the item as the autopilot would store and send it back.

        The frames of MISSION_ITEM_INT and of MISSION_ITEM mean the same; a parameter that is not there is
        NaN or 0; `autocontinue` is not kept.
        """
        params = (item.param1, item.param2, item.param3, item.param4)
        param1, param2, param3, param4 = (0.0 if math.isnan(value) else value for value in params)
        frame = _SAME_FRAME.get(item.frame, item.frame)
        return self.stored(
            Item(item.command, frame, item.x, item.y, item.z_m, param1, param2, param3, param4, 1)
        )

    def difference(self, sent: Sequence[Item], held: Sequence[Item]) -> str:
        """Say where what is held first differs from what was sent; empty when equal. Home is left out."""
        return first_item_difference(sent, held, self.normalised, self.home_items)


def is_on_ground(state: VehicleState | None, home: Home | None) -> bool:
    """Whether a vehicle stands on the ground, as far as it has told: disarmed, or slow and low."""
    if state is None or not state.mode:
        return False
    if not state.armed:
        return True
    low = home is not None and state.alt_msl_m - home.alt_msl_m < _GROUND_M
    return low and state.ground_speed_m_s < _GROUND_SPEED_M_S


def _e7(degrees: float) -> int:
    return round(degrees * 1e7)
