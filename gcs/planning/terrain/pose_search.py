"""A* over poses with intervals of heights: a flyable path from a start to a loiter circle.

Hybrid A* (Dolgov, Thrun, Montemerlo and Diebel 2010): poses are continuous and hashed to cells and 32
courses. From each pose lead straight lines and arcs of the turn radius, some followed by a straight line.
A label has the interval of heights that the path can reach (`gcs.planning.terrain.intervals`). In one
cell and course a label is dropped if a cheaper one leaves no less room to floor and ceiling. So several
labels of a cell stand for several heights, and the search is three-dimensional at little more than the
price of two dimensions.

The heuristic is a `HeightField`: it knows the climbs that lie ahead. Paths are closed by an arc and a
straight line that ends on a tangent of the loiter circle. The search ends when no label can lead to a
path that is shorter by more than `_GAP_SHARE`, or after a bounded number of expansions.

Lengths in metres from node (0, 0) of the band, angles counter-clockwise from east.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import ZERO, inlined, int64, kernel, leaf
from gcs.model import Float32Array, FloatArray, Int32Array, IntArray
from gcs.planning.terrain.band import read_limits
from gcs.planning.terrain.height_field import field_length
from gcs.planning.terrain.intervals import advance_to, begin

COURSES = 32
_FULL = 2.0 * math.pi
TURN_STEPS = np.array([0, 1, -1, 2, -2, 4, -4])
"""Courses turned by each primitive, left positive."""
_LENGTH_RADII = 0.6
"""Least length of a primitive, in turn radii: what is left behind its arc is straight."""
_CELL_RADII = 0.4
"""Side of a cell, in turn radii."""
_MIN_CELL_M = 20.0
_MAX_STATES = 4_000_000
_SAME_ROOM_M = 3.0
"""Room to floor or ceiling that a label must add to be kept."""
_MAX_CELL_LABELS = 3
_SHOT_EVERY_M = 400.0
"""Distance to the goal up to which every pose is closed by a shot; farther poses more seldom."""


def make_primitives(radius_m: float, step_m: float) -> tuple[FloatArray, FloatArray]:
    """Return samples and shapes of the primitives from course 0.

    Returns
    -------
    samples : ndarray, shape (7, k, 2)
        Places relative to the pose, `step_m` apart or less, the last one at the end.
    shapes : ndarray, shape (7, 4)
        Courses turned, length of the straight line, number of samples, whole length.
    """
    turn_rad = _FULL / COURSES
    least_m = _LENGTH_RADII * radius_m
    shapes = np.zeros((len(TURN_STEPS), 4))
    rows = []
    for k, steps in enumerate(TURN_STEPS.tolist()):
        arc_m = abs(steps) * turn_rad * radius_m
        line_m = max(least_m - arc_m, 0.0)
        count = math.ceil((arc_m + line_m) / step_m)
        shapes[k] = (steps, line_m, count, arc_m + line_m)
        side = math.copysign(1.0, steps)
        row = []
        for i in range(1, count + 1):
            along_m = (arc_m + line_m) * i / count
            angle = min(along_m, arc_m) / radius_m
            rest_m = max(along_m - arc_m, 0.0)
            row.append(
                (
                    radius_m * math.sin(angle) + rest_m * math.cos(angle),
                    side * (radius_m * (1.0 - math.cos(angle)) + rest_m * math.sin(angle)),
                )
            )
        rows.append(row)
    samples = np.zeros((len(rows), max(map(len, rows)), 2))
    for k, row in enumerate(rows):
        samples[k, : len(row)] = row
    return samples, shapes


def cell_size_m(radius_m: float, size_m: FloatArray) -> float:
    """Return the side of a cell, such that the states fit in memory."""
    return max(_CELL_RADII * radius_m, _MIN_CELL_M, math.sqrt(float(np.prod(size_m)) * COURSES / _MAX_STATES))


@leaf
def _push(keys: FloatArray, items: Int32Array, size: int, key: float, item: int) -> None:
    """Add an item to a binary heap of `size` items."""
    at = size
    while at > 0:
        up = (at - 1) >> 1
        if keys[up] <= key:
            break
        keys[at] = keys[up]
        items[at] = items[up]
        at = up
    keys[at] = key
    items[at] = item


@leaf
def _pop(keys: FloatArray, items: Int32Array, size: int) -> int:
    """Remove the item of the least key from a heap of `size` items, and return it."""
    first = items[0]
    last = size - 1
    key = keys[last]
    item = items[last]
    at = 0
    while True:
        child = 2 * at + 1
        if child >= last:
            break
        if child + 1 < last and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[at] = keys[child]
        items[at] = items[child]
        at = child
    keys[at] = key
    items[at] = item
    return first


@inlined
def tangent(
    x: float, y: float, near_radius: float, near_side: float, to_x: float, to_y: float, far_radius: float,
    far_side: float,
) -> tuple[float, float]:  # fmt: skip
    """Return course and length of the line that leaves one circle and enters another; length -1 if none.

    Sides: 1 for a circle flown counter-clockwise, -1 for clockwise. A radius of 0 is a point.
    """
    apart = math.hypot(to_x - x, to_y - y)
    aside = far_side * far_radius - near_side * near_radius
    length = -1.0
    course = 0.0
    if apart > abs(aside):
        course = math.atan2(to_y - y, to_x - x) - math.asin(aside / apart)
        length = math.sqrt(apart * apart - aside * aside)
    return course, length


@leaf
def fly_arc_and_line(
    surfaces: Float32Array, per_m: float, x: float, y: float, course: float, side: float, radius: float,
    angle: float, line_m: float, low: float, high: float, entry: float, climb: float, sink: float,
    depth_m: float, step_m: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return interval and entry state behind an arc of `angle` to a side and a straight line."""
    arc_m = angle * radius
    count = math.ceil(arc_m / step_m)
    centre_x = x - side * radius * math.sin(course)
    centre_y = y + side * radius * math.cos(course)
    if count > 0:
        step = arc_m / count
        for i in range(1, count + 1):
            turned = course + side * angle * i / count
            low, high, entry = advance_to(
                surfaces,
                per_m,
                centre_x + side * radius * math.sin(turned),
                centre_y - side * radius * math.cos(turned),
                low,
                high,
                entry,
                climb * step,
                sink * step,
                depth_m,
            )
            if low > high:
                return low, high, entry
    course = course + side * angle
    x = centre_x + side * radius * math.sin(course)
    y = centre_y - side * radius * math.cos(course)
    count = math.ceil(line_m / step_m)
    if count > 0:
        step = line_m / count
        dx = step * math.cos(course)
        dy = step * math.sin(course)
        for i in range(1, count + 1):
            low, high, entry = advance_to(
                surfaces, per_m, x + i * dx, y + i * dy, low, high, entry, climb * step, sink * step, depth_m
            )
            if low > high:
                return low, high, entry
    return low, high, entry


@kernel
def search_poses(
    surfaces: Float32Array, frame: FloatArray, rates: FloatArray, counts: Int32Array, labels: Float32Array,
    samples: FloatArray, shapes: FloatArray, starts: FloatArray, course0: float, via: FloatArray,
    goals: FloatArray, limits: IntArray, weight: float, gap_share: float,
) -> tuple[FloatArray, float, float, int]:  # fmt: skip
    """Return the pieces of a path (k, 3), its length (inf if none), that of the field, and the expansions.

    A path passes `via` (x, y, distance to keep at most; negative for no such place) before a goal.
    `counts`, `labels`: fields (2, ...) before and behind that place, as of `HeightField`.
    `frame`: spacing of the band, of the field, side of a cell, turn radius, step of samples in shots.
    `rates`: climb and sink gradient, entry depth. `samples`, `shapes`: `make_primitives`. `starts` (n, 5):
    x, y, index of the course from `course0`, lowest, highest. `goals` (m, 6): x, y, radius, lowest,
    highest, side on which it is entered (0: any). `limits`: expansions, expansions beyond the first path.
    Pieces: start index, goal index and side; then angle of an arc, length of the line behind it, and 1
    where the path passes `via` at the end of the piece.
    """
    climb = rates[0]
    sink = rates[1]
    depth_m = rates[2]
    per_m = 1.0 / frame[0]
    field_m = frame[1]
    cell_m = frame[2]
    radius = frame[3]
    turn = _FULL / COURSES
    gradient = min(climb, sink)
    wide = int((surfaces.shape[1] - 1) * frame[0] / cell_m) + 1
    tall = int((surfaces.shape[0] - 1) * frame[0] / cell_m) + 1
    first_stage = int64(1 if via[2] < 0.0 else 0)
    heads = np.full(wide * tall * COURSES * (2 - first_stage), -1, np.int32)
    capacity = limits[0] * 3 + starts.shape[0] + 16
    states = np.empty((capacity, 7))
    tags = np.empty((capacity, 4), np.int32)
    stages = np.empty(capacity, np.int8)
    keys = np.empty(capacity)
    items = np.empty(capacity, np.int32)
    cosines = np.empty(COURSES)
    sines = np.empty(COURSES)
    for k in range(COURSES):
        cosines[k] = math.cos(course0 + k * turn)
        sines[k] = math.sin(course0 + k * turn)
    used = 0
    waiting = 0
    expansions = 0
    best = np.inf
    best_label = int64(-1)
    best_side = 1.0
    best_angle = 0.0
    best_line = 0.0
    best_far = 1.0
    best_goal = int64(0)
    found_at = int64(0)
    least = np.inf
    for i in range(starts.shape[0]):
        floor, ceiling = read_limits(surfaces, starts[i, 0] * per_m, starts[i, 1] * per_m)
        low, high, entry = begin(starts[i, 3], starts[i, 4], floor, ceiling, depth_m)
        if low > high:
            continue
        ahead = field_length(counts, labels, ZERO, field_m, starts[i, 0], starts[i, 1], low, high, gradient)
        if ahead == np.inf:
            continue
        least = min(least, ahead)
        states[used, 0] = starts[i, 0]
        states[used, 1] = starts[i, 1]
        states[used, 2] = low
        states[used, 3] = high
        states[used, 4] = entry
        states[used, 5] = 0.0
        states[used, 6] = weight * ahead
        tags[used, 0] = int(starts[i, 2]) + first_stage * COURSES
        tags[used, 1] = -1 - i
        stages[used] = first_stage
        tags[used, 2] = 0
        tags[used, 3] = -1
        _push(keys, items, waiting, states[used, 6], used)
        waiting += 1
        used += 1
    while waiting > 0 and expansions < limits[0]:
        if keys[0] >= best * (1.0 - gap_share) or (best < np.inf and expansions > found_at + limits[1]):
            break
        here = _pop(keys, items, waiting)
        waiting -= 1
        if tags[here, 0] < 0:
            continue
        expansions += 1
        x = states[here, 0]
        y = states[here, 1]
        stage = int64(tags[here, 0]) // COURSES
        k = int64(tags[here, 0]) - stage * COURSES
        cost = states[here, 5]
        left = states[here, 6] - cost
        if left < _SHOT_EVERY_M or expansions % int(left / _SHOT_EVERY_M * 4.0 + 1.0) == 0:
            for combination in range(4 * goals.shape[0] * stage):
                goal = goals[combination >> 2]
                near = 1.0 if combination & 1 else -1.0
                far = 1.0 if combination & 2 else -1.0
                if goal[5] != 0.0 and far != goal[5]:
                    continue
                course = course0 + k * turn
                to_course, line_m = tangent(
                    x - near * radius * math.sin(course),
                    y + near * radius * math.cos(course),
                    radius,
                    near,
                    goal[0],
                    goal[1],
                    goal[2],
                    far,
                )
                if line_m < 0.0:
                    continue
                angle = (near * (to_course - course)) % _FULL
                angle = 0.0 if angle > _FULL - 1e-9 else angle
                length = cost + angle * radius + line_m
                if length >= best:
                    continue
                low, high, entry = fly_arc_and_line(
                    surfaces, per_m, x, y, course, near, radius, angle, line_m, states[here, 2],
                    states[here, 3], states[here, 4], climb, sink, depth_m, frame[4],
                )  # fmt: skip
                if low <= high and entry == 0.0 and low <= goal[4] and high >= goal[3]:
                    if best == np.inf:
                        found_at = expansions
                    best = length
                    best_label = here
                    best_side = near
                    best_angle = angle
                    best_line = line_m
                    best_far = far
                    best_goal = combination >> 2
        for p in range(shapes.shape[0]):
            low = states[here, 2]
            high = states[here, 3]
            entry = states[here, 4]
            count = int(shapes[p, 2])
            step = shapes[p, 3] / count
            to_x = x
            to_y = y
            for i in range(count):
                to_x = x + cosines[k] * samples[p, i, 0] - sines[k] * samples[p, i, 1]
                to_y = y + sines[k] * samples[p, i, 0] + cosines[k] * samples[p, i, 1]
                low, high, entry = advance_to(
                    surfaces, per_m, to_x, to_y, low, high, entry, climb * step, sink * step, depth_m
                )
                if low > high:
                    break
            if low > high:
                continue
            to_cost = cost + shapes[p, 3]
            to_stage = stage
            if stage == 0 and math.hypot(to_x - via[0], to_y - via[1]) <= via[2]:
                to_stage = int64(1)
            ahead = field_length(
                counts, labels, to_stage - first_stage, field_m, to_x, to_y, low, high, gradient
            )
            key = to_cost + weight * ahead
            if key >= best:
                continue
            to_k = (k + int(shapes[p, 0])) % COURSES
            cell = ((to_stage - first_stage) * tall + int(to_y / cell_m)) * wide + int(to_x / cell_m)
            cell = cell * COURSES + to_k
            floor, ceiling = read_limits(surfaces, to_x * per_m, to_y * per_m)
            is_dropped = _is_dominated(
                states, tags, heads[cell], low - floor, ceiling - high, key, surfaces, per_m
            )
            if is_dropped or used == capacity:
                continue
            states[used, 0] = to_x
            states[used, 1] = to_y
            states[used, 2] = low
            states[used, 3] = high
            states[used, 4] = entry
            states[used, 5] = to_cost
            states[used, 6] = key
            tags[used, 0] = to_k + to_stage * COURSES
            tags[used, 1] = here
            stages[used] = to_stage
            tags[used, 2] = p
            tags[used, 3] = heads[cell]
            heads[cell] = used
            _push(keys, items, waiting, key, used)
            waiting += 1
            used += 1
    if best == np.inf:
        return np.empty((0, 3)), best, least, expansions
    count = 2
    at = best_label
    while tags[at, 1] >= 0:
        count += 1
        at = int64(tags[at, 1])
    pieces = np.zeros((count, 3))
    pieces[count - 1, 0] = best_side * best_angle
    pieces[count - 1, 1] = best_line
    at = best_label
    for i in range(count - 2, 0, -1):
        pieces[i, 0] = shapes[tags[at, 2], 0] * turn
        pieces[i, 1] = shapes[tags[at, 2], 1]
        pieces[i, 2] = 1.0 if stages[at] > stages[tags[at, 1]] else 0.0
        at = int64(tags[at, 1])
    pieces[0, 0] = -1 - tags[at, 1]
    pieces[0, 1] = best_goal
    pieces[0, 2] = best_far
    return pieces, best, least, expansions


@leaf
def _is_dominated(
    states: FloatArray, tags: Int32Array, head: int, below: float, above: float, key: float,
    surfaces: Float32Array, per_m: float,
) -> bool:  # fmt: skip
    """Return True if a label of a cell has no greater key and no less room; mark those that it dominates."""
    at = head
    alive = 0
    while at >= 0:
        if tags[at, 0] >= 0:
            floor, ceiling = read_limits(surfaces, states[at, 0] * per_m, states[at, 1] * per_m)
            its_below = states[at, 2] - floor
            its_above = ceiling - states[at, 3]
            if states[at, 6] <= key:
                if its_below <= below + _SAME_ROOM_M and its_above <= above + _SAME_ROOM_M:
                    return True
                alive += 1
            elif below <= its_below and above <= its_above:
                tags[at, 0] = -1
        at = tags[at, 3]
    return alive >= _MAX_CELL_LABELS
