"""String pulling: the shortest path around obstacles near a known path.

A shortest path among polygons bends only at convex corners, where it is tangent: the obstacle lies on one
side of the leg (Lozano-Perez & Wesley 1979). The path is searched among the tangent points in a corridor
around the known path (`gcs.planning.path.tangent_points`).

- *Candidates* are ordered by their distance along the path.
- Each gets the cheapest predecessor (of `_WINDOW` at most) that its leg is tangent to and visible from. The
  straight-line distance is a lower bound, so most visibility tests are skipped.
- A leg shorter than the turn radius, or than its turns need, costs `_SHORT_LEG_WEIGHT` times the missing
  length. A start against the heading costs its turn. The legs of the known path are always allowed, so the
  result is never worse.
- Then every corner *slides* towards its neighbours, and towards the leg between them, while it sees them.

The cost is that of a corridor. Other ways around the map are found by the grid search, not here.

Positions in cells: x = column, y = row. Line of sight is exact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.jit import called, inlined, kernel, leaf
from gcs.model import BoolArray, FloatArray, IntArray
from gcs.planning.map.grid import TOUCH
from gcs.planning.map.line_of_sight import NO_CELL, blocking_cell, clear_leg, is_free_at, leg_clearance
from gcs.planning.path.initial_turn import Pose, is_turn_clear, start_clearance, turn_to
from gcs.planning.path.points import copy_point, set_point
from gcs.planning.path.tangent_points import E1X, E1Y, E2X, E2Y, X, Y, tangent_points

_WINDOW = 48
_SHORT_LEG_WEIGHT = 0.8
_TIGHT_LEG_WEIGHT = 3.0
"""Cost of a cell of a known leg without the clearance."""
_CORNER_COST = 0.25
"""Cost of a corner, in cells."""
_MIN_TIGHT_GAP = 3.0
_SWEEPS = 4
_HALVINGS = 7
_ROUNDING_FACTOR = 1.0 - 1e-12
"""A square root times this is no longer than the leg in spite of rounding."""


@inlined
def _gap(points: FloatArray, i: int, j: int) -> float:
    return math.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])


@inlined
def _turn(ux: float, uy: float, u: float, vx: float, vy: float, v: float) -> float:
    """Return the tangent of half the angle between two legs of lengths u and v; large for a reversal."""
    cos = (ux * vx + uy * vy) / max(u * v, 1e-12)
    return math.sqrt(max(1.0 - cos, 0.0) / max(1.0 + cos, 1e-4))


class _Obstacles(NamedTuple):
    """The map, and the clearances of legs and of the initial turn in cells."""

    blocked: BoolArray
    clearance: float
    start_clearance: float


class _Vehicle(NamedTuple):
    """The vehicle at the start of the path; arguments of `pull_string`."""

    heading: FloatArray
    radius: float
    own_cell: int


class _Candidates(NamedTuple):
    """Candidates in order (`gcs.planning.path.tangent_points`), all (n,): position, edges, known vertex."""

    x: FloatArray
    y: FloatArray
    e1x: FloatArray
    e1y: FloatArray
    e2x: FloatArray
    e2y: FloatArray
    known: BoolArray


class _Paths(NamedTuple):
    """Cheapest path to each candidate, all (n,).

    ===========  ==================================================================
    cost         cost of the path
    came_from    predecessor, -1 for the start
    leg_in       length of the last leg
    used_in      length that the turn at its begin uses of it
    lower_bound  bound of the cost of the present candidate over each predecessor
    ===========  ==================================================================
    """

    cost: FloatArray
    came_from: IntArray
    leg_in: FloatArray
    used_in: FloatArray
    lower_bound: FloatArray


@leaf
def _start_cost(
    obstacles: _Obstacles, vehicle: _Vehicle, x: float, y: float, to_x: float, to_y: float
) -> float:
    """Return the additional cost of a start on the vehicle's course over the straight line.

    That is the added length of the turn, or a full circle if the turn is blocked or cannot reach the place.
    """
    if vehicle.heading[0] == 0.0 and vehicle.heading[1] == 0.0:
        return 0.0
    pose = Pose(x, y, math.atan2(vehicle.heading[1], vehicle.heading[0]))
    if not is_turn_clear(
        obstacles.blocked, obstacles.start_clearance, pose, to_x, to_y, vehicle.radius, vehicle.own_cell
    ):
        return 2.0 * math.pi * vehicle.radius
    return turn_to(pose, to_x, to_y, vehicle.radius)[2] - math.hypot(to_x - x, to_y - y)


@inlined
def _lower_bound(of: _Candidates, cost: FloatArray, i: int, j: int) -> float:
    """Bound the cost of candidate j over its predecessor i; inf if the leg is not tangent.

    Branch-free arithmetic, so that it is vectorised. A known vertex has no edges.
    """
    dx = of.x[j] - of.x[i]
    dy = of.y[j] - of.y[i]
    leaves = (dx * of.e1y[i] - dy * of.e1x[i]) * (dx * of.e2y[i] - dy * of.e2x[i]) >= -1e-9
    arrives = (dx * of.e1y[j] - dy * of.e1x[j]) * (dx * of.e2y[j] - dy * of.e2x[j]) >= -1e-9
    beeline = cost[i] + _ROUNDING_FACTOR * math.sqrt(dx * dx + dy * dy) + _CORNER_COST
    return beeline if leaves & arrives else np.inf


@inlined
def _relax(
    obstacles: _Obstacles, vehicle: _Vehicle, of: _Candidates, paths: _Paths, i: int, j: int,
    is_known_leg: bool, hit: int,
) -> int:  # fmt: skip
    """Let the path to candidate j come from i if that is cheaper; return the last cell that blocked a leg."""
    dx = of.x[j] - of.x[i]
    dy = of.y[j] - of.y[i]
    leg = math.hypot(dx, dy)
    cost = paths.cost[i] + leg + _CORNER_COST
    need = 0.0
    if not is_known_leg and (leg < 1e-9 or cost >= paths.cost[j]):
        return hit
    if vehicle.radius > 0.0:
        cost += _SHORT_LEG_WEIGHT * max(vehicle.radius - leg, 0.0)
        if i == 0:
            cost += _start_cost(obstacles, vehicle, of.x[0], of.y[0], of.x[j], of.y[j])
        elif leg > 0.0:
            p = paths.came_from[i]
            turn = _turn(of.x[i] - of.x[p], of.y[i] - of.y[p], paths.leg_in[i], dx, dy, leg)
            need = vehicle.radius * turn
            missing_before = max(need + paths.used_in[i] - paths.leg_in[i], 0.0)
            cost += _SHORT_LEG_WEIGHT * (missing_before + max(need - leg, 0.0))
    if cost >= paths.cost[j]:
        return hit
    ignored_cell = vehicle.own_cell if i == 0 else NO_CELL
    seen = blocking_cell(
        obstacles.blocked, of.x[i], of.y[i], of.x[j], of.y[j], obstacles.clearance, ignored_cell, hit
    )
    if seen >= 0:
        hit = seen
        if not is_known_leg or cost + (_TIGHT_LEG_WEIGHT - 1.0) * leg >= paths.cost[j]:
            return hit
        cost += (_TIGHT_LEG_WEIGHT - 1.0) * leg
    paths.cost[j] = cost
    paths.came_from[j] = i
    paths.leg_in[j] = leg
    paths.used_in[j] = need
    return hit


@leaf
def _relax_candidates(obstacles: _Obstacles, vehicle: _Vehicle, of: _Candidates, paths: _Paths) -> None:
    """Find the cheapest path to each candidate, in order."""
    last_known = 0
    paths.cost[0] = 0.0
    paths.came_from[0] = -1
    for j in range(1, of.x.size):
        paths.cost[j] = np.inf
        paths.came_from[j] = -1
        first = max(0, j - _WINDOW)
        hit = NO_CELL
        for i in range(first, j):
            paths.lower_bound[i] = _lower_bound(of, paths.cost, i, j)
        if last_known < first:
            paths.lower_bound[last_known] = _lower_bound(of, paths.cost, last_known, j)
        for k in range(first - 1 if last_known < first else first, j):
            i = k if k >= first else last_known
            is_known_leg = of.known[j] and i == last_known
            if is_known_leg or paths.lower_bound[i] < paths.cost[j]:
                hit = _relax(obstacles, vehicle, of, paths, i, j, is_known_leg, hit)
        if of.known[j]:
            last_known = j


@called
def _cheapest_path(
    blocked: BoolArray, clearance: float, found: FloatArray, known: BoolArray, vehicle: _Vehicle
) -> IntArray:
    """Return the cheapest path through ordered candidates, from first to last: their indices, backwards."""
    size = known.size
    candidates = _Candidates(found[X], found[Y], found[E1X], found[E1Y], found[E2X], found[E2Y], known)
    paths = _Paths(np.empty(size), np.empty(size, np.int64), np.zeros(size), np.zeros(size), np.empty(size))
    margin = start_clearance(blocked, clearance, found[X, 0], found[Y, 0])
    _relax_candidates(_Obstacles(blocked, clearance, margin), vehicle, candidates, paths)
    path = np.empty(size, np.int64)
    count = 0
    node = size - 1
    while node >= 0:
        path[count] = node
        count += 1
        node = paths.came_from[node]
    return path[:count]


@inlined
def _slide_corner(
    blocked: BoolArray, clearance: float, vertices: FloatArray, i: int, aim_x: float, aim_y: float,
    least: float, own_cell: int,
) -> float:  # fmt: skip
    """Move corner i towards a place while it sees its neighbours; return the distance moved, in cells."""
    ax = vertices[i - 1, 0]
    ay = vertices[i - 1, 1]
    bx = vertices[i + 1, 0]
    by = vertices[i + 1, 1]
    x = vertices[i, 0]
    y = vertices[i, 1]
    ignored_cell = own_cell if i == 1 else NO_CELL
    good = 0.0
    bad = 1.0
    step = 1.0
    hit = NO_CELL
    beyond = NO_CELL
    for _ in range(_HALVINGS):
        px = x + step * (aim_x - x)
        py = y + step * (aim_y - y)
        clear = is_free_at(blocked, px, py)
        clear = clear and math.hypot(px - ax, py - ay) >= least and math.hypot(px - bx, py - by) >= least
        if clear:
            seen = blocking_cell(blocked, ax, ay, px, py, clearance, ignored_cell, hit)
            clear = seen < 0
            hit = seen if seen >= 0 else hit
        if clear:
            seen = blocking_cell(blocked, px, py, bx, by, clearance, NO_CELL, beyond)
            clear = seen < 0
            beyond = seen if seen >= 0 else beyond
        if clear:
            good = step
            if step == 1.0:
                break
        else:
            bad = step
        step = 0.5 * (good + bad)
    set_point(vertices, i, x + good * (aim_x - x), y + good * (aim_y - y))
    return good * math.hypot(aim_x - x, aim_y - y)


@leaf
def _slide_corners(
    blocked: BoolArray, clearance: float, vertices: FloatArray, count: int, least: float, own_cell: int,
    settled: BoolArray,
) -> int:  # fmt: skip
    """Slide the corners of a path, and drop those whose neighbours see each other; return the count.

    `settled` (count,), all false: corners that did not move, and whose neighbours did not.
    """
    for _ in range(_SWEEPS):
        moved = 0.0
        i = 1
        while i < count - 1:
            if settled[i]:
                i += 1
                continue
            ax = vertices[i - 1, 0]
            ay = vertices[i - 1, 1]
            bx = vertices[i + 1, 0]
            by = vertices[i + 1, 1]
            if clear_leg(blocked, ax, ay, bx, by, clearance, own_cell if i == 1 else NO_CELL):
                count -= 1
                for k in range(i, count):
                    copy_point(vertices, k + 1, vertices, k)
                    settled[k] = settled[k + 1]
                moved = 1.0
                settled[i - 1] = False
                settled[i] = False
                continue
            a = math.hypot(vertices[i, 0] - ax, vertices[i, 1] - ay)
            b = math.hypot(vertices[i, 0] - bx, vertices[i, 1] - by)
            floor = min(least, a, b)
            share = a / max(a + b, 1e-12)
            total_moved = _slide_corner(
                blocked,
                clearance,
                vertices,
                i,
                ax + share * (bx - ax),
                ay + share * (by - ay),
                floor,
                own_cell,
            )
            total_moved += _slide_corner(blocked, clearance, vertices, i, ax, ay, floor, own_cell)
            total_moved += _slide_corner(blocked, clearance, vertices, i, bx, by, floor, own_cell)
            settled[i] = total_moved == 0.0
            if total_moved > 0.0:
                settled[i - 1] = settled[i + 1] = False
            moved += total_moved
            i += 1
        if moved < 1e-3:
            break
    return count


@called
def _pull_stretch(
    blocked: BoolArray, clearance: float, vertices: FloatArray, heading: FloatArray, radius: float,
    least: float, own_cell: int,
) -> FloatArray:  # fmt: skip
    """Shorten a path of legs with one clearance; see `pull_string`."""
    found, known = tangent_points(blocked, clearance, vertices)
    path = _cheapest_path(blocked, clearance, found, known, _Vehicle(heading, radius, own_cell))
    count = path.size
    pulled = np.empty((count, 2))
    for i in range(count):
        set_point(pulled, i, found[X, path[count - 1 - i]], found[Y, path[count - 1 - i]])
    return pulled[
        : _slide_corners(blocked, clearance, pulled, count, least, own_cell, np.zeros(count, np.bool_))
    ].copy()


@called
def _leg_clearances(blocked: BoolArray, clearance: float, vertices: FloatArray, own_cell: int) -> FloatArray:
    """Return the clearance of each leg, at most `clearance`. Legs between close tight legs count as tight."""
    legs = vertices.shape[0] - 1
    clearances = np.empty(legs)
    for i in range(legs):
        ignored_cell = own_cell if i == 0 else NO_CELL
        clearances[i] = leg_clearance(
            blocked,
            vertices[i, 0],
            vertices[i, 1],
            vertices[i + 1, 0],
            vertices[i + 1, 1],
            clearance,
            ignored_cell,
        )
    last = -1
    since = 0.0
    for i in range(legs):
        if clearances[i] < clearance - TOUCH:
            if last >= 0 and since < _MIN_TIGHT_GAP:
                for k in range(last + 1, i):
                    clearances[k] = min(clearances[last], clearances[i])
            last = i
            since = 0.0
        else:
            since += _gap(vertices, i, i + 1)
    return clearances


@kernel
def pull_string(
    blocked: BoolArray, clearance: float, vertices: FloatArray, heading: FloatArray, radius: float,
    least: float, own_cell: int,
) -> FloatArray:  # fmt: skip
    """Shorten a path by string pulling.

    `clearance` in cells. `vertices` (k, 2): vertices with both ends, each leg with the clearance or, where
    the map allows no other path, with less. `heading` (2,): unit vector, zeros if unknown. `radius`: turn
    radius in cells, 0 if any turn can be flown. `least`: minimum leg length. `own_cell`: flat cell that does
    not block the first leg, -1 for none. Returns the new vertices (j, 2).

    Stretches with less clearance are shortened separately and keep the clearance that they have.
    """
    clearances = _leg_clearances(blocked, clearance, vertices, own_cell)
    legs = clearances.size
    first = 0
    size = 1
    result = np.empty((0, 2))
    unknown = np.zeros(2)
    while first < legs:
        margin = clearances[first]
        is_tight = clearances[first] < clearance - TOUCH
        last = first + 1
        while last < legs and (clearances[last] < clearance - TOUCH) == is_tight:
            margin = min(margin, clearances[last])
            last += 1
        part = _pull_stretch(
            blocked,
            margin if is_tight else clearance,
            vertices[first : last + 1].copy(),
            heading if first == 0 else unknown,
            radius,
            least,
            own_cell if first == 0 else NO_CELL,
        )
        before = result
        result = np.empty((size + part.shape[0] - 1, 2))
        for i in range(size - 1):
            copy_point(before, i, result, i)
        for i in range(part.shape[0]):
            copy_point(part, i, result, size - 1 + i)
        size += part.shape[0] - 1
        first = last
    return result
