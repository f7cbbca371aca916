"""Mission items of a mission, as a firmware flies them, with the radius and the side of circles.

Items in order::

    [home]  [take-off]  waypoint ... waypoint  end

* home: ArduPilot keeps item 0 for its home. It overwrites what is sent; the item is not compared.
* take-off: if the vehicle is on the ground. Its position is the end of the climb along the runway: ArduPlane
  ignores it and holds the runway's heading, PX4 flies towards it.
* end: an unlimited loiter at the last waypoint ("loiter"), since a fixed wing without items would return or
  circle off the planned route; or the waypoints of the return route, an approach and a landing ("land"),
  maybe with a timed loiter before.

Source: https://mavlink.io/en/services/mission.html and MAV_CMD in
https://mavlink.io/en/messages/common.html.
"""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.profile import AutopilotProfile
from gcs.mavlink.mission.items import Home, Item
from gcs.model import APPROACH_M, HeightReference, Mission, Waypoint

_WAYPOINT: Final = dialect.MAV_CMD_NAV_WAYPOINT
_FRAMES: Final[dict[HeightReference, int]] = {
    "home": dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    "msl": dialect.MAV_FRAME_GLOBAL,
}
APPROACH_ALT_M: Final = 30.0
"""Height where the approach begins: a glide slope of 3.4 degrees, below PX4's limit of 5 (FW_LND_ANG)."""
_EARTH_M_PER_DEG: Final = 111_195.0
DESCENT_SLOPE: Final = 0.15
"""Slope from the layer to the approach: half of what both autopilots fly."""
_MIN_LEVEL_SHARE: Final = 0.05
_TOWARDS_NEXT: Final = 1.0
"""A timed loiter ends where the course leads to the next item. ArduPlane always does so, PX4 if told."""


def build_items(
    profile: AutopilotProfile, mission: Mission, home: Home, *, from_ground: bool = False
) -> tuple[Item, ...]:
    """Return the items of a mission.

    Raises
    ------
    ValueError
        The mission has no waypoint.
    """
    if not mission.waypoints:
        raise ValueError(f"mission {mission.mission_id} of vehicle {mission.vehicle} has no waypoint")
    at_home = _e7(home.lat_deg), _e7(home.lon_deg)
    home_item = Item(_WAYPOINT, dialect.MAV_FRAME_GLOBAL, *at_home, round(home.alt_msl_m, 2))
    items = [home_item] * profile.home_items
    flown = [_waypoint(profile, point) for point in mission.waypoints]
    if from_ground:
        pitch = profile.takeoff_pitch_deg
        takeoff = dialect.MAV_CMD_NAV_TAKEOFF
        climbed = flown[0] if mission.takeoff is None else _waypoint(profile, mission.takeoff)
        items.append(climbed._replace(command=takeoff, param1=pitch, param2=0.0))
    items += flown
    if mission.end == "land":
        landing = _landing(flown[-1], [_waypoint(profile, point) for point in mission.return_waypoints], home)
        wait = mission.landing_wait
        if wait is not None:
            end = flown[-1] if mission.wait is None else _waypoint(profile, mission.wait)
            at = (end, *landing)[wait.corner + 1]
            timed = dialect.MAV_CMD_NAV_LOITER_TIME
            radius_m = float(round(mission.loiter_radius_m))
            seconds = float(wait.seconds)
            circle = at._replace(command=timed, param1=seconds, param2=_TOWARDS_NEXT, param3=radius_m)
            landing.insert(wait.corner + 1, circle)
        items += landing
    else:
        unlimited = dialect.MAV_CMD_NAV_LOITER_UNLIM
        radius_m = round(mission.loiter_radius_m)
        centre = flown[-1] if mission.wait is None else _waypoint(profile, mission.wait)
        items.append(centre._replace(command=unlimited, param2=0.0, param3=float(radius_m)))
    return tuple(items)


def first_flown_item(
    profile: AutopilotProfile, points_passed: int, *, from_ground: bool, still_on_ground: bool
) -> int:
    """Return the first item for a vehicle that has passed the first points of its route."""
    if from_ground and still_on_ground:
        return profile.home_items
    return profile.home_items + int(from_ground) + points_passed


def _waypoint(profile: AutopilotProfile, point: Waypoint) -> Item:
    return Item(
        _WAYPOINT,
        _FRAMES[point.reference],
        _e7(point.lat_deg),
        _e7(point.lon_deg),
        round(point.alt_m, 2),
        param2=max(profile.min_radius_m, point.accept_radius_m),
        param4=profile.unused,
    )


def _landing(last: Item, return_items: list[Item], home: Home) -> list[Item]:
    """Return the return route, approach and landing; a straight line if there is no return route."""
    *corners, approach = return_items or [_straight_approach(last, home)]
    is_descent_planned = bool(corners) and approach.z_m < corners[-1].z_m  # over terrain
    height_m = APPROACH_ALT_M if is_descent_planned else min(_height_rel_m(last, home), APPROACH_ALT_M)
    approach = approach._replace(frame=_FRAMES["home"], z_m=height_m)
    if not is_descent_planned:
        corners += _top_of_descent(corners[-1] if corners else last, approach, home)
    touch_down = approach._replace(
        command=dialect.MAV_CMD_NAV_LAND, x=_e7(home.lat_deg), y=_e7(home.lon_deg), z_m=0.0, param2=0.0
    )
    return [*corners, approach, touch_down]


def _top_of_descent(before: Item, approach: Item, home: Home) -> list[Item]:
    """Return the point up to which the vehicle stays in its layer; none if the last leg is too short.

    Both autopilots would lose height from the target on, through the layers of others.
    """
    metres_east = _EARTH_M_PER_DEG * math.cos(math.radians(home.lat_deg))
    north_m = (before.x - approach.x) * 1e-7 * _EARTH_M_PER_DEG
    east_m = (before.y - approach.y) * 1e-7 * metres_east
    height_m = _height_rel_m(before, home)
    share = (height_m - approach.z_m) / DESCENT_SLOPE / max(math.hypot(north_m, east_m), 1.0)
    if not 0.0 < share < 1.0 - _MIN_LEVEL_SHARE:
        return []
    x, y = (
        round(low + share * (high - low)) for low, high in ((approach.x, before.x), (approach.y, before.y))
    )
    return [approach._replace(x=x, y=y, z_m=height_m)]


def _height_rel_m(item: Item, home: Home) -> float:
    """Return the height of an item above home."""
    return item.z_m - (home.alt_msl_m if item.frame == _FRAMES["msl"] else 0.0)


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


def _e7(degrees: float) -> int:
    return round(degrees * 1e7)
