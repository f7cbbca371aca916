"""Terminal loiter: the last approach to a target, and the circle flown afterwards clear of obstacles.

A fixed wing cannot stop. At the end of its mission it enters a circle, and overshoots: by some 60 m for a
circle of 30 m entered over its centre at 15 m/s. A route whose legs are clear may end in a circle that is
not.

So the end of a route is simulated (`gcs.planning.forward_simulation`), over the target and round the circle,
with the expected turn lag and with half of it, in still air and in the greatest wind. Where a circle at the
target lacks clearance, the vehicle passes the target and goes on to the nearest circle that has it. Where no
path on from the target is clear, or the target is over an obstacle, other approaches are tried: from another
direction, or past the target within the capture radius.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gcs.jit import Call, kernel, leaf
from gcs.model import BoolArray, FloatArray
from gcs.planning.flight_variants import flight_variants, wind_margin_m
from gcs.planning.forward_simulation import STEP_S, simulate_states
from gcs.planning.map.grid import Grid, Point, free_grid
from gcs.planning.map.line_of_sight import is_clear_at, is_free_at, line_of_sight, path_clearance, to_cells
from gcs.planning.path.initial_turn import start_clearance
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.planner_inputs import AgentState, LoiterSpec, PlanOptions
from gcs.planning.route_joining import MIN_CLEARANCE_SHARE

_ENOUGH_SHARE = 0.5
"""Share of the clearance that is sufficient. Circles are flown by the autopilot, not by waypoints."""
_NO_CLEARANCE_M = -1.0
MIN_GAIN_M = 2.0
"""Additional clearance that justifies a farther circle or another approach."""
_SIMULATED_RADII = 6.0
"""Simulated end of a route, in turn radii."""
_COURSE_ERROR_RAD = math.radians(15.0)
"""Simulated course error at the start, to either side."""
_AMBIGUOUS_TURN_RAD = math.radians(150.0)
"""Beyond this bearing error a vehicle may turn to either side."""
_RING_RADII = (0.5, 1.0, 1.5, 2.0, 2.5)
_BEARINGS = 12
"""Candidate circles: rings around the target, in turn or loiter radii, and circles per ring."""
_CIRCLE_LAPS = 1.5
_APPROACH_RADII = 1.5
_LEAVE_RADII = 3.5
"""Another approach: length of its straight leg, and distance before the target where it leaves the route, in
turn radii.
"""
_STOP_SHORT_RADII = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 9.0, 13.0, 18.0)
"""Distance before the target where a route ends that cannot pass it, in turn radii."""
_LATERAL_SHARES = (0.0, 0.4, -0.4, 0.7, -0.7)
"""Lateral offsets from the target, as shares of the capture radius."""
_MIN_PASS_S = 2.5
_MAX_PASS_SHARE = 0.6
_REACH_MARGIN = 0.95
"""Time within the capture radius, the share of a pass through its middle that limits it, and a margin."""
_EXIT_SHARES = tuple(np.linspace(0.0, 0.99, 100).tolist())
"""Places on the first leg of a vehicle that leaves an obstacle, as shares of its length."""
_MAX_FLIGHTS = 600
"""Simulated flights after which no other approach is tried. A capture radius of 20 m takes up to 300."""


@dataclass(frozen=True, slots=True)
class TerminalLoiter:
    """End of a route.

    Attributes
    ----------
    points_m : ndarray, shape (k, 2)
        Waypoints of the whole route, possibly with another approach.
    wait_m : tuple of float or None
        Centre of the loiter circle; None: the last waypoint.
    clearance_m : float
        Clearance of the end, up to a sufficient one; negative for a collision.
    passes_target : bool
        True if the target is passed near enough, for long enough.
    """

    points_m: FloatArray
    wait_m: Point | None
    clearance_m: float
    passes_target: bool = True


def plan_terminal_loiter(
    grid: Grid,
    start: AgentState,
    points_m: FloatArray,
    target_m: Point,
    options: PlanOptions,
    spec: LoiterSpec,
) -> TerminalLoiter:
    """Plan the end of a route.

    Parameters
    ----------
    points_m : ndarray, shape (k, 2)
        Waypoints, without the agent's position.
    target_m : tuple of float
        Intercept point; the last waypoint, unless it is over an obstacle.

    Returns
    -------
    TerminalLoiter
        The route as it is, on a map without obstacles, or without a clearance and with room around its end.
    """
    if not grid.blocked.any():
        return TerminalLoiter(points_m, None, math.inf)
    if options.clearance_m <= 0.0 and _has_room(grid, start, points_m, target_m, spec):
        return TerminalLoiter(points_m, None, MIN_GAIN_M)
    circles = _CircleSearch(grid, start, target_m, options, spec)
    best = circles.best(points_m, TerminalLoiter(points_m, None, _NO_CLEARANCE_M, passes_target=False))
    if best.clearance_m >= 0.0:
        return best
    for points in filter(circles.are_free, _approaches(start, points_m, target_m, options, spec)):
        best = circles.best(points, best)
        if best.clearance_m >= circles.enough_m or circles.flights >= _MAX_FLIGHTS:
            break
    return best if best.clearance_m >= 0.0 else _stop_short(circles, start, points_m, best, options)


def _has_room(grid: Grid, start: AgentState, points_m: FloatArray, target_m: Point, spec: LoiterSpec) -> bool:
    """Return True if a route ends straight over its target, with room for the flight onto the circle."""
    before_m, end_m = _with_start(start, points_m)[-2:].tolist()
    turns = spec.turns
    end = (end_m[0], end_m[1])
    if math.dist(end, target_m) > MIN_GAIN_M or math.dist(before_m, end) < 2.0 * turns.radius_m:
        return False
    return line_of_sight(grid, end, end, room_to_circle_m(spec.radius_m, turns) + MIN_GAIN_M)


def room_to_circle_m(radius_m: float, turns: TurnAnticipation) -> float:
    """Return how far a vehicle goes at most from the centre of a circle that it enters straight over it."""
    return max(radius_m, 2.0 * turns.radius_m, turns.lag_m) + 0.5 * turns.lag_m


def _stop_short(
    circles: _CircleSearch,
    start: AgentState,
    points_m: FloatArray,
    best: TerminalLoiter,
    options: PlanOptions,
) -> TerminalLoiter:
    """End a route on a circle before a target that no clear path passes."""
    for radii in _STOP_SHORT_RADII:
        index, path_m, is_whole = split_before_end(
            _with_start(start, points_m), radii * options.turn_radius_m
        )
        if is_whole:
            break
        points = np.vstack((points_m[:index], path_m[:1]))
        found = circles.best(points, best, must_pass=False) if circles.are_free(points) else best
        if found.clearance_m >= 0.0:
            return found
    return best


class _CircleSearch:
    """Search of the loiter circle at the end of a route.

    Attributes
    ----------
    enough_m : float
        Sufficient clearance.
    flights : int
        Flights simulated so far.
    """

    def __init__(
        self, grid: Grid, start: AgentState, target_m: Point, options: PlanOptions, spec: LoiterSpec
    ) -> None:
        self.flights = 0
        self._grid = grid
        self._start = start
        self._spec = spec
        self._speed_m_s = max(start.speed_m_s, 1.0)
        between_m = 0.5 * STEP_S * self._speed_m_s  # from a straight pass to the nearest simulated state
        self._near = np.array([*target_m, max(_REACH_MARGIN * spec.reach_radius_m, between_m)])
        self._near_s = min(_MIN_PASS_S, _MAX_PASS_SHARE * 2.0 * spec.reach_radius_m / self._speed_m_s)
        self._radius_m = options.turn_radius_m
        self._frame = np.array([*grid.origin_m, grid.spacing_m])
        self._variants = _with_course_errors(flight_variants(spec.turns, spec.turn_lag_s, self._speed_m_s))
        self._around_m = np.array([(0.0, 0.0), *places_around(max(self._radius_m, spec.radius_m))])
        self.enough_m = max(_ENOUGH_SHARE * options.clearance_m, MIN_GAIN_M) + wind_margin_m(spec.turns)
        place = (start.east_m, start.north_m) if start.motion is None else start.motion.place_m
        clearance = MIN_CLEARANCE_SHARE * options.clearance_m / grid.spacing_m
        margin = start_clearance(grid.blocked, 2.0 * clearance, *to_cells(grid, place))
        self._least_m = margin * grid.spacing_m

    def are_free(self, points_m: FloatArray) -> bool:
        """Return True if all waypoints lie in free cells of the map."""
        return all(self._grid.is_free((east_m, north_m)) for east_m, north_m in points_m.tolist())

    def best(self, points_m: FloatArray, so_far: TerminalLoiter, *, must_pass: bool = True) -> TerminalLoiter:
        """Return the best end of a route; `so_far` if that is about as good."""
        spec = self._spec
        spacing_m = self._grid.spacing_m
        speed_m_s = self._speed_m_s
        path_m, is_whole = self._simulated_path(points_m)
        floor_m = so_far.clearance_m if so_far.clearance_m >= 0.0 else self._least_m - MIN_GAIN_M
        circles = np.column_stack((path_m[-1] + self._around_m, np.full(len(self._around_m), spec.radius_m)))
        round_m = (
            _RING_RADII[-1] * max(self._radius_m, spec.radius_m)
            + _CIRCLE_LAPS * 2.0 * math.pi * spec.radius_m
        )
        found, margin, flights = best_loiter_circle(
            self._grid.blocked,
            self._frame,
            self._motion(path_m, is_whole=is_whole),
            path_m[1:],
            spec.turns.accept_radii_m(path_m),
            circles,
            self._near,
            self._near_s if must_pass else 0.0,
            np.array([path_length_m(path_m), round_m]) / speed_m_s,
            self._variants if is_whole else self._variants[self._variants[:, 5] == 0.0],
            np.array([floor_m, MIN_GAIN_M, self.enough_m]) / spacing_m,
        )
        self.flights += flights
        if found < 0:
            return so_far
        centre = (float(circles[found, 0]), float(circles[found, 1]))
        return TerminalLoiter(points_m, centre if found else None, float(margin) * spacing_m, must_pass)

    def _simulated_path(self, points_m: FloatArray) -> tuple[FloatArray, bool]:
        """Return the end of a route that is simulated, and True if that is the whole route.

        A vehicle inside an obstacle leaves it first: the simulation begins where its first leg is free.
        """
        _, path_m, is_whole = split_before_end(
            _with_start(self._start, points_m), _SIMULATED_RADII * self._radius_m
        )
        if not is_whole or self._grid.is_free(_point(path_m[0])):
            return path_m, is_whole
        begins = (path_m[0] + share * (path_m[1] - path_m[0]) for share in _EXIT_SHARES)
        begin = next((place for place in begins if self._grid.is_free(_point(place))), path_m[0])
        return np.vstack((begin, path_m[1:])), False

    def _motion(self, path_m: FloatArray, *, is_whole: bool) -> FloatArray:
        """Return the motion at the start of a path: east, north, course, turn rate, speed."""
        start = self._start
        if is_whole and start.motion is not None:
            now = start.motion
            return np.array([*now.place_m, now.course_rad, now.turn_rate_rad_s, self._speed_m_s, 0.0, 0.0])
        is_known = is_whole and start.course_rad is not None
        course_rad = start.course_rad if is_known else _course_rad(path_m)
        return np.array([*path_m[0], course_rad, 0.0, self._speed_m_s, 0.0, 0.0])


def _with_course_errors(variants: FloatArray) -> FloatArray:
    """Return flights on the course (k + 2, 6), and two in still air that begin beside it."""
    result = np.column_stack((variants, np.zeros(len(variants))))
    beside = np.repeat(result[:1], 2, axis=0)
    beside[:, 5] = (_COURSE_ERROR_RAD, -_COURSE_ERROR_RAD)
    return np.vstack((result[:2], beside, result[2:]))


def _point(place_m: FloatArray) -> Point:
    return float(place_m[0]), float(place_m[1])


def places_around(radius_m: float) -> Iterator[Point]:
    """Yield the centres of candidate circles relative to the target, the nearest first."""
    for ring in _RING_RADII:
        for k in range(_BEARINGS):
            angle = 2.0 * math.pi * k / _BEARINGS
            yield ring * radius_m * math.sin(angle), ring * radius_m * math.cos(angle)


def _approaches(
    start: AgentState, points_m: FloatArray, target_m: Point, options: PlanOptions, spec: LoiterSpec
) -> Iterator[FloatArray]:
    """Yield routes that pass a target from other directions or with an offset, the most similar first."""
    radius_m = options.turn_radius_m
    index, path_m, is_whole = split_before_end(_with_start(start, points_m), _LEAVE_RADII * radius_m)
    left = path_m[:0] if is_whole else path_m[:1]
    course_rad = _course_rad(path_m[-2:])
    for k in range(_BEARINGS):
        angle = course_rad + 2.0 * math.pi * ((k + 1) // 2 * (1 - 2 * (k % 2))) / _BEARINGS
        along = np.array([math.sin(angle), math.cos(angle)])
        for share in _LATERAL_SHARES:
            passed = np.array(target_m) + share * spec.reach_radius_m * np.array([along[1], -along[0]])
            yield np.vstack((points_m[:index], left, passed - _APPROACH_RADII * radius_m * along, passed))


def _with_start(start: AgentState, points_m: FloatArray) -> FloatArray:
    return np.vstack(((start.east_m, start.north_m), points_m))


def split_before_end(path_m: FloatArray, length_m: float) -> tuple[int, FloatArray, bool]:
    """Split a path, the vehicle's position first, at a distance before its end.

    Returns the index of the first waypoint behind the split, the rest of the path, and True if that is all of
    it.
    """
    left_m = length_m
    for index in range(len(path_m) - 2, -1, -1):
        leg = path_m[index] - path_m[index + 1]
        leg_m = float(np.hypot(*leg))
        if leg_m > left_m:
            place_m = path_m[index + 1] + leg * (left_m / leg_m)
            return index, np.vstack((place_m, path_m[index + 1 :])), False
        left_m -= leg_m
    return 0, path_m, True


def _course_rad(path_m: FloatArray) -> float:
    return math.atan2(path_m[1, 0] - path_m[0, 0], path_m[1, 1] - path_m[0, 1])


def path_length_m(path_m: FloatArray) -> float:
    """Return the length of a path (n, 2) along its legs."""
    return float(np.hypot(*np.diff(path_m, axis=0).T).sum())


@leaf
def _time_within(flight: FloatArray, reach_circle: FloatArray) -> float:
    """Return how long a flight is within a distance of a place."""
    count = 0
    for i in range(flight.shape[0]):
        count += math.hypot(flight[i, 0] - reach_circle[0], flight[i, 1] - reach_circle[1]) <= reach_circle[2]
    return count * STEP_S


@leaf
def _is_open(blocked: BoolArray, frame: FloatArray, circle: FloatArray, clearance: float) -> bool:
    """Return True if a circle and its inside keep `clearance`: some vehicles fly it tighter.

    Its centre is on the map.
    """
    x = (circle[0] - frame[0]) / frame[2]
    y = (circle[1] - frame[1]) / frame[2]
    return is_free_at(blocked, x, y) and is_clear_at(blocked, x, y, circle[2] / frame[2] + clearance)


@kernel
def best_loiter_circle(
    blocked: BoolArray, frame: FloatArray, motion: FloatArray, points: FloatArray, radii: FloatArray,
    circles: FloatArray, reach_circle: FloatArray, min_reach_s: float, times_s: FloatArray,
    variants: FloatArray, thresholds: FloatArray,
) -> tuple[int, float, int]:  # fmt: skip
    """Return the index of the first circle with the most clearance or -1, that in cells, and the flights.

    `circles` (n, 3): east, north, radius. `reach_circle`: place to pass within a distance, for `min_reach_s`.
    `times_s`: duration of the path and of the circle. `variants` (k, 6): those of `flight_variants`, and
    course errors. `thresholds`: clearance so far, required gain, sufficient clearance. The others as of
    `simulate_states`.
    """
    best = thresholds[0]
    found = -1
    none = np.array([0.0, 0.0, -1.0])
    flown = motion.copy()
    flights = 0
    for i in range(variants.shape[0]):  # most collisions occur before the circle
        clearance = max(best + thresholds[1], 0.0)
        flown[2] = motion[2] + variants[i, 5]
        flown[5] = variants[i, 3]
        flown[6] = variants[i, 4]
        flights += 1
        _, is_clear, off = simulate_states(
            blocked,
            frame,
            flown,
            points,
            radii,
            none,
            times_s[0],
            variants[i, 0],
            variants[i, 1],
            clearance,
            variants[i, 2],
        )
        if not is_clear or off > _AMBIGUOUS_TURN_RAD:
            return -1, best, flights
    for k in range(circles.shape[0]):
        clearance = max(best + thresholds[1], 0.0)
        if not _is_open(blocked, frame, circles[k], clearance):
            continue
        margin = thresholds[2]
        for i in range(variants.shape[0]):
            flown[2] = motion[2] + variants[i, 5]
            flown[5] = variants[i, 3]
            flown[6] = variants[i, 4]
            flights += 1
            flight, is_clear, off = simulate_states(
                blocked,
                frame,
                flown,
                points,
                radii,
                circles[k],
                times_s[0] + times_s[1],
                variants[i, 0],
                variants[i, 1],
                clearance,
                variants[i, 2],
            )
            if not is_clear or off > _AMBIGUOUS_TURN_RAD or _time_within(flight, reach_circle) < min_reach_s:
                margin = -1.0
                break
            margin = path_clearance(blocked, frame, flight, margin)
        if margin >= clearance:
            best = margin
            found = k
        if best >= thresholds[2]:
            break
    return found, best, flights


def warm_up_calls() -> list[Call]:
    """Return one call of the kernel with the types of a plan."""
    grid = free_grid((2, 2), 10.0)
    three = np.ones(3)
    points = np.zeros((1, 2))
    radii = np.zeros(1)
    circles = np.ones((1, 3))
    times_s = np.full(2, 0.2)
    return [
        (
            best_loiter_circle,
            grid.blocked,
            three,
            np.zeros(7),
            points,
            radii,
            circles,
            three,
            0.0,
            times_s,
            np.ones((1, 6)),
            three,
        )
    ]
