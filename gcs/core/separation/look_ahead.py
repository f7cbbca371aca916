"""Encounters: pairs of predicted flights that will come too near to each other, and how far ahead.

Two flights are too near where their horizontal distance is below a minimum that grows with the time ahead,
and their bands of height are nearer than another minimum. Pairs whose bounding boxes are apart are left out
first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.core.separation.forward_flight import STEP_S, FlightPaths
from gcs.model import IntArray

LOOK_AHEAD_S: Final = 25.0
"""Time ahead for which flights are predicted."""
GROWTH_M_S: Final = 1.0
"""Growth of the minimum distance with the time ahead: predictions get worse."""


@dataclass(frozen=True, slots=True)
class Encounter:
    """Predicted loss of separation of two vehicles."""

    vehicles: tuple[int, int]
    """The lower number first."""
    after_s: float
    """Time until it begins."""
    distance_m: float
    """Least horizontal distance while they are too near in height."""
    height_m: float
    """Difference in height there."""
    place_m: tuple[float, float, float]
    """East, north and height above sea level where it begins, between both."""


def encounters(
    paths: FlightPaths,
    min_distance_m: float,
    min_height_m: float,
    growth_m_s: float = GROWTH_M_S,
    step_s: float = STEP_S,
) -> list[Encounter]:
    """Return the encounters of all pairs, those of lower vehicles first."""
    if len(paths.vehicles) < 2:
        return []
    t_s = step_s * np.arange(len(paths.east_m))
    reach_m = min_distance_m + growth_m_s * t_s
    one, other = _candidates(paths, float(reach_m[-1]), min_height_m)
    if not len(one):
        return []
    apart = np.hypot(
        paths.east_m[:, one] - paths.east_m[:, other], paths.north_m[:, one] - paths.north_m[:, other]
    )
    low = paths.low_m
    high = paths.high_m
    gap = np.maximum(np.maximum(low[:, one] - high[:, other], low[:, other] - high[:, one]), 0.0)
    is_near = (apart < reach_m[:, None]) & (gap < min_height_m)  # NaN: not in the air
    found = []
    for pair in np.flatnonzero(is_near.any(axis=0)).tolist():
        a = int(one[pair])
        b = int(other[pair])
        near = np.flatnonzero(is_near[:, pair])
        begins = int(near[0])
        nearest = int(near[np.argmin(apart[near, pair])])
        heights = [bound[begins, i] for bound in (low, high) for i in (a, b)]
        place_m = (
            float(0.5 * (paths.east_m[begins, a] + paths.east_m[begins, b])),
            float(0.5 * (paths.north_m[begins, a] + paths.north_m[begins, b])),
            float(sum(heights) / 4.0),
        )
        vehicles = sorted((paths.vehicles[a], paths.vehicles[b]))
        found.append(
            Encounter(
                (vehicles[0], vehicles[1]),
                float(t_s[begins]),
                float(apart[nearest, pair]),
                float(gap[nearest, pair]),
                place_m,
            )
        )
    return sorted(found, key=lambda encounter: encounter.vehicles)


def _candidates(paths: FlightPaths, min_distance_m: float, min_height_m: float) -> tuple[IntArray, IntArray]:
    """Return the pairs whose bounding boxes come too near, as two arrays of indices."""
    n = len(paths.vehicles)
    is_near = np.triu(np.ones((n, n), np.bool_), 1)
    for low, high, margin in (
        (paths.east_m, paths.east_m, min_distance_m),
        (paths.north_m, paths.north_m, min_distance_m),
        (paths.low_m, paths.high_m, min_height_m),
    ):
        least = np.fmin.reduce(low)
        most = np.fmax.reduce(high)
        is_near &= (least[:, None] - most < margin) & (least - most[:, None] < margin)
    one, other = np.nonzero(is_near)
    return one, other
