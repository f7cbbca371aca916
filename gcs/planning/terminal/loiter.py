"""How a route ends: the last approach to its target, and the circle on which the vehicle waits afterwards.

A fixed wing cannot stop. Where its mission ends it circles, and what it flies before it is on its circle is
wider than that: some 60 m for a circle of 30 m entered over its centre at 15 m/s. Targets go where they like,
beside obstacles too; there, a route whose every leg is clear ends in a circle that is not.

So the end of a route is flown ahead in thought (`gcs.planning.vehicle_model`), over the target and round a
circle, with the expected turn lag and with half of it. Where circling at the target does not keep enough
room, the vehicle passes over the target and goes on to a circle that does, as near as there is one. Where no
way on from the target is clear, or the target is over an obstacle, another approach is looked for: in another
direction, or beside the target, near enough to have reached it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gcs.jit import Call, kernel, leaf
from gcs.model import FloatArray
from gcs.planning.map.grid import Grid, Point, free_grid
from gcs.planning.map.line_of_sight import is_clear_at, leg_room, to_cells
from gcs.planning.options import AgentState, LoiterSpec, PlanOptions
from gcs.planning.path.initial_turn import TIGHT, start_room
from gcs.planning.route_capture import SHARE
from gcs.planning.vehicle_model import STEP_S, simulate_states

_ENOUGH = 0.5
"""Of the clearance: what is not looked beyond. Circles are flown by the autopilot, not by waypoints."""
_NONE_M = -1.0
_BETTER_M = 2.0
"""A farther circle, or another approach, must have so much more room."""
_FLOWN = 6.0
"""How much of a route is flown ahead, in turn radii."""
_OFF_COURSE = np.radians([0.0, 0.0, 15.0, -15.0])
"""An agent may begin its route so far off the expected course."""
_EITHER_SIDE = math.radians(150.0)
"""What lies so far off its course a vehicle may turn to either way."""
_RINGS = (0.5, 1.0, 1.5, 2.0, 2.5)
_BEARINGS = 12
"""Where circles are looked for: rings around the target, in turn radii, and how many on each."""
_ROUNDS = 1.5
_LEG, _LEAVE = 1.5, 3.5
"""Another approach: its straight leg, and how far before the target the route is left; in turn radii."""
_SHORT = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0)
"""How far before its target a route ends that cannot pass it, in turn radii."""
_BESIDE = (0.0, 0.4, -0.4, 0.7, -0.7)
"""How far beside a target it may be passed, of the distance at which it counts as reached."""
_NEAR_S, _NEAR_SHARE, _NEAR = 2.5, 0.6, 0.95
"""How long a target must be passed near enough; at most that share of what passing over its middle takes."""


@dataclass(frozen=True, slots=True)
class TerminalLoiter:
    """The end of a route.

    Attributes
    ----------
    points_m : ndarray, shape (k, 2)
        Of the whole route, perhaps with another approach.
    wait_m : tuple of float or None
        Centre of the circle to wait on; None: the route's last point.
    room_m : float
        What the vehicle keeps from obstacles there, no more than is enough; negative when it would hit one.
    passes : bool
        Whether its target is passed near enough, for long enough.
    """

    points_m: FloatArray
    wait_m: Point | None
    room_m: float
    passes: bool = True


def ending(
    grid: Grid,
    start: AgentState,
    points_m: FloatArray,
    target_m: Point,
    options: PlanOptions,
    spec: LoiterSpec,
) -> TerminalLoiter:
    """Find how a route should end.

    Parameters
    ----------
    points_m : ndarray, shape (k, 2)
        Of the route, the agent's place excluded.
    target_m : tuple of float
        Where the target is met; the route's last point, unless it is over an obstacle.

    Returns
    -------
    Ending
        As the route is where there are no obstacles, and without a clearance: corners are cut then, too.
    """
    straight = TerminalLoiter(points_m, None, math.inf)
    if options.clearance_m <= 0.0 or not grid.blocked.any():
        return straight
    circles = _Circles(grid, start, target_m, options, spec)
    best = circles.best(points_m, TerminalLoiter(points_m, None, _NONE_M, passes=False))
    if best.room_m >= 0.0:
        return best
    for points in _approaches(start, points_m, target_m, options, spec):
        best = circles.best(points, best)
        if best.room_m >= circles.enough_m:
            break
    return best if best.room_m >= 0.0 else _short_of(circles, start, points_m, best, options)


def _short_of(
    circles: _Circles, start: AgentState, points_m: FloatArray, best: TerminalLoiter, options: PlanOptions
) -> TerminalLoiter:
    """Let a route end on a circle before its target, which no clear way passes."""
    for radii in _SHORT:
        index, way_m, is_whole = cut(_whole(start, points_m), radii * options.turn_radius_m)
        if is_whole:
            break
        found = circles.best(np.vstack((points_m[:index], way_m[:1])), best, must_pass=False)
        if found.room_m >= 0.0:
            return found
    return best


class _Circles:
    """Finds the circle that a route should end with.

    Attributes
    ----------
    enough_m : float
        More room than that is not looked for.
    """

    def __init__(
        self, grid: Grid, start: AgentState, target_m: Point, options: PlanOptions, spec: LoiterSpec
    ) -> None:
        self._grid, self._start, self._spec = grid, start, spec
        self._speed_m_s = max(start.speed_m_s, 1.0)
        between_m = 0.5 * STEP_S * self._speed_m_s  # from a straight pass to the nearest simulated state
        self._near = np.array([*target_m, max(_NEAR * spec.reach_radius_m, between_m)])
        self._near_s = min(_NEAR_S, _NEAR_SHARE * 2.0 * spec.reach_radius_m / self._speed_m_s)
        self._radius_m = options.turn_radius_m
        self._frame = np.array([*grid.origin_m, grid.spacing_m])
        self._lags_s = np.array([spec.turn_lag_s, TIGHT * spec.turn_lag_s, spec.turn_lag_s, spec.turn_lag_s])
        self._around_m = np.array([(0.0, 0.0), *_around(self._radius_m)])
        self.enough_m = max(_ENOUGH * options.clearance_m, _BETTER_M)
        place = (start.east_m, start.north_m) if start.motion is None else start.motion.place_m
        reach = SHARE * options.clearance_m / grid.spacing_m
        room = start_room(grid.blocked, 2.0 * reach, *to_cells(grid, place))
        self._least_m = room * grid.spacing_m

    def best(self, points_m: FloatArray, so_far: TerminalLoiter, *, must_pass: bool = True) -> TerminalLoiter:
        """Return the best ending of a route, unless what there is so far is about as good."""
        spec, spacing_m, speed_m_s = self._spec, self._grid.spacing_m, self._speed_m_s
        _, way_m, is_whole = cut(_whole(self._start, points_m), _FLOWN * self._radius_m)
        floor_m = so_far.room_m if so_far.room_m >= 0.0 else self._least_m - _BETTER_M
        circles = np.column_stack((way_m[-1] + self._around_m, np.full(len(self._around_m), spec.radius_m)))
        round_m = _RINGS[-1] * self._radius_m + _ROUNDS * 2.0 * math.pi * spec.radius_m
        found, room = best_circle(
            self._grid.blocked,
            self._frame,
            self._motion(way_m, is_whole=is_whole),
            way_m[1:],
            spec.turns.accept_radii_m(way_m),
            circles,
            self._near,
            self._near_s if must_pass else 0.0,
            np.array([path_length_m(way_m), round_m]) / speed_m_s,
            self._lags_s if is_whole else self._lags_s[:2],
            _OFF_COURSE,
            np.array([floor_m, _BETTER_M, self.enough_m]) / spacing_m,
        )
        if found < 0:
            return so_far
        centre = (float(circles[found, 0]), float(circles[found, 1]))
        return TerminalLoiter(points_m, centre if found else None, float(room) * spacing_m, must_pass)

    def _motion(self, way_m: FloatArray, *, is_whole: bool) -> FloatArray:
        """How the vehicle moves where a way begins: east, north, course, turn rate, speed."""
        start = self._start
        if is_whole and start.motion is not None:
            now = start.motion
            return np.array([*now.place_m, now.course_rad, now.turn_rate_rad_s, self._speed_m_s])
        is_known = is_whole and start.course_rad is not None
        course_rad = start.course_rad if is_known else _course_rad(way_m)
        return np.array([*way_m[0], course_rad, 0.0, self._speed_m_s])


def _around(radius_m: float) -> Iterator[Point]:
    """Yield where circles are looked for, from the target: the nearest first."""
    for ring in _RINGS:
        for k in range(_BEARINGS):
            angle = 2.0 * math.pi * k / _BEARINGS
            yield ring * radius_m * math.sin(angle), ring * radius_m * math.cos(angle)


def _approaches(
    start: AgentState, points_m: FloatArray, target_m: Point, options: PlanOptions, spec: LoiterSpec
) -> Iterator[FloatArray]:
    """Yield routes that pass a target in other directions, or beside it; the least different first."""
    radius_m = options.turn_radius_m
    index, way_m, is_whole = cut(_whole(start, points_m), _LEAVE * radius_m)
    left = way_m[:0] if is_whole else way_m[:1]
    course_rad = _course_rad(way_m[-2:])
    for k in range(_BEARINGS):
        angle = course_rad + 2.0 * math.pi * ((k + 1) // 2 * (1 - k % 2 * 2)) / _BEARINGS
        along = np.array([math.sin(angle), math.cos(angle)])
        for share in _BESIDE:
            passed = np.array(target_m) + share * spec.reach_radius_m * np.array([along[1], -along[0]])
            yield np.vstack((points_m[:index], left, passed - _LEG * radius_m * along, passed))


def _whole(start: AgentState, points_m: FloatArray) -> FloatArray:
    return np.vstack(((start.east_m, start.north_m), points_m))


def cut(way_m: FloatArray, length_m: float) -> tuple[int, FloatArray, bool]:
    """Cut a way, its vehicle's place first, so long before its end.

    Returns the number of the first point behind that, the agent's place not counted; the way on; and whether
    that is all of it.
    """
    left_m = length_m
    for index in range(len(way_m) - 2, -1, -1):
        leg = way_m[index] - way_m[index + 1]
        leg_m = float(np.hypot(*leg))
        if leg_m > left_m:
            place_m = way_m[index + 1] + leg * (left_m / leg_m)
            return index, np.vstack((place_m, way_m[index + 1 :])), False
        left_m -= leg_m
    return 0, way_m, True


def _course_rad(way_m: FloatArray) -> float:
    return math.atan2(way_m[1, 0] - way_m[0, 0], way_m[1, 1] - way_m[0, 1])


def path_length_m(way_m: FloatArray) -> float:
    """Length of a way (n, 2) along its legs."""
    return float(np.hypot(*np.diff(way_m, axis=0).T).sum())


@leaf
def _least_room(blocked, frame, way, most):  # type: ignore[no-untyped-def]
    """Least distance in cells of a flight from blocked cells, at most `most`."""
    room = most
    for i in range(way.shape[0] - 1):
        x, y = (way[i, 0] - frame[0]) / frame[2], (way[i, 1] - frame[1]) / frame[2]
        to_x, to_y = (way[i + 1, 0] - frame[0]) / frame[2], (way[i + 1, 1] - frame[1]) / frame[2]
        room = leg_room(blocked, x, y, to_x, to_y, room, np.int64(-1))
    return room


@leaf
def _time_near(way, near):  # type: ignore[no-untyped-def]
    """How long a flight is within a distance of a place."""
    count = 0
    for i in range(way.shape[0]):
        count += math.hypot(way[i, 0] - near[0], way[i, 1] - near[1]) <= near[2]
    return count * STEP_S


@leaf
def _is_open(blocked, frame, circle, reach):  # type: ignore[no-untyped-def]
    """Whether a circle and all within it keep `reach`: some vehicles fly it tighter."""
    x, y = (circle[0] - frame[0]) / frame[2], (circle[1] - frame[1]) / frame[2]
    return is_clear_at(blocked, x, y, circle[2] / frame[2] + reach)


@kernel
def best_circle(  # type: ignore[no-untyped-def]
    blocked, frame, motion, points, radii, circles, near, near_s, times_s, lags_s, off_course, rooms
):
    """Number of the first circle with the most room, flown to on a way, and the room, in cells; -1 for none.

    `circles` (n, 3): east, north, radius. `near`: a place to be passed within a distance, `near_s` long.
    `times_s`: how long the way takes, and the circle. `rooms`: what there is already, how much more it must
    be, and how much is enough. The others as of `simulate_states`.
    """
    best, found, none = rooms[0], -1, np.array([0.0, 0.0, -1.0])
    flown = motion.copy()
    for i in range(lags_s.size):  # most ways that lead into something do before the circle
        reach = max(best + rooms[1], 0.0)
        flown[2] = motion[2] + off_course[i]
        _, is_clear, off = simulate_states(
            blocked, frame, flown, points, radii, none, times_s[0], lags_s[i], reach
        )
        if not is_clear or off > _EITHER_SIDE:
            return -1, best
    for k in range(circles.shape[0]):
        reach = max(best + rooms[1], 0.0)
        if not _is_open(blocked, frame, circles[k], reach):
            continue
        room = rooms[2]
        for i in range(lags_s.size):
            flown[2] = motion[2] + off_course[i]
            way, is_clear, off = simulate_states(
                blocked, frame, flown, points, radii, circles[k], times_s[0] + times_s[1], lags_s[i], reach
            )
            room = _least_room(blocked, frame, way, room)
            if not is_clear or off > _EITHER_SIDE or _time_near(way, near) < near_s:
                room = -1.0
                break
        if room >= reach:
            best, found = room, k
        if best >= rooms[2]:
            break
    return found, best


def warm_up_calls() -> list[Call]:
    """One call of the kernel, types as in a plan."""
    grid, three = free_grid((2, 2), 10.0), np.ones(3)
    points, radii, circles = np.zeros((1, 2)), np.zeros(1), np.ones((1, 3))
    times_s = np.full(2, 0.2)
    return [
        (
            best_circle,
            grid.blocked,
            three,
            np.zeros(5),
            points,
            radii,
            circles,
            three,
            0.0,
            times_s,
            times_s,
            times_s,
            three,
        )
    ]
