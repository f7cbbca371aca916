"""Initial turn: the direct turn on to the first leg, and explicit turn waypoints where that is blocked.

*Direct turn*: an arc of the turn radius to the nearer side, and its tangent to the first waypoint. Autopilots
fly it without further waypoints.

*Explicit turn*: candidates are tried in order of length, the turn to either side with its tangent, and every
Dubins word (`gcs.planning.path.dubins`) that ends on the first leg, at its end or earlier. Arcs become the
corners of their tangents.

Positions in cells; angles counter-clockwise from east.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.jit import ZERO, called, kernel, leaf
from gcs.model import BoolArray, FloatArray, IntArray
from gcs.planning.map.grid import TOUCH
from gcs.planning.map.line_of_sight import clear_leg, clearance_at, is_free_at
from gcs.planning.path.corner_splitting import MAX_TURN_RAD
from gcs.planning.path.dubins import WORD_TURNS, dubins_words
from gcs.planning.path.points import copy_point, set_point

MAX_ARC_RAD = 1.8 * math.pi
"""Longest turn. Nearly a full circle is a detour or a rounding error."""
START_CLEARANCE_SHARE = 0.5
"""Share of the clearance that an initial turn must keep."""
MIN_RADIUS_SHARE = 0.5
"""Radius of the tightest expected turn, as a share of the planned radius."""
_EITHER_SIDE = math.radians(120.0)
_CHORD = math.radians(7.5)
"""Angle of the chords of arc tests. An arc is 0.002 radii above its chord: 9 cm at 40 m."""
_JOINS = 5
"""Number of places on the first leg where a word may end: 2, 4, 8, 16 radii ahead, or its end."""


class Pose(NamedTuple):
    """Position and direction."""

    x: float
    y: float
    angle: float


class Arc(NamedTuple):
    """Arc that begins at a pose: side (+1 left, -1 right), angle and radius."""

    side: float
    sweep: float
    radius: float


@leaf
def arc_is_clear(blocked: BoolArray, clearance: float, pose: Pose, arc: Arc, own_cell: int) -> bool:
    """Return True if an arc from a pose keeps `clearance`, tested by its chords."""
    count = max(1, math.ceil(arc.sweep / _CHORD))
    step = arc.sweep / count
    chord = 2.0 * arc.radius * math.sin(0.5 * step)
    x, y, angle = pose
    for _ in range(count):
        to_x = x + chord * math.cos(angle + arc.side * 0.5 * step)
        to_y = y + chord * math.sin(angle + arc.side * 0.5 * step)
        if not clear_leg(blocked, x, y, to_x, to_y, clearance, own_cell):
            return False
        x = to_x
        y = to_y
        angle += arc.side * step
    return True


@leaf
def arc_to(pose: Pose, to_x: float, to_y: float, side: float, radius: float) -> tuple[float, float]:
    """Return the sweep of the turn until a place lies straight ahead, and the length of the tangent to it.

    Both are inf for a place inside the turn.
    """
    dx = to_x - pose.x
    dy = to_y - pose.y
    ahead = dx * math.cos(pose.angle) + dy * math.sin(pose.angle)
    beyond = side * (dy * math.cos(pose.angle) - dx * math.sin(pose.angle)) - radius
    gap = math.hypot(ahead, beyond)
    if gap < radius:
        return np.inf, np.inf
    sweep = math.atan2(ahead, -beyond) - math.acos(min(radius / gap, 1.0))
    if sweep < 0.0:
        sweep = 0.0 if sweep > -1e-9 else sweep + 2.0 * math.pi
    return sweep, math.sqrt(gap * gap - radius * radius)


@leaf
def turn_to(pose: Pose, to_x: float, to_y: float, radius: float) -> tuple[float, float, float]:
    """Return side (+1 left, -1 right), sweep and length of the turn to a place with its tangent.

    The nearer side. Sweep and length are inf for a place inside the turn.
    """
    is_left = (to_y - pose.y) * math.cos(pose.angle) >= (to_x - pose.x) * math.sin(pose.angle)
    side = 1.0 if is_left else -1.0
    sweep, tangent = arc_to(pose, to_x, to_y, side, radius)
    return side, sweep, radius * sweep + tangent


@leaf
def _turn_is_clear(
    blocked: BoolArray, clearance: float, pose: Pose, arc: Arc, to_x: float, to_y: float, own_cell: int
) -> bool:
    """Return True if an arc and the straight leg from its end to a place keep `clearance`."""
    if not arc_is_clear(blocked, clearance, pose, arc, own_cell):
        return False
    turned = pose.angle + arc.side * arc.sweep
    x = pose.x + arc.side * arc.radius * (math.sin(turned) - math.sin(pose.angle))
    y = pose.y - arc.side * arc.radius * (math.cos(turned) - math.cos(pose.angle))
    return clear_leg(blocked, x, y, to_x, to_y, clearance, own_cell)


@kernel
def is_turn_clear(
    blocked: BoolArray, clearance: float, pose: Pose, to_x: float, to_y: float, radius: float, own_cell: int
) -> bool:
    """Return True if the turn to a place and its tangent keep `clearance`."""
    side, sweep, _ = turn_to(pose, to_x, to_y, radius)
    if sweep > MAX_ARC_RAD:
        return False
    return _turn_is_clear(blocked, clearance, pose, Arc(side, sweep, radius), to_x, to_y, own_cell)


@kernel
def is_turn_safe(
    blocked: BoolArray, clearance: float, x: float, y: float, angle: float, to_x: float, to_y: float,
    radius: float, own_cell: int,
) -> bool:  # fmt: skip
    """Return True if the turn to a place keeps `clearance` as it may be flown: tighter, or to the other side.

    Against the wind, or with more bank, a vehicle turns on half the radius. Towards a place nearly astern it
    may turn to either side.
    """
    pose = Pose(x, y, angle)
    dx = to_x - x
    dy = to_y - y
    ahead = dx * math.cos(angle) + dy * math.sin(angle)
    aside = dy * math.cos(angle) - dx * math.sin(angle)
    nearer = 1.0 if aside >= 0.0 else -1.0
    sides = 2 if math.atan2(abs(aside), ahead) > _EITHER_SIDE else 1
    for one in (radius, MIN_RADIUS_SHARE * radius):
        for k in range(sides):
            side = nearer if k == 0 else -nearer
            sweep = arc_to(pose, to_x, to_y, side, one)[0]
            if sweep > MAX_ARC_RAD:
                return False
            if not _turn_is_clear(blocked, clearance, pose, Arc(side, sweep, one), to_x, to_y, own_cell):
                return False
    return True


@kernel
def start_clearance(blocked: BoolArray, clearance: float, x: float, y: float) -> float:
    """Return the clearance required of an initial turn: a share of the clearance, at most the current one."""
    return min(START_CLEARANCE_SHARE * clearance, max(clearance_at(blocked, x, y, clearance) - TOUCH, 0.0))


@called
def _trace_word(
    blocked: BoolArray, margin: float, start: Pose, turns: IntArray, pieces: FloatArray, radius: float,
    own_cell: int, corners: FloatArray,
) -> int:  # fmt: skip
    """Write the corners of a Dubins word to `corners`; return their number, -1 if it is not clear."""
    count = 0
    x, y, angle = start
    last_x = x
    last_y = y
    for piece in range(3):
        side = float(turns[piece])
        length = pieces[piece]
        if side == 0.0:
            to_x = x + length * radius * math.cos(angle)
            to_y = y + length * radius * math.sin(angle)
            if not clear_leg(blocked, x, y, to_x, to_y, margin, own_cell):
                return -1
            x = to_x
            y = to_y
            continue
        arc = Arc(side, length, radius)
        if length > MAX_ARC_RAD or not arc_is_clear(blocked, margin, Pose(x, y, angle), arc, own_cell):
            return -1
        parts = max(1, math.ceil(length / MAX_TURN_RAD))
        tangent_length = radius * math.tan(0.5 * length / parts)
        for _ in range(parts):
            if length > 1e-6:
                corner_x = x + tangent_length * math.cos(angle)
                corner_y = y + tangent_length * math.sin(angle)
                if not (
                    is_free_at(blocked, corner_x, corner_y)
                    and clear_leg(blocked, last_x, last_y, corner_x, corner_y, margin, own_cell)
                ):
                    return -1
                set_point(corners, count, corner_x, corner_y)
                last_x = corner_x
                last_y = corner_y
                count += 1
            turned = angle + side * length / parts
            x += side * radius * (math.sin(turned) - math.sin(angle))
            y -= side * radius * (math.cos(turned) - math.cos(angle))
            angle = turned
    return count if clear_leg(blocked, last_x, last_y, x, y, margin, own_cell) else -1


@called
def _candidate_turns(
    points: FloatArray, angle: float, radius: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return n turns on to the first leg: (n, 3) sides, (n, 3) pieces, (n,) rest of the leg, in radii."""
    count = 2 + 6 * _JOINS
    turns = np.zeros((count, 3), np.int64)
    pieces = np.zeros((count, 3))
    left = np.zeros(count)
    ax = points[0, 0]
    ay = points[0, 1]
    bx = points[1, 0]
    by = points[1, 1]
    leg = math.hypot(bx - ax, by - ay)
    toward = math.atan2(by - ay, bx - ax)
    for k in range(2):
        sweep, tangent = arc_to(Pose(ax, ay, angle), bx, by, 1.0 - 2.0 * k, radius)
        turns[k, 0] = 1 - 2 * k
        pieces[k, 0] = sweep
        pieces[k, 1] = tangent / radius
    at = 2
    for join in range(_JOINS):
        end = leg if join == _JOINS - 1 else min(radius * 2.0 ** (join + 1), leg)
        share = end / max(leg, 1e-12)
        found = dubins_words(ax, ay, angle, ax + share * (bx - ax), ay + share * (by - ay), toward, radius)
        for word in range(6):
            for piece in range(3):
                turns[at, piece] = WORD_TURNS[word, piece]
                pieces[at, piece] = found[word, piece]
            left[at] = (leg - end) / radius
            at += 1
    return turns, pieces, left


@called
def plan_initial_turn(
    blocked: BoolArray, points: FloatArray, margin: float, angle: float, radius: float, own_cell: int
) -> tuple[FloatArray, float]:
    """Return the points with the shortest clear turn on to the first leg; unchanged without one.

    Also returns the length of that turn up to the first corner.
    """
    turns, pieces, left = _candidate_turns(points, angle, radius)
    x = points[1, 0]
    y = points[1, 1]
    start = Pose(points[0, 0], points[0, 1], angle)
    corners = np.empty((16, 2))
    lengths = np.empty(left.size)
    for k in range(left.size):
        lengths[k] = pieces[k, 0] + pieces[k, 1] + pieces[k, 2] + left[k]
    for _ in range(left.size):
        best = 0
        for k in range(left.size):
            if lengths[k] < lengths[best]:
                best = k
        if lengths[best] == np.inf:
            break
        count = _trace_word(blocked, margin, start, turns[best], pieces[best], radius, own_cell, corners)
        # The rest of the leg must be clear too where the turn joins it early.
        if count >= 0 and (
            count == 0
            or left[best] == 0.0
            or clear_leg(blocked, corners[count - 1, 0], corners[count - 1, 1], x, y, margin, own_cell)
        ):
            # A corner next to the first waypoint is dropped.
            while count > 0:
                last = corners[count - 1]
                before = corners[count - 2] if count > 1 else points[0]
                if math.hypot(last[0] - x, last[1] - y) >= 0.5 * radius:
                    break
                if not clear_leg(blocked, before[0], before[1], x, y, margin, own_cell):
                    break
                count -= 1
            size = points.shape[0]
            result = np.empty((size + count, 2))
            copy_point(points, ZERO, result, ZERO)
            for k in range(count):
                copy_point(corners, k, result, 1 + k)
            for k in range(1, size):
                copy_point(points, k, result, count + k)
            return result, radius * lengths[best]
        lengths[best] = np.inf
    return points, np.inf
