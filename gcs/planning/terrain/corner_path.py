"""Paths of straight legs with a turn at each corner, as autopilots fly them, and their shortening.

A corner with a turn of angle a is flown as an arc of radius R that touches both legs at R tan(a/2) before and
behind it. The ends of a path are poses, or points where a loiter circle is left or entered on a tangent.

`shorten_path` moves, joins and drops corners as long as the path gets shorter and heights inside the band
remain for all of it. The interval of heights (`gcs.planning.terrain.intervals`) is kept at each corner, from
the start and from the goal. So a change costs only the legs that it changes: the interval that it leads to
must meet the one from which the goal can be reached.

Lengths in metres from node (0, 0) of the band, angles counter-clockwise from east.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import kernel, leaf, spliced
from gcs.model import Float32Array, FloatArray
from gcs.planning.path.corner_splitting import MAX_TURN_RAD
from gcs.planning.terrain.band import read_limits
from gcs.planning.terrain.intervals import begin
from gcs.planning.terrain.pose_search import fly_arc_and_line, tangent

_FIT_M = 1e-6
_LEAST_GAIN_M = 0.05
_STEPS_M = np.array([80.0, 40.0, 20.0, 10.0, 5.0, 2.5])
_DROPPED = np.array([24, 16, 12, 8, 6, 4, 3, 2, 1])
"""Corners that are dropped at once."""
_MAX_SWEEPS = 4
_MOVED = 1
"""Neighbouring corners that are moved at once."""
_INSERT_LEG_RADII = 3.0
"""Legs longer than this get another corner in their middle."""


@spliced
def turn_at(points: FloatArray, i: int, count: int) -> float:
    """Return the angle of the turn at a point, left positive; 0 at the ends."""
    if i <= 0 or i >= count - 1:
        return 0.0
    ux = points[i, 0] - points[i - 1, 0]
    uy = points[i, 1] - points[i - 1, 1]
    vx = points[i + 1, 0] - points[i, 0]
    vy = points[i + 1, 1] - points[i, 1]
    return math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)


@spliced
def radius_outside(turn: float) -> float:
    """Return the distance of a corner from its arc, in radii."""
    return 1.0 / math.cos(0.5 * turn) - 1.0


@leaf
def stretch_length(points: FloatArray, count: int, first: int, last: int, radius: float) -> float:
    """Return the length from behind the turn at `first` to before that at `last`; inf if turns do not fit."""
    turn = turn_at(points, first, count)
    before = radius * abs(math.tan(0.5 * turn))
    length = -before
    for i in range(first, last):
        leg = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        turn = turn_at(points, i + 1, count)
        if abs(turn) > MAX_TURN_RAD:
            return np.inf
        behind = radius * abs(math.tan(0.5 * turn))
        if leg < before + behind - _FIT_M:
            return np.inf
        length += leg
        if i + 1 < last:
            length += radius * abs(turn) - 2.0 * behind
        else:
            length -= behind
        before = behind
    return length


@leaf
def fly_forward(
    surfaces: Float32Array, per_m: float, points: FloatArray, count: int, i: int, radius: float, turns: bool,
    low: float, high: float, entry: float, climb: float, sink: float, depth_m: float, step_m: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return interval and entry state at the end of leg i; with `turns` behind the turn at its end."""
    dx = points[i + 1, 0] - points[i, 0]
    dy = points[i + 1, 1] - points[i, 1]
    course = math.atan2(dy, dx)
    before = radius * abs(math.tan(0.5 * turn_at(points, i, count)))
    turn = turn_at(points, i + 1, count)
    behind = radius * abs(math.tan(0.5 * turn))
    x = points[i, 0] + before * math.cos(course)
    y = points[i, 1] + before * math.sin(course)
    line_m = max(math.hypot(dx, dy) - before - behind, 0.0)
    low, high, entry = fly_arc_and_line(
        surfaces,
        per_m,
        x,
        y,
        course,
        1.0,
        radius,
        0.0,
        line_m,
        low,
        high,
        entry,
        climb,
        sink,
        depth_m,
        step_m,
    )
    if low > high or not turns or turn == 0.0:
        return low, high, entry
    x = points[i + 1, 0] - behind * math.cos(course)
    y = points[i + 1, 1] - behind * math.sin(course)
    side = 1.0 if turn > 0.0 else -1.0
    return fly_arc_and_line(
        surfaces, per_m, x, y, course, side, radius, abs(turn), 0.0, low, high, entry, climb, sink, depth_m,
        step_m,
    )  # fmt: skip


@leaf
def fly_back(
    surfaces: Float32Array, per_m: float, points: FloatArray, count: int, i: int, radius: float,
    low: float, high: float, climb: float, sink: float, step_m: float,
) -> tuple[float, float]:  # fmt: skip
    """Return the interval before the turn at point i from which one before the turn at i + 1 is reached."""
    dx = points[i + 1, 0] - points[i, 0]
    dy = points[i + 1, 1] - points[i, 1]
    course = math.atan2(dy, dx)
    turn = turn_at(points, i, count)
    before = radius * abs(math.tan(0.5 * turn))
    behind = radius * abs(math.tan(0.5 * turn_at(points, i + 1, count)))
    line_m = max(math.hypot(dx, dy) - before - behind, 0.0)
    x = points[i + 1, 0] - behind * math.cos(course)
    y = points[i + 1, 1] - behind * math.sin(course)
    low, high, _ = fly_arc_and_line(
        surfaces, per_m, x, y, course + math.pi, 1.0, radius, 0.0, line_m, low, high, 0.0, sink, climb, 0.0,
        step_m,
    )  # fmt: skip
    if low > high or turn == 0.0:
        return low, high
    x = points[i, 0] + before * math.cos(course)
    y = points[i, 1] + before * math.sin(course)
    side = -1.0 if turn > 0.0 else 1.0
    low, high, _ = fly_arc_and_line(
        surfaces, per_m, x, y, course + math.pi, side, radius, abs(turn), 0.0, low, high, 0.0, sink, climb,
        0.0, step_m,
    )  # fmt: skip
    return low, high


@leaf
def begin_at(
    surfaces: Float32Array, per_m: float, points: FloatArray, ends: FloatArray, depth_m: float
) -> tuple[float, float, float]:
    """Return interval and entry state at the first point."""
    floor, ceiling = read_limits(surfaces, points[0, 0] * per_m, points[0, 1] * per_m)
    return begin(ends[0, 4], ends[0, 5], floor, ceiling, depth_m)


@leaf
def end_at(
    surfaces: Float32Array, per_m: float, points: FloatArray, count: int, ends: FloatArray
) -> tuple[float, float]:
    """Return the interval that is wanted at the last point."""
    floor, ceiling = read_limits(surfaces, points[count - 1, 0] * per_m, points[count - 1, 1] * per_m)
    return max(ends[1, 4], floor), min(ends[1, 5], ceiling)


@leaf
def fill_intervals(
    surfaces: Float32Array, frame: FloatArray, rates: FloatArray, points: FloatArray, count: int,
    ends: FloatArray, ahead: FloatArray, behind: FloatArray,
) -> bool:  # fmt: skip
    """Fill the intervals behind (`ahead`) and before (`behind`) each turn; False if there are no heights."""
    per_m = 1.0 / frame[0]
    low, high, entry = begin_at(surfaces, per_m, points, ends, rates[2])
    for i in range(count):
        ahead[i, 0] = low
        ahead[i, 1] = high
        ahead[i, 2] = entry
        if low > high:
            return False
        if i < count - 1:
            low, high, entry = fly_forward(
                surfaces, per_m, points, count, i, frame[1], True, low, high, entry, rates[0], rates[1],
                rates[2], frame[2],
            )  # fmt: skip
    low, high = end_at(surfaces, per_m, points, count, ends)
    if entry != 0.0 or max(low, ahead[count - 1, 0]) > min(high, ahead[count - 1, 1]):
        return False
    for i in range(count - 1, -1, -1):
        behind[i, 0] = low
        behind[i, 1] = high
        if i > 0 and low <= high:
            low, high = fly_back(
                surfaces, per_m, points, count, i - 1, frame[1], low, high, rates[0], rates[1], frame[2]
            )
    return True


@leaf
def _set_ends(points: FloatArray, count: int, ends: FloatArray) -> bool:
    """Put the first and the last point of a path on the tangents of their circles; False if there is none."""
    if ends[0, 2] > 0.0:
        to_goal = count == 2
        course, length = tangent(
            ends[0, 0], ends[0, 1], ends[0, 2], ends[0, 3],
            ends[1, 0] if to_goal else points[1, 0], ends[1, 1] if to_goal else points[1, 1],
            ends[1, 2] if to_goal else 0.0, ends[1, 3],
        )  # fmt: skip
        if length < 0.0:
            return False
        points[0, 0] = ends[0, 0] + ends[0, 3] * ends[0, 2] * math.sin(course)
        points[0, 1] = ends[0, 1] - ends[0, 3] * ends[0, 2] * math.cos(course)
    elif count == 2:
        return False
    if ends[1, 2] > 0.0:
        at = count - 2
        course, length = tangent(
            points[at, 0], points[at, 1], 0.0, 1.0, ends[1, 0], ends[1, 1], ends[1, 2], ends[1, 3]
        )
        if length < 0.0:
            return False
        points[count - 1, 0] = ends[1, 0] + ends[1, 3] * ends[1, 2] * math.sin(course)
        points[count - 1, 1] = ends[1, 1] - ends[1, 3] * ends[1, 2] * math.cos(course)
    return True


@leaf
def _is_better(
    surfaces: Float32Array, frame: FloatArray, rates: FloatArray, points: FloatArray, count: int,
    trial: FloatArray, trial_count: int, first: int, last: int, trial_ends: FloatArray,
    ahead: FloatArray, behind: FloatArray, pin: int, via: FloatArray,
) -> bool:  # fmt: skip
    """Return True if a trial is shorter, has heights, and passes `via` at point `pin`.

    It differs between points `first` and `last`.
    """
    per_m = 1.0 / frame[0]
    first = max(first, 0)
    last = min(last, count - 1)
    more = trial_count - count
    if not _set_ends(trial, trial_count, trial_ends):
        return False
    if pin > 0:
        bulge = radius_outside(turn_at(trial, pin, trial_count)) * frame[1]
        if math.hypot(trial[pin, 0] - via[0], trial[pin, 1] - via[1]) + bulge > via[2]:
            return False
    gain = stretch_length(points, count, first, last, frame[1]) - stretch_length(
        trial, trial_count, first, last + more, frame[1]
    )
    if not gain >= _LEAST_GAIN_M:
        return False
    low = ahead[first, 0]
    high = ahead[first, 1]
    entry = ahead[first, 2]
    if first == 0:
        low, high, entry = begin_at(surfaces, per_m, trial, trial_ends, rates[2])
    i = first
    while low <= high and i < trial_count - 1:
        is_last = i + 1 == last + more
        low, high, entry = fly_forward(
            surfaces, per_m, trial, trial_count, i, frame[1], not is_last, low, high, entry, rates[0],
            rates[1], rates[2], frame[2],
        )  # fmt: skip
        i += 1
        if is_last:
            if i == trial_count - 1:
                wanted_low, wanted_high = end_at(surfaces, per_m, trial, trial_count, trial_ends)
            else:
                wanted_low = behind[last, 0]
                wanted_high = behind[last, 1]
            return entry == 0.0 and max(low, wanted_low) <= min(high, wanted_high)
    return False


@leaf
def _copy(points: FloatArray, count: int, to: FloatArray) -> None:
    for i in range(count):
        to[i, 0] = points[i, 0]
        to[i, 1] = points[i, 1]


@leaf
def _drop(points: FloatArray, count: int, i: int, dropped: int, to: FloatArray) -> int:
    """Copy a path without some points; return the number of those that are left."""
    for k in range(i):
        to[k, 0] = points[k, 0]
        to[k, 1] = points[k, 1]
    for k in range(i + dropped, count):
        to[k - dropped, 0] = points[k, 0]
        to[k - dropped, 1] = points[k, 1]
    return count - dropped


@leaf
def _join(points: FloatArray, count: int, i: int, to: FloatArray) -> int:
    """Copy a path with points i and i + 1 joined where their outer legs meet; return 0 if they do not."""
    ux = points[i, 0] - points[i - 1, 0]
    uy = points[i, 1] - points[i - 1, 1]
    vx = points[i + 2, 0] - points[i + 1, 0]
    vy = points[i + 2, 1] - points[i + 1, 1]
    across = ux * vy - uy * vx
    if abs(across) < 1e-9:
        return 0
    gx = points[i + 1, 0] - points[i, 0]
    gy = points[i + 1, 1] - points[i, 1]
    along = (gx * vy - gy * vx) / across
    if along <= 0.0 or (gx * uy - gy * ux) / across >= 0.0:
        return 0
    size = _drop(points, count, i, 1, to)
    to[i, 0] = points[i, 0] + along * ux
    to[i, 1] = points[i, 1] + along * uy
    return size


@leaf
def _insert_middle(points: FloatArray, count: int, i: int, to: FloatArray) -> None:
    """Copy a path with another point in the middle of leg i."""
    _copy(points, i + 1, to)
    to[i + 1, 0] = 0.5 * (points[i, 0] + points[i + 1, 0])
    to[i + 1, 1] = 0.5 * (points[i, 1] + points[i + 1, 1])
    for k in range(i + 1, count):
        to[k + 1, 0] = points[k, 0]
        to[k + 1, 1] = points[k, 1]


@kernel
def shorten_path(
    surfaces: Float32Array, frame: FloatArray, rates: FloatArray, vertices: FloatArray, ends: FloatArray,
    pin: int, via: FloatArray,
) -> tuple[FloatArray, FloatArray, float, int]:  # fmt: skip
    """Return a shorter path (k, 2), its ends, its length and the trials; no points if it has no heights.

    `frame`: spacing of the band, turn radius, step of samples. `rates`: climb and sink gradient, entry depth.
    `vertices` (n, 2): the start and the goal included. `ends` (2, 7): for start and goal x, y and radius of
    the circle, side (1 counter-clockwise), lowest and highest height, and 0 if the side may change. A start
    with radius 0 is a pose: its first leg keeps its course. Point `pin` (-1: none) stays within the distance
    of `via` (x, y, distance).
    """
    capacity = vertices.shape[0] * 2 + 64
    count = vertices.shape[0]
    points = np.empty((capacity, 2))
    trial = np.empty((capacity, 2))
    ahead = np.empty((capacity, 3))
    behind = np.empty((capacity, 2))
    ends = ends.copy()
    trial_ends = ends.copy()
    _copy(vertices, count, points)
    radius = frame[1]
    trials = 0
    is_pose = ends[0, 2] <= 0.0
    least = 2 if is_pose else 1
    pose_x = 0.0
    pose_y = 0.0
    if is_pose:
        leg = math.hypot(points[1, 0] - points[0, 0], points[1, 1] - points[0, 1])
        pose_x = (points[1, 0] - points[0, 0]) / leg
        pose_y = (points[1, 1] - points[0, 1]) / leg
    length = stretch_length(points, count, 0, count - 1, radius)
    if length == np.inf or not fill_intervals(surfaces, frame, rates, points, count, ends, ahead, behind):
        return points[:0].copy(), ends, np.inf, trials
    for sweep in range(_MAX_SWEEPS):
        # Drop corners, many at once first.
        for size in range(_DROPPED.size):
            dropped = _DROPPED[size]
            i = least
            while i + dropped <= count - 1:
                trial_count = _drop(points, count, i, dropped, trial)
                trials += 1
                to_pin = pin - dropped if pin > i else pin
                if not (i <= pin < i + dropped) and _is_better(
                    surfaces, frame, rates, points, count, trial, trial_count, i - 2, i + dropped + 1,
                    ends, ahead, behind, to_pin, via,
                ):  # fmt: skip
                    pin = to_pin
                    count = trial_count
                    _copy(trial, count, points)
                    fill_intervals(surfaces, frame, rates, points, count, ends, ahead, behind)
                else:
                    i += 1
        i = 1
        while i + 2 <= count - 1:
            trial_count = _join(points, count, i, trial)
            if trial_count > 0 and pin != i and pin != i + 1:
                trials += 1
                to_pin = pin - 1 if pin > i else pin
                if _is_better(
                    surfaces, frame, rates, points, count, trial, trial_count, i - 2, i + 3, ends,
                    ahead, behind, to_pin, via,
                ):  # fmt: skip
                    pin = to_pin
                    count = trial_count
                    _copy(trial, count, points)
                    fill_intervals(surfaces, frame, rates, points, count, ends, ahead, behind)
            i += 1
        # Leave or enter a circle to the other side.
        for end in range(2):
            if ends[end, 2] > 0.0 and ends[end, 6] == 0.0:
                trial_ends[:] = ends
                trial_ends[end, 3] = -ends[end, 3]
                _copy(points, count, trial)
                at = 1 if end == 0 else count - 2
                trials += 1
                if _is_better(
                    surfaces, frame, rates, points, count, trial, count, at - 2, at + 2, trial_ends,
                    ahead, behind, pin, via,
                ):  # fmt: skip
                    ends[:] = trial_ends
                    _copy(trial, count, points)
                    fill_intervals(surfaces, frame, rates, points, count, ends, ahead, behind)
        before = stretch_length(points, count, 0, count - 1, radius)
        for size in range(_STEPS_M.size):
            step = _STEPS_M[size]
            for moved in range(1, _MOVED + 1):
                for i in range(1, count - moved):
                    direction = 0
                    failed = 0
                    while failed < 8:
                        _copy(points, count, trial)
                        for k in range(i, i + moved):
                            trial[k, 0] += step * math.cos(direction * 0.25 * math.pi)
                            trial[k, 1] += step * math.sin(direction * 0.25 * math.pi)
                        if is_pose and i == 1:
                            along = (trial[1, 0] - points[0, 0]) * pose_x
                            along += (trial[1, 1] - points[0, 1]) * pose_y
                            trial[1, 0] = points[0, 0] + max(along, 0.0) * pose_x
                            trial[1, 1] = points[0, 1] + max(along, 0.0) * pose_y
                        trials += 1
                        if _is_better(
                            surfaces, frame, rates, points, count, trial, count, i - 2, i + moved + 1,
                            ends, ahead, behind, pin, via,
                        ):  # fmt: skip
                            _copy(trial, count, points)
                            fill_intervals(surfaces, frame, rates, points, count, ends, ahead, behind)
                            failed = 0
                        else:
                            failed += 1
                            direction = (direction + 1) % 8
        length = stretch_length(points, count, 0, count - 1, radius)
        if sweep > 0 and before - length < 1e-3 * length:
            break
        i = 1 if is_pose else 0
        while sweep < _MAX_SWEEPS - 1 and i < count - 1 and count < capacity:
            leg = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
            if leg > _INSERT_LEG_RADII * radius:
                _insert_middle(points, count, i, trial)
                # The leg is sampled at other places now.
                if fill_intervals(surfaces, frame, rates, trial, count + 1, ends, ahead, behind):
                    count += 1
                    _copy(trial, count, points)
                    pin = pin + 1 if pin > i else pin
                    i += 1
            i += 1
        fill_intervals(surfaces, frame, rates, points, count, ends, ahead, behind)
    return points[:count].copy(), ends, length, trials


def corners_of(
    pieces: FloatArray, start: tuple[float, float, float], radius_m: float
) -> tuple[FloatArray, int]:
    """Return the points of a path of arcs and lines (start, corners, end) and the index of its pinned point.

    Parameters
    ----------
    pieces : ndarray, shape (k, 3)
        Angle of an arc, left positive, length of the line behind it, and 1 where a point is pinned behind it.
    start : tuple of float
        x, y and course.
    radius_m : float
        Radius of the arcs.

    Returns
    -------
    points : ndarray, shape (n, 2)
    pin : int
        -1 for none.
    """
    x, y, course = start
    points = [(x, y)]
    pin = -1
    for angle, line_m, is_pinned in _merged(pieces):
        parts = max(1, math.ceil(abs(angle) / (0.5 * math.pi) - 1e-9))
        if abs(angle) > 1e-9:
            part = angle / parts
            tangent_m = radius_m * math.tan(0.5 * abs(part))
            for _ in range(parts):
                points.append((x + tangent_m * math.cos(course), y + tangent_m * math.sin(course)))
                course += part
                x = points[-1][0] + tangent_m * math.cos(course)
                y = points[-1][1] + tangent_m * math.sin(course)
        x += line_m * math.cos(course)
        y += line_m * math.sin(course)
        if is_pinned:
            pin = len(points)
            points.append((x, y))
    points.append((x, y))
    return np.array(points), pin


def _merged(pieces: FloatArray) -> list[list[float]]:
    """Return pieces with arcs to one side, and lines, joined to one piece."""
    merged: list[list[float]] = []
    for angle, line_m, is_pinned in pieces.tolist():
        can_join = bool(merged) and not merged[-1][2]
        if can_join and merged[-1][1] < 1e-9 and merged[-1][0] * angle >= 0.0:
            merged[-1][0] += angle
            merged[-1][1] = line_m
            merged[-1][2] = is_pinned
        elif can_join and abs(angle) < 1e-9:
            merged[-1][1] += line_m
            merged[-1][2] = is_pinned
        else:
            merged.append([angle, line_m, is_pinned])
    return merged
