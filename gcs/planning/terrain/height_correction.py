"""Heights of a route, corrected for where and how late it is flown.

The flight cuts corners and is late in climbs, so that it may leave the band where the route is inside. Its
places do not depend on the heights of the waypoints, and its heights are linear in them. So the heights with
which it leaves the band least, and are changed least, are the solution of a linear programme. They change by
no more than the vehicle climbs and sinks on each leg, or than before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_array, coo_array, eye_array

from gcs.model import FloatArray, IntArray, read_only
from gcs.planning.terrain.band import FlightBand, Vertical
from gcs.planning.terrain.route import TerrainRoute

_EVERY: Final = 2
"""Places of the flight of which one counts: 8 m apart at 20 m/s. Terrain models are coarser."""
_MOST_OUTSIDE_COST: Final = 1000.0
_OUTSIDE_COST: Final = 10.0
"""Sum of changes, in metres, that a metre outside the band is worth: at the worst place, and at each place. A
flight that begins far outside is so brought inside as well."""


@dataclass(frozen=True, eq=False)
class FlownLegs:
    """Places of a simulated flight, and from where on the route it has its heights.

    Attributes
    ----------
    places_m : ndarray, shape (k, 2)
        East and north.
    legs : ndarray, shape (k,)
        Number of the leg at whose height it is.
    shares : ndarray, shape (k,)
        Part of that leg, from 0 at its begin to 1.
    """

    places_m: FloatArray
    legs: IntArray
    shares: FloatArray

    def heights(self, heights_msl_m: FloatArray) -> FloatArray:
        """Return the heights (k,) of the flight, from those of the points of the route."""
        begin_m = heights_msl_m[self.legs]
        return begin_m + self.shares * (heights_msl_m[self.legs + 1] - begin_m)


def correct_heights(
    band: FlightBand, route: TerrainRoute, flown: FlownLegs, vertical: Vertical
) -> TerrainRoute:
    """Return a route with other heights, so that its flight leaves the band as little as possible.

    The heights of the first point, and of the circle, stay. Returns the same route if there are no others.
    """
    heights_m = route.heights_msl_m
    floor_m, ceiling_m = band.limits_at(flown.places_m[::_EVERY]).T
    is_open = floor_m <= ceiling_m  # where the band is closed, no height is better than another
    if not is_open.any():
        return route
    floor_m = floor_m[is_open]
    ceiling_m = ceiling_m[is_open]
    legs = flown.legs[::_EVERY][is_open]
    shares = flown.shares[::_EVERY][is_open]
    n = len(heights_m)
    k = len(legs)
    at = np.tile(np.arange(k), 2)
    weights = np.concatenate((1.0 - shares, shares)), (at, np.concatenate((legs, legs + 1)))
    flight = coo_array(weights, shape=(k, n))
    outside = eye_array(k)
    most_outside = coo_array(np.ones((k, 1)))
    point = eye_array(n)
    rises = point.tocsr()[1:] - point.tocsr()[:-1]
    # Columns: the heights, how far each place is outside, the most of these, and the change of each height.
    rows = block_array(
        [
            [-flight, -outside, None, None],
            [flight, -outside, None, None],
            [None, outside, -most_outside, None],
            [rises, None, None, None],
            [-rises, None, None, None],
            [point, None, None, -point],
            [-point, None, None, -point],
        ]
    )
    lengths_m = np.hypot(*np.diff(route.points_m, axis=0).T)
    planned_m = np.diff(heights_m)
    climbs_m = np.maximum(vertical.climb_gradient * lengths_m, planned_m)
    sinks_m = np.maximum(vertical.sink_gradient * lengths_m, -planned_m)
    limits = np.concatenate((-floor_m, ceiling_m, np.zeros(k), climbs_m, sinks_m, heights_m, -heights_m))
    costs = np.concatenate((np.zeros(n), np.full(k, _OUTSIDE_COST), [_MOST_OUTSIDE_COST], np.ones(n)))
    least = np.concatenate((np.full(n, -np.inf), np.zeros(k + 1 + n)))
    most = np.full(len(costs), np.inf)
    for end in (0, n - 1):
        least[end] = heights_m[end]
        most[end] = heights_m[end]
    found = linprog(costs, A_ub=rows.tocsr(), b_ub=limits, bounds=np.column_stack((least, most)))
    return replace(route, heights_msl_m=read_only(found.x[:n])) if found.success else route
