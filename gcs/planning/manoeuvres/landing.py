"""Return route of a vehicle that lands: from the end of its route to the approach, and along that to home.

A landing begins on a straight leg (`APPROACH_M`) that ends at home. It comes straight from the end of the
route if the path there, the leg and the turns are clear. Otherwise approaches all round home are candidates,
and the path to each is a route like any other, with the same search, clearance and turns. It joins the
approach straight, or by a base leg as in a traffic pattern. The shortest path wins whose legs keep the most
clearance and whose forward simulation (`gcs.planning.forward_simulation`) is clear, from before the target to
the middle of the approach, with the expected turn lag and with half of it.

A vehicle always gets a return route. Without a clear one it gets the best there is, with a warning: the one
of whose simulated flights the fewest hit an obstacle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from typing import TypeAlias

import numpy as np

from gcs.geo import bearing_rad, wrap_pi
from gcs.model import APPROACH_M, FloatArray, LandingWait, read_only
from gcs.planning.flight_variants import flight_variants, wind_margin_m, windy_flights
from gcs.planning.forward_simulation import Motion, RemainingMission, SimulatedFlight, simulate
from gcs.planning.manoeuvres.loiter import path_length_m, places_around, split_before_end
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight, to_cells
from gcs.planning.path.corner_splitting import MAX_TURN_RAD
from gcs.planning.path.initial_turn import MIN_RADIUS_SHARE, is_turn_safe, start_clearance
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.planner_inputs import AgentState, PlanOptions, TargetDemand
from gcs.planning.route_joining import MIN_CLEARANCE_SHARE
from gcs.planning.route_search import RouteSearch
from gcs.planning.routes_in_wind import WIND_SHARES, widened

_BEARINGS = 36
_CLEARANCE_SHARES = (1.0, 0.5, MIN_CLEARANCE_SHARE, 0.0)
"""Shares of the clearance that the straight legs of a landing may keep, in order of preference."""
_GUSTS_SHARE = 0.5 * MIN_CLEARANCE_SHARE
"""Share of the clearance that a flown path should keep at least, for gusts."""
_BASE_LEG_RADII = 2.5
"""Length of a base leg, in turn radii."""
_SIMULATED_RADII = 6.0
"""Simulated part of the route before its end, in turn radii."""
_DEPARTURE_RADII = (1.0, 2.0, 3.0)
_DEPARTURE_TURNS_RAD = tuple(np.radians([0.0, 30.0, -30.0, 60.0, -60.0]).tolist())
"""Departure points of a vehicle that cannot turn at its target: turn radii ahead, and course change."""
_MAX_PLACES = 6
"""Number of places with room that are tried as departure points."""
_MAX_GATES_AFTER_DEPARTURE = 6
"""Number of gates that are tried from each departure point."""
_CLEAR, _NEAR, _TOO_NEAR, _SHARP = range(4)
_NOTES = {
    _CLEAR: "",
    _NEAR: "its return route comes nearer to obstacles than the clearance; no other route keeps it",
    _TOO_NEAR: "its return route passes obstacles so closely that its turns have hardly any clearance",
    _SHARP: "its return route has turns that may lead into obstacles",
}
_NO_ROUTE = "no clear return route; it flies straight to its landing, through obstacles"
_NO_APPROACH = "no clear approach to its home; the last leg of its landing leads through obstacles"


@dataclass(frozen=True, slots=True)
class LandingSpec:
    """Turns of vehicles on their return routes."""

    turns: TurnAnticipation
    """Turn anticipation at the waypoints."""
    turn_lag_s: float
    """Delay until a commanded turn rate is reached."""


@dataclass(frozen=True, slots=True)
class ReturnRoute:
    """Flight after the end of a route.

    Attributes
    ----------
    points_m : ndarray, shape (k, 2)
        Corners, start of the approach, and home.
    is_straight : bool
        True if it leads straight to the approach.
    problem : str
        Warning for the operator; empty if the route is clear.
    wait : LandingWait or None
        Wait until other vehicles have landed.
    heights_msl_m : ndarray, shape (k,), or None
        Heights of the points; None: those of the vehicle's layer, and of every landing.
    arc_points : int
        Number of first corners on the loiter circle at the end of the route; a vehicle that waits there
        leaves it without them.
    """

    points_m: FloatArray
    is_straight: bool
    problem: str = ""
    wait: LandingWait | None = None
    heights_msl_m: FloatArray | None = None
    arc_points: int = 0

    def without_arc(self) -> ReturnRoute:
        """Return the same route for a vehicle that waits on the loiter circle."""
        arc = self.arc_points
        heights_m = None if self.heights_msl_m is None else self.heights_msl_m[arc:]
        return replace(self, points_m=self.points_m[arc:], heights_msl_m=heights_m, arc_points=0)


@dataclass(frozen=True, slots=True)
class _Gate:
    """Point where a path joins a landing, and the straight legs from there."""

    points_m: tuple[Point, ...]
    """The gate, the start of the approach if that is another point, and home."""
    share: float
    """Share of the clearance that the legs keep; negative if they are blocked."""

    @property
    def length_m(self) -> float:
        return math.fsum(math.dist(a, b) for a, b in pairwise(self.points_m))


_Graded: TypeAlias = tuple[float, FloatArray, _Gate]
"""Grade of a path, its points, its gate.

The grade is one of `_CLEAR` ...: `_TOO_NEAR` plus 0.5 without clearance for gusts, `_SHARP` plus the share of
its flights that hit.
"""


def plan_return_route(
    grid: Grid,
    start: AgentState,
    points_m: FloatArray,
    home_m: Point,
    options: PlanOptions,
    landing: LandingSpec,
    past_m: Point | None = None,
) -> ReturnRoute:
    """Plan the return route of a vehicle.

    Parameters
    ----------
    start : AgentState
        State at the start of its route.
    points_m : ndarray, shape (k, 2)
        Waypoints of the route, without the vehicle's position; k >= 1.
    home_m : tuple of float
        East and north of the landing point.
    past_m : tuple of float, optional
        Place that it leads to first, straight from the end of the route.
    """
    planner = _Planner(grid, start, points_m, home_m, options, landing)
    straight = planner.straight()
    if past_m is not None:
        return planner.planned(past_m) or replace(straight, problem=_NO_ROUTE)
    if straight.is_straight and (not grid.blocked.any() or planner.is_clear(straight.points_m)):
        return straight
    return planner.planned() or replace(straight, problem=_NO_ROUTE)


class _Planner:
    """Planner of one return route."""

    def __init__(
        self,
        grid: Grid,
        start: AgentState,
        points_m: FloatArray,
        home_m: Point,
        options: PlanOptions,
        landing: LandingSpec,
    ) -> None:
        self._grid = grid
        self._options = options
        self._landing = landing
        self._home_m = home_m
        self._speed_m_s = max(start.speed_m_s, 1.0)
        self._end_m = (float(points_m[-1, 0]), float(points_m[-1, 1]))
        path_m = np.vstack(((start.east_m, start.north_m), points_m))
        _, self._tail_m, is_whole = split_before_end(path_m, _SIMULATED_RADII * options.turn_radius_m)
        leaves = _course_rad(path_m[-2:], start)
        comes = _course_rad(self._tail_m[:2], start)
        self._course_rad = leaves
        self._begins_rad = start.course_rad if is_whole and start.course_rad is not None else comes

    def straight(self) -> ReturnRoute:
        """Return the straight route; from the nearest free approach if the direct one is not free."""
        direct_m = self._at(APPROACH_M, self._from_rad)
        approaches_m = self._free_approaches_m()
        is_straight = direct_m in approaches_m or not self._grid.contains(self._home_m)
        nearest_m = min(approaches_m, key=lambda place_m: math.dist(place_m, self._end_m), default=direct_m)
        return ReturnRoute(read_only([direct_m if is_straight else nearest_m, self._home_m]), is_straight)

    @property
    def _from_rad(self) -> float:
        """Bearing of the end of the route from home; north if it ends there."""
        return bearing_rad(*self._home_m, *self._end_m) if self._end_m != self._home_m else 0.0

    def is_clear(self, points_m: FloatArray) -> bool:
        """Return True if a path keeps the clearance and its simulated flight is clear."""
        clearance_m = self._options.clearance_m
        places = [self._end_m, *_points(points_m)]
        for a, b in pairwise(places):
            if not line_of_sight(
                self._grid,
                a,
                b,
                min(clearance_m, self._available_clearance_m(a), self._available_clearance_m(b)),
            ):
                return False
        return self._turns_safely(places[1]) and self._is_flown_clear(
            points_m, MIN_CLEARANCE_SHARE * clearance_m
        )

    def planned(self, past_m: Point | None = None) -> ReturnRoute | None:
        """Return the best planned route, or the best past a place; None without one."""
        gates = list(self._gates())
        if not gates:
            return None
        if past_m is not None:
            return _as_route(self._best(gates, np.array([past_m]), bearing_rad(*self._end_m, *past_m), None))
        nowhere = np.empty((0, 2))
        best = self._best(gates, nowhere, self._course_rad, None)
        for clearance_share, radius_share in WIND_SHARES if self._landing.turns.wind_m_s > 0.0 else ():
            if best is None or best[0] < _TOO_NEAR:
                break
            wide = widened(self._options, clearance_share, radius_share)
            best = self._best(gates, nowhere, self._course_rad, best, wide)
        for leaves_m in self._departures() if best is not None and best[0] >= _TOO_NEAR else ():
            best = self._best(gates, np.array([leaves_m]), bearing_rad(*self._end_m, *leaves_m), best)
            if best is not None and best[0] < _TOO_NEAR:
                break
        return _as_route(best)

    def _best(
        self,
        gates: list[_Gate],
        left_m: FloatArray,
        course_rad: float,
        best: _Graded | None,
        options: PlanOptions | None = None,
    ) -> _Graded | None:
        """Return the best path from the end of the route, or from a departure point, to any gate."""
        east_m, north_m = left_m[0].tolist() if len(left_m) else self._end_m
        start = AgentState(east_m, north_m, course_rad, self._speed_m_s)
        options = replace(options or self._options, horizon_s=0.0, cost="length")
        places = [gate.points_m[0] for gate in gates]
        search = RouteSearch(self._grid, [start], places, [TargetDemand()] * len(gates), options)
        lengths_m = search.costs[0] + [gate.length_m for gate in gates]
        order = sorted(range(len(gates)), key=lambda j: (-gates[j].share, lengths_m[j]))
        reached = [j for j in order if math.isfinite(lengths_m[j])]
        for j in reached[:_MAX_GATES_AFTER_DEPARTURE] if best is not None else reached:
            aimed = search.route(0, j)
            points_m = np.vstack((left_m, aimed.points_m, gates[j].points_m[1:]))
            if self._is_sharp(points_m, len(left_m) + len(aimed.points_m)):
                continue
            most = math.inf if best is None else best[0]
            grade = self._grade(points_m, most, keeps_clearance=not aimed.notes and gates[j].share == 1.0)
            if best is None or grade < best[0]:
                best = grade, points_m, gates[j]
            if grade == _CLEAR:
                break
        return best

    def _departures(self) -> Iterator[Point]:
        """Yield points where a vehicle may go after its target before it turns home, the nearest first.

        In wind the middles of places with room for a turn come first.
        """
        if self._landing.turns.wind_m_s > 0.0 and self._options.shape == "flyable":
            yield from self._places_with_room()
        for ring in _DEPARTURE_RADII if self._options.shape == "flyable" else ():
            for turn in _DEPARTURE_TURNS_RAD:
                angle = self._course_rad + turn
                distance_m = ring * self._options.turn_radius_m
                east_m, north_m = self._end_m
                place_m = (east_m + distance_m * math.sin(angle), north_m + distance_m * math.cos(angle))
                if self._share(place_m, self._end_m) >= 0.0:
                    yield place_m

    def _places_with_room(self) -> Iterator[Point]:
        """Yield the nearest places round the target where a vehicle can turn to any side."""
        radius_m = self._options.turn_radius_m
        room_m = radius_m + wind_margin_m(self._landing.turns)
        places = (
            (self._end_m[0] + east_m, self._end_m[1] + north_m) for east_m, north_m in places_around(radius_m)
        )
        clear = (
            place_m
            for place_m in places
            if self._grid.is_free(place_m)
            and line_of_sight(self._grid, place_m, place_m, room_m)
            and self._share(place_m, self._end_m) >= 0.0
        )
        yield from islice(clear, _MAX_PLACES)

    def _gates(self) -> Iterator[_Gate]:
        """Yield gates of landings: at the approach, or at a base leg to either side."""
        base_m = _BASE_LEG_RADII * self._options.turn_radius_m
        found = False
        for k in range(_BEARINGS):
            angle = self._from_rad + 2.0 * math.pi * k / _BEARINGS
            approach_m = self._at(APPROACH_M, angle)
            share = self._share(approach_m, self._home_m)
            if share < 0.0:
                continue
            found = True
            yield _Gate((approach_m, self._home_m), share)
            for side in (1.0, -1.0) if self._options.shape == "flyable" else ():
                across = angle + side * 0.5 * math.pi
                gate_m = (
                    approach_m[0] + base_m * math.sin(across),
                    approach_m[1] + base_m * math.cos(across),
                )
                least = min(share, self._share(gate_m, approach_m))
                if least >= 0.0:
                    yield _Gate((gate_m, approach_m, self._home_m), least)
        for approach_m in self._free_approaches_m()[: int(not found)]:
            yield _Gate((approach_m, self._home_m), -1.0)

    def _free_approaches_m(self) -> list[Point]:
        """Return the starts of all approaches that lie in free cells; the direct one first."""
        angles = (self._from_rad + 2.0 * math.pi * k / _BEARINGS for k in range(_BEARINGS))
        return list(filter(self._grid.is_free, (self._at(APPROACH_M, angle) for angle in angles)))

    def _share(self, from_m: Point, to_m: Point) -> float:
        """Return the share of the clearance that a leg keeps; negative if blocked or from off the map.

        Less clearance at home itself does not count.
        """
        grid = self._grid
        if not grid.contains(from_m) and grid.contains(self._home_m):
            return -1.0
        available_m = self._available_clearance_m(to_m)
        for share in _CLEARANCE_SHARES:
            if line_of_sight(grid, from_m, to_m, min(share * self._options.clearance_m, available_m)):
                return share
        return -1.0

    def _grade(self, points_m: FloatArray, most: float, *, keeps_clearance: bool) -> float:
        """Return the grade of a path; exact below `most`."""
        if self._is_flown_clear(points_m, MIN_CLEARANCE_SHARE * self._options.clearance_m):
            return _CLEAR if keeps_clearance else _NEAR
        landing = self._landing
        count = len(flight_variants(landing.turns, landing.turn_lag_s, self._speed_m_s))
        hits = 0
        for flight in self._flights(points_m, 0.0):
            hits += not flight.is_clear
            if hits and _SHARP + hits / (count + 1) >= most:
                break
        if hits:
            return _SHARP + hits / (count + 1)
        reach_m = _GUSTS_SHARE * self._options.clearance_m
        has_some = most > _TOO_NEAR and self._is_flown_clear(points_m, reach_m)
        return _TOO_NEAR if has_some else _TOO_NEAR + 0.5

    def _is_sharp(self, points_m: FloatArray, joined: int) -> bool:
        """Return True if a path turns too sharply where it joins the straight legs of a landing."""
        if self._options.shape != "flyable":
            return False
        a, b, c = np.vstack((self._end_m, points_m))[joined - 1 : joined + 2]
        return abs(wrap_pi(bearing_rad(*a, *b) - bearing_rad(*b, *c))) > MAX_TURN_RAD

    def _turns_safely(self, to_m: Point) -> bool:
        """Return True if the turn at the end of the route is clear, to either side where that is open."""
        grid = self._grid
        options = self._options
        if options.shape != "flyable":
            return True
        place = to_cells(grid, self._end_m)
        spacing_m = grid.spacing_m
        free = start_clearance(grid.blocked, options.clearance_m / spacing_m, *place)
        angle = 0.5 * math.pi - self._course_rad
        radius = options.turn_radius_m / spacing_m
        return bool(is_turn_safe(grid.blocked, free, *place, angle, *to_cells(grid, to_m), radius, -1))

    def _is_flown_clear(self, points_m: FloatArray, reach_m: float) -> bool:
        """Return True if all simulated flights are clear up to the middle of the approach."""
        if self._options.shape != "flyable":
            return True
        return all(flight.is_clear for flight in self._flights(points_m, reach_m))

    def _flights(self, points_m: FloatArray, reach_m: float) -> Iterator[SimulatedFlight]:
        """Yield the flights up to the middle of the approach, each to where it comes nearer than a reach."""
        landing = self._landing
        tail_m = self._tail_m
        passes_m = np.vstack((self._end_m, points_m))
        radii_m = [*landing.turns.accept_radii_m(tail_m), *landing.turns.accept_radii_m(passes_m)]
        ahead = RemainingMission(
            tuple(_points(np.vstack((tail_m[1:], points_m)))), tuple(map(float, radii_m))
        )
        east_m, north_m = tail_m[0].tolist()
        motion = Motion(east_m, north_m, self._speed_m_s, self._begins_rad, ahead=ahead)
        for_s = (path_length_m(tail_m) + path_length_m(passes_m) - 0.5 * APPROACH_M) / self._speed_m_s
        available_m = min(
            self._available_clearance_m((east_m, north_m)), self._available_clearance_m(self._end_m)
        )
        reach_m = min(reach_m, available_m)
        for lag_s, min_radius_m in (
            (landing.turn_lag_s, landing.turns.radius_m),
            (MIN_RADIUS_SHARE * landing.turn_lag_s, 0.0),
        ):
            yield simulate(self._grid, motion, for_s, lag_s, reach_m, min_radius_m)
        if reach_m > 0.0:
            reach_m = min(reach_m + wind_margin_m(landing.turns), available_m)
        yield from windy_flights(self._grid, motion, for_s, landing.turns, landing.turn_lag_s, reach_m)

    def _available_clearance_m(self, place_m: Point) -> float:
        """Return the distance from obstacles, at most the clearance."""
        grid = self._grid
        clearance_m = self._options.clearance_m
        free = start_clearance(grid.blocked, 2.0 * clearance_m / grid.spacing_m, *to_cells(grid, place_m))
        return float(free) * grid.spacing_m

    def _at(self, distance_m: float, angle_rad: float) -> Point:
        """Return a position by distance and bearing from home, clockwise from north."""
        east_m, north_m = self._home_m
        return east_m + distance_m * math.sin(angle_rad), north_m + distance_m * math.cos(angle_rad)


def _as_route(best: _Graded | None) -> ReturnRoute | None:
    if best is None:
        return None
    grade, points_m, gate = best
    return ReturnRoute(read_only(points_m), False, _NO_APPROACH if gate.share < 0.0 else _NOTES[int(grade)])


def _points(points_m: FloatArray) -> list[Point]:
    return [(east_m, north_m) for east_m, north_m in points_m.tolist()]


def _course_rad(leg_m: FloatArray, start: AgentState) -> float:
    """Return the course along a leg; for a leg of zero length, the vehicle's."""
    (from_east, from_north), (east, north) = leg_m.tolist()
    if math.dist((from_east, from_north), (east, north)) < 1e-6:
        return start.course_rad or 0.0
    return bearing_rad(from_east, from_north, east, north)
