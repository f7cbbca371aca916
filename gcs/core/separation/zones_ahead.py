"""Zones ahead: which no-fly zone a predicted flight leads into, and whether it is clear of obstacles, too."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Final

import numpy as np

from gcs.core.airspace.no_fly_zones import ClosedZone, NoFlyZones
from gcs.core.separation.forward_flight import STEP_S, Flight, Goal, GoalKind, simulate_flights
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.planning.map.line_of_sight import line_of_sight

_OFF_M: Final = 10.0
"""Distance by which predicted circles are off."""
_LATE_M: Final = 40.0
"""Distance by which vehicles turn later, and wider, than predicted."""
_AHEAD_S: Final = 40.0
"""Time without an incursion for which one that held may fly on: more than that at which it holds."""
MAX_RETURN_S: Final = 900.0
"""Time of a return that is checked for zones, obstacles and the ground."""
_NOW_S: Final = 2.0
"""Time of the present flight in which a vehicle counts as inside an area."""
_STRAIGHT_STEPS: Final = 5
"""Length of the legs that are checked where a flight is straight."""
_CORNERS: Final = 24
"""Of the polygon that stands for a circle."""

_Place = tuple[float, float, float, float]
"""East, north, lowest and greatest height above mean sea level."""
_Leg = tuple[_Place, _Place]


class ZonesAhead:
    """Compares predicted flights with no-fly zones and obstacles.

    Parameters
    ----------
    zones : NoFlyZones
    clearance_m : float
        Horizontal distance that routes keep from what reaches from the ground to the sky.
    """

    def __init__(self, zones: NoFlyZones, clearance_m: float) -> None:
        self._zones = zones
        self.margin_m = min(clearance_m, _OFF_M)
        """Distance that a predicted circle should keep from obstacles."""
        self._joining_m = min(clearance_m, _LATE_M)
        """The same for the way back to a route."""

    def first(self, flight: Flight) -> str:
        """Return the name of the first closed zone that a flight soon leads into; empty if there is none.

        A climb in a circle before it flies on, as a PX4 begins a mission, comes on top of that time.
        """
        if not self._zones.closed:
            return ""
        climbs_first = flight.goals[0].kind is GoalKind.CIRCLE and len(flight.goals) > 1
        return self._first(_legs(flight, _AHEAD_S + (flight.turning_s if climbs_first else 0.0)))

    def mode_problem(self, mode: str, ordered: Flight, present: Flight) -> str:
        """Return which zone or obstacle an ordered mode leads to; empty if to none, or as the present flight.

        Routes keep clear of obstacles.
        """
        if mode == LOITER:
            return self.hold_problem(ordered, present)
        if mode == RTL:
            return self._return_problem(ordered, present)
        zone = self.first(ordered) if mode == AUTO else ""
        is_worse = bool(zone) and zone != self.first(present)
        return f"would fly into no-fly zone {zone}" if is_worse else ""

    def hold_problem(self, hold: Flight, present: Flight) -> str:
        """Return which zone or obstacle a hold leads to; empty if to none, or as the present flight does."""
        for_s = hold.round_s
        problem = self.problem(hold, for_s, self.margin_m)
        return problem if problem and problem != self.problem(present, for_s) else ""

    def joining_problem(self, led: Flight, present: Flight, for_s: float) -> str:
        """Return which area the way back to a route comes near to; empty if none, or as the present flight.

        Vehicles that turn back to their routes begin late. One that has arrived goes back to its circle,
        which may be nearer to an obstacle.
        """
        has_arrived = led.goals[0].kind is GoalKind.CIRCLE
        problem = self.problem(led, for_s, 0.0 if has_arrived else self._joining_m)
        return problem if problem and not self.problem(present, for_s, self.margin_m) else ""

    def _return_problem(self, back: Flight, present: Flight) -> str:
        """Return which zone or obstacle RTL leads to; empty if to none, or if the vehicle is in it now.

        The circle at home is compared with zones only.
        """
        legs = _to_distant_place(back)
        problem = self._met(legs) or self.circle_problem(back.goals[-1])
        return problem if problem and problem != self.problem(present, _NOW_S) else ""

    def problem(self, flight: Flight, ahead_s: float, margin_m: float = 0.0) -> str:
        """Return which zone or obstacle a flight meets, or comes near to, in words; empty if none."""
        return self._met(_legs(flight, ahead_s), margin_m)

    def _first(self, legs: Iterable[_Leg]) -> str:
        cells = self._zones.closed_cells
        near = (leg for leg in legs if not line_of_sight(cells, leg[0][:2], leg[1][:2]))
        closed = self._zones.closed.items()
        return next((name for leg in near for name, zone in closed if _is_met(zone, *leg)), "")

    def _met(self, flown: Iterable[_Leg], margin_m: float = 0.0) -> str:
        legs = list(flown)
        if zone := self._first(legs):
            return f"would fly into no-fly zone {zone}"
        full = self._zones.obstacles.full
        is_clear = all(line_of_sight(full, begin[:2], end[:2], margin_m) for begin, end in legs)
        cells = self._zones.limited_cells
        near = [leg for leg in legs if not line_of_sight(cells, leg[0][:2], leg[1][:2])]
        meets = any(_is_met(area, *leg) for area in self._zones.limited for leg in near)
        return "would come near an obstacle" if meets or not is_clear else ""

    def circle_problem(self, circle: Goal) -> str:
        """Return which no-fly zone a circle without end meets, in words; empty if none."""
        if circle.kind is not GoalKind.CIRCLE or not self._zones.closed:
            return ""
        radius_m = abs(circle.radius_m)
        zone = self._first(_round(circle, radius_m)) or self._first(_round(circle, radius_m + _OFF_M))
        return f"would circle in no-fly zone {zone}" if zone else ""

    def is_on_map(self, flight: Flight, ahead_s: float) -> bool:
        """Return True if a flight stays where obstacles are known."""
        full = self._zones.obstacles.full
        return all(full.contains(begin[:2]) for begin, _ in _legs(flight, ahead_s))


def _places(flight: Flight, ahead_s: float) -> list[_Place]:
    paths = simulate_flights([flight], ahead_s)
    columns = (paths.east_m, paths.north_m, paths.low_m, paths.high_m)
    return list(zip(*(column[:, 0].tolist() for column in columns), strict=True))


def _legs(flight: Flight, ahead_s: float) -> Iterator[_Leg]:
    """Return the legs between two steps of a predicted flight, as far as it stays in the air."""
    return pairwise(_places(flight, ahead_s))


def _to_distant_place(flight: Flight) -> Iterator[_Leg]:
    """Return the legs of a flight to the circle at its last goal: few of them where it is straight."""
    places = _places(flight, flight.return_s(MAX_RETURN_S))
    last = flight.goals[-1]
    away_m = [math.dist(place[:2], (last.east_m, last.north_m)) for place in places]
    farthest = away_m.index(max(away_m))
    circle_m = abs(last.radius_m) + _OFF_M
    end = next((k for k in range(farthest, len(places)) if away_m[k] <= circle_m), len(places) - 1)
    turned = min(math.ceil(flight.turning_s / STEP_S), end)
    return pairwise([*places[:turned], *places[turned:end:_STRAIGHT_STEPS], places[end]])


def _round(circle: Goal, radius_m: float) -> Iterator[_Leg]:
    """Return the legs of a polygon for a circle."""
    angles = np.linspace(0.0, 2.0 * np.pi, _CORNERS + 1)
    east_m = circle.east_m + radius_m * np.sin(angles)
    north_m = circle.north_m + radius_m * np.cos(angles)
    heights_m = (circle.height_m - _OFF_M, circle.height_m + _OFF_M)
    return pairwise([(east, north, *heights_m) for east, north in zip(east_m, north_m, strict=True)])


def _is_met(zone: ClosedZone, begin: _Place, end: _Place) -> bool:
    """Return True if a leg with its band of heights leads through a zone."""
    heights_m = 0.5 * (begin[2] + begin[3]), 0.5 * (end[2] + end[3])
    half_m = 0.5 * max(begin[3] - begin[2], end[3] - end[2])
    return zone.is_met(begin[:2], end[:2], heights_m, half_m)
