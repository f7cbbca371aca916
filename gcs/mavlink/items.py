"""A route as ArduPlane mission items, and what its read-back must look like.

Sources: https://mavlink.io/en/services/mission.html, ArduPilot's `AP_Mission` (which item fields it stores,
and in what precision) and what ArduPlane 4.7 was seen to send back.

* Item 0 is always home; the autopilot overwrites it with its own, so it is sent and never compared.
* Every waypoint is a NAV_WAYPOINT; one NAV_LOITER_UNLIM at the last point follows, so that the aircraft first
  flies over the point and then stays: at the end of a mission ArduPlane would return to launch.
* Latitude and longitude are integers of 1e-7 degrees and survive exactly. Height is kept in centimetres, the
  acceptance radius as whole metres up to 255, frame 6 comes back as 3, NaN as 0, autocontinue as 1, and
  NAV_WAYPOINT loses its hold time (param1) and yaw (param4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.codec import Message
from gcs.model import Mission

HOME_ITEMS = 1
"""Items before the first that is flown."""

_GLOBAL = dialect.MAV_FRAME_GLOBAL
_RELATIVE = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT
_SAME_FRAME = {dialect.MAV_FRAME_GLOBAL_INT: _GLOBAL, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: _RELATIVE}
_NAV_WAYPOINT = dialect.MAV_CMD_NAV_WAYPOINT
_NAV_LOITER_UNLIM = dialect.MAV_CMD_NAV_LOITER_UNLIM
_MAX_RADIUS_M = 255
_MIN_RADIUS_M = 1.0
"""Below a metre ArduPlane stores 0, which means its default of 90 m."""
_HEIGHT_TOLERANCE_M = 0.011
_PARAM_TOLERANCE = 1e-3


class Home(NamedTuple):
    """Where a vehicle says that home is."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float


class Item(NamedTuple):
    """One mission item as it is stored; `x` and `y` are latitude and longitude in 1e-7 degrees."""

    command: int
    frame: int
    x: int
    y: int
    z_m: float
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    autocontinue: int = 1

    def message(self, seq: int, target_system: int, target_component: int) -> Message:
        """Return the MISSION_ITEM_INT that carries this item as number `seq`."""
        return dialect.MAVLink_mission_item_int_message(
            target_system,
            target_component,
            seq,
            self.frame,
            self.command,
            0,
            self.autocontinue,
            self.param1,
            self.param2,
            self.param3,
            self.param4,
            self.x,
            self.y,
            self.z_m,
            dialect.MAV_MISSION_TYPE_MISSION,
        )


def item_of(message: Message) -> Item:
    """Return the item that a MISSION_ITEM_INT carries."""
    return Item(
        message.command,
        message.frame,
        message.x,
        message.y,
        message.z,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        message.autocontinue,
    )


def items_of(mission: Mission, home: Home) -> tuple[Item, ...]:
    """Return the items of a mission: home, its waypoints, and the loiter at the last one.

    Raises
    ------
    ValueError
        The mission has no waypoint: there is nothing to fly, and nothing to stay at.
    """
    if not mission.waypoints:
        raise ValueError(f"mission {mission.mission_id} of vehicle {mission.vehicle} has no waypoint")
    items = [Item(_NAV_WAYPOINT, _GLOBAL, _e7(home.lat_deg), _e7(home.lon_deg), round(home.alt_msl_m, 2))]
    items += [
        Item(
            _NAV_WAYPOINT,
            _RELATIVE,
            _e7(point.lat_deg),
            _e7(point.lon_deg),
            round(point.alt_rel_m, 2),
            param2=max(_MIN_RADIUS_M, point.accept_radius_m),
        )
        for point in mission.waypoints
    ]
    last = items[-1]
    radius_m = round(mission.loiter_radius_m)
    items.append(Item(_NAV_LOITER_UNLIM, last.frame, last.x, last.y, last.z_m, param3=radius_m))
    return tuple(items)


def normalised(item: Item) -> Item:
    """Return the item as ArduPlane would store and send it back."""
    param1, param2, param3, param4 = (
        0.0 if math.isnan(value) else value for value in (item.param1, item.param2, item.param3, item.param4)
    )
    if item.command == _NAV_WAYPOINT:
        param1 = param4 = 0.0
        param2 = float(min(_MAX_RADIUS_M, int(param2))) if math.isfinite(param2) else float(_MAX_RADIUS_M)
    frame = _SAME_FRAME.get(item.frame, item.frame)
    return Item(item.command, frame, item.x, item.y, item.z_m, param1, param2, param3, param4, 1)


def first_difference(sent: Sequence[Item], held: Sequence[Item]) -> str:
    """Say where what is held first differs from what was sent; empty when equal. Home is left out."""
    if len(sent) != len(held):
        return f"{len(held)} items instead of {len(sent)}"
    for seq in range(HOME_ITEMS, len(sent)):
        want, got = normalised(sent[seq]), normalised(held[seq])
        for name, wanted, found in zip(Item._fields, want, got, strict=True):
            if abs(wanted - found) > _tolerance(name):
                return f"item {seq}: {name} is {found:.10g} instead of {wanted:.10g}"
            if not math.isfinite(found):
                return f"item {seq}: {name} is {found}"
    return ""


def _tolerance(name: str) -> float:
    if name == "z_m":
        return _HEIGHT_TOLERANCE_M
    return _PARAM_TOLERANCE if name.startswith("param") else 0.0


def _e7(degrees: float) -> int:
    return round(degrees * 1e7)
