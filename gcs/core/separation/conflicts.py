"""Conflicts of a simulated flight: vehicles that it comes near to, and circles that overlap at its end."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from gcs.core.separation.forward_flight import (
    CLIMB_M_S,
    MAX_ROUND_S,
    SLOW_SINK_M_S,
    Flight,
    Goal,
    GoalKind,
    simulate_flights,
)
from gcs.core.separation.look_ahead import LOOK_AHEAD_S, encounters
from gcs.model import vehicle_name

_STEPS: Final = 50
_MAX_STEP_S: Final = 1.0
"""Vehicles that meet head on come nearer by twice their speed in a second."""
GROWTH_M: Final = 20.0
"""Growth of the minimum distance up to the end of a simulation."""
_LATE_S: Final = 10.0
"""Time by which a return may begin its descent late: after a turn, or a climb that it was in."""
CLEAR: Final = 1.5
"""Nearness without a conflict: the minimum distance grows with the time ahead."""


@dataclass(frozen=True, slots=True, order=True)
class Conflict:
    """Another vehicle that a flight comes too near to."""

    nearness: float
    """Distance by its minimum, or height by its minimum, whichever is greater; less than about 1."""
    words: str
    other: int
    """That vehicle."""


class Conflicts:
    """Finds the conflicts of flights, by minimum distances between vehicles in metres.

    Parameters
    ----------
    min_m, min_height_m : float
        Minimum distance, and minimum difference in height of vehicles that are nearer than that.
    name : callable
        Returns the name of a vehicle or aircraft.
    """

    def __init__(self, min_m: float, min_height_m: float, name: Callable[[int], str]) -> None:
        self._min_m = min_m
        self._min_height_m = min_height_m
        self._name = name

    def met(
        self,
        own: Flight,
        others: list[Flight],
        is_return: bool,
        margin: float = 1.0,
        from_s: float = 0.0,
    ) -> Iterator[Conflict]:
        """Yield the vehicles that a flight comes near to, from some time on."""
        for_s = LOOK_AHEAD_S
        if is_return:  # up to the places of all that return, and once round
            returns = [own, *filter(_is_return, others)]
            for_s = min(for_s + max(_round_s(one) for one in returns), MAX_ROUND_S)
        step_s = min(max(for_s / _STEPS, 0.5), _MAX_STEP_S)
        reach_m = own.reach_m(for_s) + margin * self._min_m + GROWTH_M
        place_m = (own.east_m, own.north_m)
        near = [
            one
            for one in others
            if math.dist(place_m, (one.east_m, one.north_m)) <= reach_m + one.reach_m(for_s)
        ]
        if not near:
            return
        paths = simulate_flights([own, *near], for_s, step_s).since(round(from_s / step_s))
        for one in encounters(paths, margin * self._min_m, self._min_height_m, GROWTH_M / for_s, step_s):
            if own.vehicle in one.vehicles:
                other = next(vehicle for vehicle in one.vehicles if vehicle != own.vehicle)
                yield Conflict(
                    max(one.distance_m / self._min_m, one.height_m / self._min_height_m),
                    f"come within {one.distance_m:.0f} m and {one.height_m:.0f} m in height of "
                    f"{self._name(other)} in {one.after_s:.0f} s",
                    other,
                )

    def overlapping(self, own: Flight, others: list[Flight], *, last: bool = False) -> Iterator[Conflict]:
        """Yield the vehicles whose circles overlap the circle at the end of a flight.

        These are circles that they fly now, or with `last` those at the ends of their flights. A return that
        leads through the circle at the end of the other flight counts as one, too, with `last`.
        """
        circle = own.goals[-1]
        for other in others if _is_endless(circle) else ():
            if not last and other.goals[0].kind is not GoalKind.CIRCLE:
                continue
            theirs = other.goals[-1 if last or _is_return(other) else 0]
            if not _is_endless(theirs):
                continue
            between_m = math.dist((circle.east_m, circle.north_m), (theirs.east_m, theirs.north_m))
            radius_m = abs(circle.radius_m)
            their_radius_m = abs(theirs.radius_m)
            apart_m = max(
                between_m - radius_m - their_radius_m, abs(radius_m - their_radius_m) - between_m, 0.0
            )
            if apart_m < self._min_m and self._is_near(apart_m, height_m := _height_between_m(own, other)):
                yield self._conflict("circle", apart_m, height_m, "the circle", other)
            elif last and self._is_near(*(passed := _passes(own, other, self._min_m))):
                yield self._conflict("fly", *passed, "the circle", other)
            elif last and self._is_near(*(passed := _passes(other, own, self._min_m))):
                yield self._conflict("circle", *passed, "the return", other)

    def _is_near(self, apart_m: float, height_m: float) -> bool:
        return apart_m < self._min_m and height_m < self._min_height_m

    def _conflict(self, does: str, apart_m: float, height_m: float, of: str, other: Flight) -> Conflict:
        return Conflict(
            max(apart_m / self._min_m, height_m / self._min_height_m),
            f"{does} within {apart_m:.0f} m and {height_m:.0f} m in height of {of} of agent "
            f"{vehicle_name(other.vehicle)}",
            other.vehicle,
        )


def nearest_of(conflicts: Sequence[Conflict]) -> float:
    """Return the least nearness; that of vehicles that are clear of each other if there is no conflict."""
    return min((one.nearness for one in conflicts), default=CLEAR)


def _height_between_m(own: Flight, other: Flight) -> float:
    """Return the least difference in height of two vehicles on the circles at the ends of their flights.

    A return that gets there too high descends on the circle, through the height of the other one, if that is
    there by then.
    """
    own_high_m, own_until_s = _descent_on_circle(own)
    high_m, until_s = _descent_on_circle(other)
    own_low_m = own.goals[-1].height_m
    low_m = other.goals[-1].height_m
    if own.way_s(math.inf) > until_s:
        high_m = low_m
    if other.way_s(math.inf) > own_until_s:
        own_high_m = own_low_m
    return max(own_low_m - high_m, low_m - own_high_m, 0.0)


def _descent_on_circle(flight: Flight) -> tuple[float, float]:
    """Return how high a vehicle gets to the circle of its return, and when it has descended there.

    One that flies there by a mission is at the height of the circle by then.
    """
    circle = flight.goals[-1]
    at_s = flight.way_s(math.inf)
    if not _is_return(flight):
        return circle.height_m, at_s
    left_m = max(flight.height_m - circle.height_m - SLOW_SINK_M_S * max(at_s - _LATE_S, 0.0), 0.0)
    return circle.height_m + left_m, at_s + left_m / SLOW_SINK_M_S


def _passes(returns: Flight, circling: Flight, min_m: float) -> tuple[float, float]:
    """Return how near a return leads to the circle of another vehicle that is there by then.

    Returns
    -------
    apart_m, height_m : float
        Least distance from the circle, and difference in height there; infinite if it is `min_m` or more, or
        the vehicle is not there yet.
    """
    if not _is_return(returns):
        return math.inf, math.inf
    circle = circling.goals[-1]
    to_m = (returns.goals[-1].east_m - returns.east_m, returns.goals[-1].north_m - returns.north_m)
    centre_m = (circle.east_m - returns.east_m, circle.north_m - returns.north_m)
    length_m = max(math.hypot(*to_m), 1.0)
    along_m = min(max((to_m[0] * centre_m[0] + to_m[1] * centre_m[1]) / length_m, 0.0), length_m)
    leg_m = (to_m[0] * along_m / length_m, to_m[1] * along_m / length_m)
    apart_m = max(math.dist(leg_m, centre_m) - abs(circle.radius_m), 0.0)
    at_s = returns.time_s(leg_m, 0.0)
    if apart_m >= min_m or at_s + 2.0 * _LATE_S < circling.way_s(math.inf):
        return math.inf, math.inf
    change_m = returns.goals[-1].height_m - returns.height_m
    evenly_m = min(abs(change_m) * along_m / length_m, SLOW_SINK_M_S * max(at_s - _LATE_S, 0.0))
    at_once_m = min(abs(change_m), CLIMB_M_S * at_s)
    heights_m = [returns.height_m + math.copysign(by_m, change_m) for by_m in (evenly_m, at_once_m)]
    return apart_m, max(min(heights_m) - circle.height_m, circle.height_m - max(heights_m), 0.0)


def _round_s(flight: Flight) -> float:
    """Return the time to the circle at the end of a flight, along its legs, and once round it."""
    circle_m = 2.0 * math.pi * abs(flight.goals[-1].radius_m)
    return flight.way_s(MAX_ROUND_S) + flight.time_s((0.0, 0.0), circle_m)


def _is_return(flight: Flight) -> bool:
    """Return True if a vehicle flies straight to a circle; a PX4 descends in it."""
    return all(goal.kind is GoalKind.CIRCLE for goal in flight.goals)


def _is_endless(goal: Goal) -> bool:
    """Return True if a goal is a circle that a vehicle flies without end."""
    return goal.kind is GoalKind.CIRCLE and math.isinf(goal.for_s)
