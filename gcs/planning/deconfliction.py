"""Keeping vehicles apart: who flies in which altitude lane, and who comes near whom all the same.

Routes cross, and every target ends one. Vehicles in different lanes are apart by altitude; within a lane they
must be apart in time. Where a vehicle will be is known from its route and speed, to a few seconds; so lanes
come first and time second: each vehicle has a lane of its own as long as there are enough, and shares one
only with vehicles that it stays clear of. Whoever has a route that is flown already keeps its lane, since
another altitude is another mission.

At the end of its route a vehicle circles: it is taken to stay there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.jit import Call, kernel
from gcs.model import FloatArray

_STEP_S = 1.0
_LONGEST_S = 900.0


@dataclass(frozen=True, slots=True)
class PlannedFlight:
    """What a vehicle is going to fly."""

    vehicle: int
    points_m: FloatArray
    """(k, 2), where it is now first."""
    speed_m_s: float
    layer: int
    """The one it has, or would like."""
    keeps_layer: bool = False
    """Whether it keeps it in any case."""


@dataclass(frozen=True, slots=True)
class Conflict:
    """Two vehicles in one lane that come too near to each other."""

    vehicles: tuple[int, int]
    distance_m: float
    after_s: float


def assign_layers(
    flights: Sequence[PlannedFlight], lanes: int, min_distance_m: float
) -> tuple[dict[int, int], tuple[Conflict, ...]]:
    """Give each vehicle a lane.

    Parameters
    ----------
    flights : sequence of Flight
        Everybody in the air, those with fixed lanes too.
    lanes : int
        How many there are.
    least_m : float
        Distance that vehicles of one lane keep.

    Returns
    -------
    dict of int to int
        Lane of each vehicle.
    tuple of Conflict
        Vehicles that come nearer than `min_distance_m`: no layer is left, or both keep theirs.
    """
    order = sorted(flights, key=lambda flight: (not flight.keeps_layer, flight.vehicle))
    if not order:
        return {}, ()
    distance_m, after_s = _nearest(_places(order), min_distance_m)
    found: list[int] = []
    conflicts: list[Conflict] = []
    for i, flight in enumerate(order):
        nearest = distance_m[i, :i]
        taken = np.array(found, dtype=np.int64)
        room = [float(nearest[taken == layer].min(initial=np.inf)) for layer in range(lanes)]
        layer = flight.layer % lanes
        if not flight.keeps_layer and room[layer] < min_distance_m:
            layer = int(np.argmax([min(one, min_distance_m) for one in room]))
        for j in np.flatnonzero((taken == layer) & (nearest < min_distance_m)).tolist():
            pair = sorted((order[j].vehicle, flight.vehicle))
            conflicts.append(Conflict((pair[0], pair[1]), float(nearest[j]), float(after_s[i, j])))
        found.append(layer)
    return {flight.vehicle: layer for flight, layer in zip(order, found, strict=True)}, tuple(conflicts)


def min_separation_m(flights: Sequence[PlannedFlight]) -> dict[int, float]:
    """Return how near each vehicle comes to another of its lane; infinite where it is alone in it."""
    if not flights:
        return {}
    distance_m, _ = _nearest(_places(flights), 0.0)
    lanes = np.array([flight.layer for flight in flights])
    distance_m = np.where(lanes[:, None] == lanes[None, :], np.minimum(distance_m, distance_m.T), np.inf)
    return {flight.vehicle: float(distance_m[i].min()) for i, flight in enumerate(flights)}


def _places(flights: Sequence[PlannedFlight]) -> FloatArray:
    """Where everybody is at each step, (n, steps, 2), until the last has ended."""
    ways = [np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(f.points_m, axis=0).T)))) for f in flights]
    longest_s = max(way[-1] / flight.speed_m_s for way, flight in zip(ways, flights, strict=True))
    t_s = np.arange(0.0, min(longest_s, _LONGEST_S) + _STEP_S, _STEP_S)
    places = np.empty((len(flights), len(t_s), 2))
    for i, (way, flight) in enumerate(zip(ways, flights, strict=True)):
        for axis in (0, 1):
            places[i, :, axis] = np.interp(flight.speed_m_s * t_s, way, flight.points_m[:, axis])
    return places


@kernel
def _nearest(places, min_distance_m):  # type: ignore[no-untyped-def]
    """Return the least distance of each pair and when it falls below a minimum, (n, n) below the diagonal."""
    n = places.shape[0]
    distance_m, after_s = np.full((n, n), np.inf), np.full((n, n), np.inf)
    for i in range(n):
        for j in range(i):
            nearest2 = np.inf
            for k in range(places.shape[1]):
                x, y = places[i, k, 0] - places[j, k, 0], places[i, k, 1] - places[j, k, 1]
                gap2 = x * x + y * y
                if nearest2 >= min_distance_m * min_distance_m > gap2:
                    after_s[i, j] = k * _STEP_S
                nearest2 = min(nearest2, gap2)
            distance_m[i, j] = math.sqrt(nearest2)
    return distance_m, after_s


def warm_up_calls() -> list[Call]:
    """One call of the kernel, types as in a plan."""
    return [(_nearest, np.zeros((2, 1, 2)), 1.0)]
