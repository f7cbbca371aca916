"""First waypoint of a route for a vehicle that would otherwise climb in a circle.

PX4 that goes from Hold to its mission climbs in a circle where it is, to the height of its first waypoint, if
that is higher by NAV_FW_ALT_RAD, 10 m by default (`MissionBase::checkClimbRequired`). Over terrain that
circle is not part of the route, and leads above the ceiling where the first leg rises with the ground.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from gcs.model import read_only
from gcs.planning.terrain.route import TerrainRoute

_RISE_M: Final = 5.0
"""Greatest height of the first waypoint above the vehicle: its own height may change as much."""


def with_low_first_point(route: TerrainRoute, height_msl_m: float) -> TerrainRoute:
    """Return the route with a waypoint on its first leg that is little higher than its vehicle.

    A vehicle that is below the begin of the route must climb first: its route stays.
    """
    begin_m, first_m = route.heights_msl_m[:2].tolist()
    rise_m = first_m - height_msl_m
    if rise_m <= _RISE_M or begin_m > height_msl_m + _RISE_M:
        return route
    share = (height_msl_m + _RISE_M - begin_m) / (first_m - begin_m)
    place = route.points_m[0] + share * (route.points_m[1] - route.points_m[0])
    return replace(
        route,
        points_m=read_only(np.insert(route.points_m, 1, place, axis=0)),
        heights_msl_m=read_only(np.insert(route.heights_msl_m, 1, height_msl_m + _RISE_M)),
    )
