"""Heights that autopilots fly between the points of a mission.

ArduPlane changes its height linearly from one waypoint to the next (`setup_alt_slope`; with ALT_SLOPE_MIN 1,
else changes of less than 15 m are flown at once). PX4 does so too, but ends the change where the acceptance
radius, or the default loiter radius, begins (`control_auto_position`). A circle has the height of its centre.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from gcs.model import FloatArray, IntArray

EARLY_M: Final = 80.0
"""Distance before a waypoint at which PX4 has its height: NAV_LOITER_RAD's default, if legs are longer."""


def lowest_heights_m(
    places_m: FloatArray, parts: IntArray, points_m: FloatArray, heights_m: FloatArray
) -> FloatArray:
    """Return the lowest height that either firmware flies at places along a mission.

    Parameters
    ----------
    places_m : ndarray, shape (k, 2)
        East and north, in the order in which they are flown.
    parts : ndarray of int, shape (k,)
        Index of the point that the vehicle flies to at each place, or whose circle it flies.
    points_m : ndarray, shape (n + 1, 2)
        Begin of the flight, then the points.
    heights_m : ndarray, shape (n + 1,)
        Height of the begin, then of the points.

    Returns
    -------
    ndarray, shape (k,)
    """
    begins_m = points_m[parts]
    legs_m = points_m[parts + 1] - begins_m
    lengths_m = np.hypot(*legs_m.T)
    along_m = np.einsum("ij,ij->i", places_m - begins_m, legs_m) / np.maximum(lengths_m, 1e-9)
    changes_m = heights_m[parts + 1] - heights_m[parts]
    linear = np.clip(along_m / np.maximum(lengths_m, 1e-9), 0.0, 1.0)
    early = np.clip(along_m / np.maximum(lengths_m - EARLY_M, 1e-9), 0.0, 1.0)
    share = np.where(changes_m > 0.0, linear, early)
    return heights_m[parts] + share * changes_m
