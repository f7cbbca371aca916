"""Altitude layers: which route flies in which, and when two in one layer are too near in time.

Vehicles in different layers are separated by altitude. Within a layer they are separated in time, from the
predicted positions along their routes, in the wind that each reports. A vehicle shares a layer only if no
layer is free. A vehicle that flies its route already keeps its layer, since another altitude means another
mission. After the end of its route a vehicle is assumed to stay there.

Over terrain routes have heights, and a layer is a share of the flight band. Where the ground bends more than
a vehicle can climb, the heights of two layers come together. So two flights with heights are separated by
these, whatever their layers are, and kept apart from the circles at the ends of others, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.jit import Call, int64, kernel
from gcs.model import BoolArray, FloatArray, IntArray
from gcs.planning.map.grid import Point

_STEP_S = 1.0
_MAX_HORIZON_S = 900.0
_MIN_GROUND_SPEED_M_S = 1.0
_ANY = -1
"""Layer of a vehicle that may get any."""
_ROUNDING_M = 1e-6
"""More than rounding changes in a distance."""


@dataclass(frozen=True, slots=True)
class PlannedFlight:
    """Route of a vehicle, to be separated from others."""

    vehicle: int
    points_m: FloatArray
    """(k, 2), the current position first."""
    speed_m_s: float
    layer: int
    """Current or preferred layer."""
    keeps_layer: bool = False
    """True if the layer must not change."""
    radius_m: float = 0.0
    """Radius of its circle, if it stays where it is."""
    heights_msl_m: FloatArray | None = None
    """(k,), heights of the points; None: that of its layer."""
    end_radius_m: float = 0.0
    """Radius of the circle round its last point that it flies from there on."""
    wind_m_s: Point = (0.0, 0.0)
    """East and north, as the vehicle reports it; `speed_m_s` is the airspeed."""


@dataclass(frozen=True, slots=True)
class Conflict:
    """Two vehicles of one layer that come too near to each other."""

    vehicles: tuple[int, int]
    distance_m: float
    after_s: float


def assign_layers(
    flights: Sequence[PlannedFlight], layers: int, min_distance_m: float, min_height_m: float = 0.0
) -> tuple[dict[int, int], tuple[Conflict, ...]]:
    """Assign an altitude layer to each vehicle.

    Parameters
    ----------
    flights : sequence of PlannedFlight
        All vehicles in the air.
    layers : int
        Number of layers.
    min_distance_m : float
        Minimum separation within a layer.
    min_height_m : float
        Difference in height from which two flights with heights are separated.

    Returns
    -------
    dict of int to int
        Layer of each vehicle.
    tuple of Conflict
        Vehicles that come nearer than `min_distance_m`: no layer is left, or both keep theirs.
    """
    order = sorted(flights, key=lambda flight: (not flight.keeps_layer, flight.vehicle))
    if not order:
        return {}, ()
    kept = np.array([flight.layer % layers if flight.keeps_layer else _ANY for flight in order])
    has_heights = _has_heights(order)
    may_meet = _may_meet(kept, has_heights)
    places = _positions(order)
    distance_m, after_s = _nearest(places, may_meet, min_distance_m, min_height_m, min_distance_m)
    found: list[int] = []
    conflicts: list[Conflict] = []
    for i, flight in enumerate(order):
        nearest = distance_m[i, :i]
        if flight.keeps_layer and not (nearest < min_distance_m).any():
            found.append(flight.layer % layers)
            continue
        assigned = np.array(found, dtype=np.int64)
        by_height = has_heights[:i] & has_heights[i]
        layer = flight.layer % layers
        if not flight.keeps_layer:
            separations = [
                float(nearest[(assigned == other) | by_height].min(initial=np.inf)) for other in range(layers)
            ]
            if separations[layer] < min_distance_m:
                layer = int(np.argmax([min(one, min_distance_m) for one in separations]))
        meets = ((assigned == layer) | by_height) & (nearest < min_distance_m)
        for j in np.flatnonzero(meets).tolist():
            pair = sorted((order[j].vehicle, flight.vehicle))
            conflicts.append(Conflict((pair[0], pair[1]), float(nearest[j]), float(after_s[i, j])))
        found.append(layer)
    return {flight.vehicle: layer for flight, layer in zip(order, found, strict=True)}, tuple(conflicts)


def meeting_places_m(
    flight: PlannedFlight, other: PlannedFlight, min_distance_m: float, min_height_m: float, around_s: float
) -> FloatArray:
    """Return where the other vehicle is when two flights first come too near, and some time around.

    Returns
    -------
    ndarray, shape (k, 3)
        East, north and height, one row a second; none if they are separated.
    """
    own, theirs = _positions([flight, other])
    gaps_m = np.hypot(*(own - theirs)[:, :2].T) - own[:, 3] - theirs[:, 3]
    meets = (gaps_m < min_distance_m) & ~(np.abs(own[:, 2] - theirs[:, 2]) >= min_height_m)
    if not meets.any():
        return np.empty((0, 3))
    begin = int(np.argmax(meets))
    apart = np.flatnonzero(~meets[begin:])
    end = begin + int(apart[0]) if apart.size else len(meets)
    around = round(around_s / _STEP_S)
    return theirs[max(begin - around, 0) : end + around, :3]


def min_separation_m(flights: Sequence[PlannedFlight], min_height_m: float = 0.0) -> dict[int, float]:
    """Return the least distance of each vehicle to others at its height; inf for a vehicle without others."""
    if not flights:
        return {}
    positions = _positions(flights)
    positions[:, :, 3] = 0.0
    may_meet = _may_meet(np.array([flight.layer for flight in flights]), _has_heights(flights))
    distance_m, _ = _nearest(positions, may_meet, 0.0, min_height_m, np.inf)
    distance_m = np.minimum(distance_m, distance_m.T)
    return {flight.vehicle: float(distance_m[i].min()) for i, flight in enumerate(flights)}


def _has_heights(flights: Sequence[PlannedFlight]) -> BoolArray:
    return np.array([flight.heights_msl_m is not None for flight in flights])


def _may_meet(layers: IntArray, has_heights: BoolArray) -> BoolArray:
    """Return the pairs that only their distance separates, (n, n); a layer may be `_ANY`."""
    is_free = layers == _ANY
    in_one = (layers[:, None] == layers) | is_free[:, None] | is_free
    return in_one | (has_heights[:, None] & has_heights)


def _positions(flights: Sequence[PlannedFlight]) -> FloatArray:
    """Return predicted positions at each step, (n, steps, 4), until the last flight ends.

    The third is the height, NaN where a flight has none; the last is the radius of a circle round the place.
    """
    along_m = [np.concatenate(([0.0], np.cumsum(_lengths_in_air_m(flight)))) for flight in flights]
    longest_s = max(
        distances_m[-1] / flight.speed_m_s for distances_m, flight in zip(along_m, flights, strict=True)
    )
    t_s = np.arange(0.0, min(longest_s, _MAX_HORIZON_S) + _STEP_S, _STEP_S)
    places = np.full((len(flights), len(t_s), 4), np.nan)
    for i, (distances_m, flight) in enumerate(zip(along_m, flights, strict=True)):
        flown_m = flight.speed_m_s * t_s
        for axis in (0, 1):
            places[i, :, axis] = np.interp(flown_m, distances_m, flight.points_m[:, axis])
        if flight.heights_msl_m is not None:
            places[i, :, 2] = np.interp(flown_m, distances_m, flight.heights_msl_m)
        has_ended = flown_m >= distances_m[-1]
        places[i, :, 3] = np.where(has_ended, max(flight.radius_m, flight.end_radius_m), flight.radius_m)
    return places


def _lengths_in_air_m(flight: PlannedFlight) -> FloatArray:
    """Return the distances that a vehicle flies through the air on its legs, (k - 1,)."""
    legs_m = np.diff(flight.points_m, axis=0)
    lengths_m: FloatArray = np.hypot(*legs_m.T)
    if flight.wind_m_s == (0.0, 0.0):
        return lengths_m
    wind_m_s = np.array(flight.wind_m_s)
    along_m_s = legs_m @ wind_m_s / np.maximum(lengths_m, _ROUNDING_M)
    across2 = np.maximum(wind_m_s @ wind_m_s - along_m_s**2, 0.0)
    ground_m_s = along_m_s + np.sqrt(np.maximum(flight.speed_m_s**2 - across2, 0.0))
    return lengths_m * flight.speed_m_s / np.maximum(ground_m_s, _MIN_GROUND_SPEED_M_S)


@kernel
def _nearest(
    places: FloatArray, may_meet: BoolArray, min_distance_m: float, min_height_m: float, enough_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return the least distance of each pair and when it falls below a minimum, (n, n) below the diagonal.

    Both are infinite for pairs that may not meet. Times at which a pair is apart in height do not count.
    Steps at which a pair cannot be nearer than the least so far, and than `enough_m`, are left out: distances
    of `enough_m` or more are upper bounds.
    """
    n = places.shape[0]
    steps = places.shape[1]
    distance_m = np.full((n, n), np.inf)
    after_s = np.full((n, n), np.inf)
    moves_m = np.zeros(n)
    radii_m = np.zeros(n)
    for i in range(n):
        for k in range(steps):
            radii_m[i] = max(radii_m[i], places[i, k, 3])
            if k > 0:
                x = places[i, k, 0] - places[i, k - 1, 0]
                y = places[i, k, 1] - places[i, k - 1, 1]
                moves_m[i] = max(moves_m[i], math.sqrt(x * x + y * y))
    for i in range(n):
        for j in range(i):
            if not may_meet[i, j]:
                continue
            nearest = np.inf
            closing_m = moves_m[i] + moves_m[j] + _ROUNDING_M
            largest_m = radii_m[i] + radii_m[j] + _ROUNDING_M
            k = 0
            while k < steps:
                x = places[i, k, 0] - places[j, k, 0]
                y = places[i, k, 1] - places[j, k, 1]
                apart_m = math.sqrt(x * x + y * y)
                if not abs(places[i, k, 2] - places[j, k, 2]) >= min_height_m:  # with NaN as well
                    gap = apart_m - places[i, k, 3] - places[j, k, 3]
                    if nearest >= min_distance_m > gap:
                        after_s[i, j] = k * _STEP_S
                    nearest = min(nearest, gap)
                spare_m = apart_m - largest_m - min(nearest, enough_m)
                k += 1
                if spare_m > closing_m:
                    k += int64(min(spare_m / closing_m, float(steps)))
            distance_m[i, j] = nearest
    return distance_m, after_s


def warm_up_calls() -> list[Call]:
    """Return one call of the kernel with the types of a plan."""
    return [(_nearest, np.zeros((2, 1, 4)), np.ones((2, 2), np.bool_), 1.0, 1.0, 1.0)]
