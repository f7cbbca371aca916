"""The way home of a vehicle that lands: from where its route ends to an approach, and along that to home.

A landing begins on a straight leg (`APPROACH_M`) that ends at home. It comes from where the route ends, as
long as the straight way there, the leg and the turns on to them are clear. Else the leg is looked for all
round home, and the way to it is a route like any other: by the same search, with the same clearance and turns
that can be flown. It comes on to the leg straight, or by a base leg to either side of it, as in a traffic
pattern. The shortest way is taken whose legs keep the most of the clearance and which is clear when it is
flown ahead in thought (`gcs.planning.vehicle_model`), from before the target to the middle of the leg, with
the expected turn lag and with half of it.

Nobody is refused to land: where no way is clear, the best there is goes with a word of what is wrong with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from gcs.geo import bearing_rad, wrap_pi
from gcs.model import APPROACH_M, FloatArray, read_only
from gcs.planning.map.grid import Grid, Point
from gcs.planning.map.line_of_sight import line_of_sight, to_cells
from gcs.planning.options import AgentState, PlanOptions, TargetDemand
from gcs.planning.path.initial_turn import TIGHT, start_is_safe, start_room
from gcs.planning.path.initial_turn_search import SPLIT
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.route_capture import SHARE
from gcs.planning.route_search import Search
from gcs.planning.terminal.loiter import cut, path_length_m
from gcs.planning.vehicle_model import Motion, RemainingMission, simulate

_BEARINGS = 36
_SHARES = (1.0, 0.5, SHARE, 0.0)
"""Of the clearance: what the straight legs of a landing keep; rather more, by however long a way."""
_BASE = 2.5
"""Length of a base leg, in turn radii."""
_FLOWN = 6.0
"""How much of the route before is flown ahead, in turn radii."""
_RINGS, _TURNS = (1.0, 2.0, 3.0), tuple(np.radians([0.0, 30.0, -30.0, 60.0, -60.0]).tolist())
"""Where a vehicle may go on to from its target, where it cannot turn: in turn radii, and off its course."""
_GATES_AFTER = 6
"""How many gates are tried from each."""
_CLEAR, _NEAR, _TOO_NEAR, _SHARP = range(4)
_WORDS = {
    _CLEAR: "",
    _NEAR: "its way home comes nearer to obstacles than the clearance: no way keeps away",
    _TOO_NEAR: "its way home leads by obstacles so closely that its turns leave hardly any room",
    _SHARP: "its way home has turns that may lead into obstacles",
}
_NO_WAY = "no clear way home: it flies straight to its landing, through obstacles"
_NO_APPROACH = "no clear approach to its home: the last leg of its landing leads through obstacles"


@dataclass(frozen=True, slots=True)
class LandingSpec:
    """How vehicles fly home."""

    turns: TurnAnticipation
    """How early they turn."""
    turn_lag_s: float
    """Until a turn is taken up."""


@dataclass(frozen=True, slots=True)
class ReturnRoute:
    """What a vehicle flies after its route.

    Attributes
    ----------
    points_m : ndarray, shape (k, 2)
        The corners, where the approach begins, and home.
    is_straight : bool
        Whether it goes straight to the approach, which comes from where the route ends.
    problem : str
        What an operator should know of it; empty when it is clear.
    """

    points_m: FloatArray
    is_straight: bool
    problem: str = ""


@dataclass(frozen=True, slots=True)
class _Gate:
    """Where a way joins a landing, and the straight legs from there."""

    points_m: tuple[Point, ...]
    """The gate, perhaps where the approach begins, and home."""
    share: float
    """Of the clearance, that its legs keep; negative where they lead through something."""

    @property
    def length_m(self) -> float:
        return math.fsum(math.dist(a, b) for a, b in pairwise(self.points_m))


_Graded: TypeAlias = tuple[int, FloatArray, _Gate]
"""What keeps a way from being clear, its points, and where it joins a landing."""


def plan_return_route(
    grid: Grid,
    start: AgentState,
    points_m: FloatArray,
    home_m: Point,
    options: PlanOptions,
    landing: LandingSpec,
) -> ReturnRoute:
    """Plan the way home of a vehicle.

    Parameters
    ----------
    start : AgentStart
        Where its route begins.
    points_m : ndarray, shape (k, 2)
        Of the route, the vehicle's place excluded; k >= 1.
    home_m : tuple of float
        East and north of where it lands.
    """
    planner = _Planner(grid, start, points_m, home_m, options, landing)
    straight = planner.straight()
    if not grid.blocked.any() or planner.is_clear(straight):
        return ReturnRoute(straight, is_straight=True)
    return planner.around() or ReturnRoute(straight, is_straight=True, problem=_NO_WAY)


class _Planner:
    """Plans one way home."""

    def __init__(
        self,
        grid: Grid,
        start: AgentState,
        points_m: FloatArray,
        home_m: Point,
        options: PlanOptions,
        landing: LandingSpec,
    ) -> None:
        self._grid, self._options, self._landing = grid, options, landing
        self._home_m = home_m
        self._speed_m_s = max(start.speed_m_s, 1.0)
        self._end_m = (float(points_m[-1, 0]), float(points_m[-1, 1]))
        way_m = np.vstack(((start.east_m, start.north_m), points_m))
        _, self._tail_m, is_whole = cut(way_m, _FLOWN * options.turn_radius_m)
        leaves, comes = (_course_rad(way_m[-2:], start), _course_rad(self._tail_m[:2], start))
        self._course_rad = leaves
        self._begins_rad = start.course_rad if is_whole and start.course_rad is not None else comes

    def straight(self) -> FloatArray:
        """Return the way home without obstacles."""
        return read_only([self._at(APPROACH_M, self._from_rad), self._home_m])

    @property
    def _from_rad(self) -> float:
        """Where the route ends, seen from home; to the north when it ends there."""
        return bearing_rad(*self._home_m, *self._end_m) if self._end_m != self._home_m else 0.0

    def is_clear(self, points_m: FloatArray) -> bool:
        """Whether a way from the route's end keeps the clearance where its ends do, and is flown clear."""
        clearance_m, places = self._options.clearance_m, [self._end_m, *_points(points_m)]
        for a, b in pairwise(places):
            if not line_of_sight(self._grid, a, b, min(clearance_m, self._room_m(a), self._room_m(b))):
                return False
        return self._turns_safely(places[1]) and self._is_flown_clear(points_m, SHARE * clearance_m)

    def around(self) -> ReturnRoute | None:
        """Return the best way that is planned; None when there is none."""
        gates = list(self._gates())
        if not gates:
            return None
        best = self._best(gates, np.empty((0, 2)), self._course_rad, None)
        for leaves_m in self._leaves() if best is not None and best[0] >= _TOO_NEAR else ():
            best = self._best(gates, np.array([leaves_m]), bearing_rad(*self._end_m, *leaves_m), best)
            if best is not None and best[0] < _TOO_NEAR:
                break
        if best is None:
            return None
        grade, points_m, gate = best
        return ReturnRoute(read_only(points_m), False, _NO_APPROACH if gate.share < 0.0 else _WORDS[grade])

    def _best(
        self, gates: list[_Gate], left_m: FloatArray, course_rad: float, best: _Graded | None
    ) -> _Graded | None:
        """Return the best way from the route's end, or from where it goes on to, to any gate."""
        east_m, north_m = left_m[0].tolist() if len(left_m) else self._end_m
        start = AgentState(east_m, north_m, course_rad, self._speed_m_s)
        options = replace(self._options, horizon_s=0.0, cost="length")
        places = [gate.points_m[0] for gate in gates]
        search = Search(self._grid, [start], places, [TargetDemand()] * len(gates), options)
        lengths_m = search.costs[0] + [gate.length_m for gate in gates]
        order = sorted(range(len(gates)), key=lambda j: (-gates[j].share, lengths_m[j]))
        reached = [j for j in order if math.isfinite(lengths_m[j])]
        for j in reached[:_GATES_AFTER] if len(left_m) else reached:
            aimed = search.route(0, j)
            points_m = np.vstack((left_m, aimed.points_m, gates[j].points_m[1:]))
            if self._is_sharp(points_m, len(left_m) + len(aimed.points_m)):
                continue
            grade = self._grade(points_m, is_roomy=not aimed.notes and gates[j].share == 1.0)
            if best is None or grade < best[0]:
                best = grade, points_m, gates[j]
            if grade == _CLEAR:
                break
        return best

    def _leaves(self) -> Iterator[Point]:
        """Yield where a vehicle may go on to from its route's end before it turns home, the nearest first."""
        for ring in _RINGS if self._options.shape == "flyable" else ():
            for turn in _TURNS:
                angle, distance_m = self._course_rad + turn, ring * self._options.turn_radius_m
                east_m, north_m = self._end_m
                place_m = (east_m + distance_m * math.sin(angle), north_m + distance_m * math.cos(angle))
                if self._share(place_m, self._end_m) >= 0.0:
                    yield place_m

    def _gates(self) -> Iterator[_Gate]:
        """Yield where ways may join a landing: at its approach, or at a base leg to either side."""
        grid, base_m = self._grid, _BASE * self._options.turn_radius_m
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
        approach_m = self._at(APPROACH_M, self._from_rad)
        if not found and line_of_sight(grid, approach_m, approach_m):
            yield _Gate((approach_m, self._home_m), -1.0)

    def _share(self, from_m: Point, to_m: Point) -> float:
        """How much of the clearance a leg keeps; negative for one through something, or from off the map.

        A home where there is less room does not count against it.
        """
        grid, clearance_m = self._grid, self._options.clearance_m
        if not grid.contains(from_m) and grid.contains(self._home_m):
            return -1.0
        room_m = self._room_m(to_m)
        for share in _SHARES:
            if line_of_sight(grid, from_m, to_m, min(share * clearance_m, room_m)):
                return share
        return -1.0

    def _grade(self, points_m: FloatArray, *, is_roomy: bool) -> int:
        if self._is_flown_clear(points_m, SHARE * self._options.clearance_m):
            return _CLEAR if is_roomy else _NEAR
        return _TOO_NEAR if self._is_flown_clear(points_m, 0.0) else _SHARP

    def _is_sharp(self, points_m: FloatArray, joined: int) -> bool:
        """Whether a way turns too sharply where it joins the straight legs of a landing."""
        if self._options.shape != "flyable":
            return False
        a, b, c = np.vstack((self._end_m, points_m))[joined - 1 : joined + 2]
        return abs(wrap_pi(bearing_rad(*a, *b) - bearing_rad(*b, *c))) > SPLIT

    def _turns_safely(self, to_m: Point) -> bool:
        """Whether the turn at the route's end is clear: to either side, where it may be."""
        grid, options = self._grid, self._options
        if options.shape != "flyable":
            return True
        place, spacing_m = to_cells(grid, self._end_m), grid.spacing_m
        room = start_room(grid.blocked, options.clearance_m / spacing_m, *place)
        angle, radius = 0.5 * math.pi - self._course_rad, options.turn_radius_m / spacing_m
        return bool(start_is_safe(grid.blocked, room, *place, angle, *to_cells(grid, to_m), radius, -1))

    def _is_flown_clear(self, points_m: FloatArray, reach_m: float) -> bool:
        """Whether a way is clear as it is flown, up to the middle of the approach, which is clear anyway."""
        if self._options.shape != "flyable":
            return True
        landing, tail_m = self._landing, self._tail_m
        passes_m = np.vstack((self._end_m, points_m))
        radii_m = [*landing.turns.accept_radii_m(tail_m), *landing.turns.accept_radii_m(passes_m)]
        ahead = RemainingMission(
            tuple(_points(np.vstack((tail_m[1:], points_m)))), tuple(map(float, radii_m))
        )
        east_m, north_m = tail_m[0].tolist()
        motion = Motion(east_m, north_m, self._speed_m_s, self._begins_rad, ahead=ahead)
        for_s = (path_length_m(tail_m) + path_length_m(passes_m) - 0.5 * APPROACH_M) / self._speed_m_s
        reach_m = min(reach_m, self._room_m((east_m, north_m)), self._room_m(self._end_m))
        return all(
            simulate(self._grid, motion, for_s, lag_s, reach_m).is_clear
            for lag_s in (landing.turn_lag_s, TIGHT * landing.turn_lag_s)
        )

    def _room_m(self, place_m: Point) -> float:
        """Distance from obstacles, no more than the clearance."""
        grid, clearance_m = self._grid, self._options.clearance_m
        room = start_room(grid.blocked, 2.0 * clearance_m / grid.spacing_m, *to_cells(grid, place_m))
        return float(room) * grid.spacing_m

    def _at(self, distance_m: float, angle_rad: float) -> Point:
        """Return a place seen from home; clockwise from north."""
        east_m, north_m = self._home_m
        return east_m + distance_m * math.sin(angle_rad), north_m + distance_m * math.cos(angle_rad)


def _points(points_m: FloatArray) -> list[Point]:
    return [(east_m, north_m) for east_m, north_m in points_m.tolist()]


def _course_rad(leg_m: FloatArray, start: AgentState) -> float:
    """Course along a leg; of one without length, the vehicle's."""
    (from_east, from_north), (east, north) = leg_m.tolist()
    if math.dist((from_east, from_north), (east, north)) < 1e-6:
        return start.course_rad or 0.0
    return bearing_rad(from_east, from_north, east, north)
