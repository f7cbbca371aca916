"""Turns of a minimum radius for a string-pulled path, begun on the vehicle's course.

A vehicle at speed V and bank phi turns with a radius of R = V^2 / (g tan phi) or more.

- *Corners* are flown as arcs tangent to both legs. An arc passes inside its corner by R (sec(a/2) - 1), where
  a string-pulled path has its obstacle. So corners are moved until arcs are clear and legs long enough
  (`gcs.planning.path.corner_smoothing`). Then corners are joined or dropped where that costs little.
- *The start* follows the vehicle's course with the initial turn of the autopilot
  (`gcs.planning.path.initial_turn`). If that is blocked, explicit turn waypoints are added.
- Sharp corners are split in two (`gcs.planning.path.corner_splitting`).

Every leg and arc keeps the clearance that the path had there. A turn that cannot be flown stays as it was
and is reported: a straight plan is better than none.

Positions in cells; angles counter-clockwise from east.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.jit import called, inlined, kernel
from gcs.model import BoolArray, FloatArray
from gcs.planning.map.line_of_sight import NO_CELL, clear_leg, is_free_at, leg_clearance
from gcs.planning.path.corner_smoothing import (
    cost,
    half_angle_tan,
    leg_fits,
    smooth_corners,
    turn_angle,
    turn_fits,
)
from gcs.planning.path.corner_splitting import MAX_TURN_RAD, split_corners
from gcs.planning.path.initial_turn import Pose, is_turn_safe, plan_initial_turn, start_clearance, turn_to
from gcs.planning.path.points import copy_point, leg_vector, set_point

# Turns that cannot be flown: none, a corner, the initial turn; or the sum of both.
FLYABLE = 0
SHARP_CORNER = 1
SHARP_START = 2

_CORNER_COST = 0.06
"""Cost that removing a corner may add, in cells."""
_CLEARANCE_HALVINGS = 3


@dataclass(frozen=True, slots=True)
class TurnAnticipation:
    """Turn anticipation: how far before a waypoint a vehicle begins its turn."""

    radius_m: float
    """Turn radius."""
    lag_m: float
    """Distance flown before a turn is taken up."""
    min_accept_radius_m: float
    """Least acceptance radius."""
    wind_m_s: float = 0.0
    """Greatest wind speed, for which `radius_m` and `lag_m` allow downwind."""

    def accept_radii_m(self, points_m: FloatArray) -> FloatArray:
        """Return the acceptance radius of each waypoint.

        An arc of radius R begins R tan(a/2) before a corner of angle a. The turn lag adds `lag_m`, as the
        root of the sum of squares: for a heading that follows the bearing exponentially, this is within 5 %
        of the distance that neither cuts nor overshoots.

        Parameters
        ----------
        points_m : ndarray, shape (k, 2)
            Start position and waypoints.

        Returns
        -------
        ndarray, shape (k - 1,)
            The last one is `min_accept_radius_m`. At most half of the leg to the waypoint, so that no corner
            is skipped, but at least `min_accept_radius_m`.
        """
        legs = np.diff(points_m, axis=0)
        lengths = np.hypot(legs[:, 0], legs[:, 1])
        result = np.full(len(legs), self.min_accept_radius_m)
        for i in range(len(legs) - 1):
            turn = math.atan2(
                legs[i, 0] * legs[i + 1, 1] - legs[i, 1] * legs[i + 1, 0], float(legs[i] @ legs[i + 1])
            )
            wanted = math.hypot(self.radius_m * math.tan(min(abs(turn), MAX_TURN_RAD) / 2.0), self.lag_m)
            result[i] = max(self.min_accept_radius_m, min(wanted, 0.5 * lengths[i]))
        return result


@inlined
def _drop_corner(points: FloatArray, clearances: FloatArray, i: int) -> tuple[FloatArray, FloatArray]:
    """Return the points without i. The new leg has the lesser clearance of the two that it replaces."""
    size = points.shape[0]
    fewer = np.empty((size - 1, 2))
    fewer_clearances = np.empty(size - 2)
    for k in range(size - 1):
        at = k if k < i else k + 1
        copy_point(points, at, fewer, k)
    for k in range(size - 2):
        fewer_clearances[k] = clearances[k] if k < i else clearances[k + 1]
    fewer_clearances[i - 1] = min(clearances[i - 1], clearances[i])
    return fewer, fewer_clearances


@called
def _join_corners(
    blocked: BoolArray, points: FloatArray, clearances: FloatArray, i: int, own_cell: int
) -> tuple[FloatArray, FloatArray]:
    """Join corners i and i + 1 where their outer legs meet; unchanged if that is not clear."""
    if i >= points.shape[0] - 2:
        return points, clearances
    ux, uy = leg_vector(points, i - 1)
    vx, vy = leg_vector(points, i + 1)
    across = ux * vy - uy * vx
    if abs(across) < 1e-9:
        return points, clearances
    gx = points[i + 1, 0] - points[i, 0]
    gy = points[i + 1, 1] - points[i, 1]
    ahead = (gx * vy - gy * vx) / across
    behind = (gx * uy - gy * ux) / across
    if ahead <= 0.0 or behind >= 0.0:
        return points, clearances
    fewer, fewer_clearances = _drop_corner(points, clearances, i + 1)
    set_point(fewer, i, points[i, 0] + ahead * ux, points[i, 1] + ahead * uy)
    if not is_free_at(blocked, fewer[i, 0], fewer[i, 1]):
        return points, clearances
    for k in range(i - 1, i + 1):
        ignored_cell = own_cell if k == 0 else NO_CELL
        if not clear_leg(
            blocked,
            fewer[k, 0],
            fewer[k, 1],
            fewer[k + 1, 0],
            fewer[k + 1, 1],
            fewer_clearances[k],
            ignored_cell,
        ):
            return points, clearances
    return fewer, fewer_clearances


@called
def _reduce_corners(
    blocked: BoolArray, points: FloatArray, clearances: FloatArray, radius: float, own_cell: int
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Join or drop corners where that is clear and costs no more than `_CORNER_COST`.

    Also returns the corners that changed.
    """
    i = 1
    changed = np.zeros(points.shape[0], np.bool_)
    while i < points.shape[0] - 1:
        most = cost(blocked, points, clearances, i - 2, i + 3, radius, own_cell, np.inf) + _CORNER_COST
        fewer, fewer_clearances = _join_corners(blocked, points, clearances, i, own_cell)
        is_better = fewer.shape[0] < points.shape[0]
        is_better = (
            is_better and cost(blocked, fewer, fewer_clearances, i - 2, i + 2, radius, own_cell, most) < most
        )
        if not is_better:
            margin = min(clearances[i - 1], clearances[i])
            ignored_cell = own_cell if i == 1 else NO_CELL
            ax = points[i - 1, 0]
            ay = points[i - 1, 1]
            bx = points[i + 1, 0]
            by = points[i + 1, 1]
            if clear_leg(blocked, ax, ay, bx, by, margin, ignored_cell):
                fewer, fewer_clearances = _drop_corner(points, clearances, i)
                is_better = (
                    cost(blocked, fewer, fewer_clearances, i - 2, i + 2, radius, own_cell, most) < most
                )
        if is_better:
            points = fewer
            clearances = fewer_clearances
            for k in range(i, points.shape[0]):
                changed[k] = changed[k + 1]
            changed[i - 1] = changed[i] = changed[i + 1] = True
            i = max(i - 1, 1)
        else:
            i += 1
    return points, clearances, changed[: points.shape[0]].copy()


@called
def _corners_are_clear(
    blocked: BoolArray, points: FloatArray, clearances: FloatArray, radius: float, own_cell: int
) -> bool:
    """Return True if every leg is long enough for its turns and every arc keeps its clearance."""
    for i in range(1, points.shape[0] - 1):
        if not turn_fits(blocked, points, clearances, i, radius, own_cell):
            return False
    return True


@called
def _flown_length(points: FloatArray, radius: float) -> float:
    """Return the length along legs and arcs; along the legs alone where an arc does not fit."""
    length = 0.0
    for i in range(points.shape[0] - 1):
        dx, dy = leg_vector(points, i)
        length += math.hypot(dx, dy)
        if i > 0 and leg_fits(points, i - 1, radius) and leg_fits(points, i, radius):
            length -= 2.0 * radius * abs(half_angle_tan(points, i)) - radius * abs(turn_angle(points, i))
    return length


@kernel
def make_flyable(
    blocked: BoolArray, clearance: float, vertices: FloatArray, heading: FloatArray, radius: float,
    own_cell: int,
) -> tuple[FloatArray, float, int]:  # fmt: skip
    """Add flyable turns to a string-pulled path.

    `clearance` in cells. `vertices` (k, 2): the vehicle first. `heading` (2,): unit vector, zeros if unknown.
    `radius` > 0: turn radius in cells. `own_cell` as of `pull_string`. Returns the corners (j, 2), the length
    along the arcs in cells, and the turns that cannot be flown (`FLYABLE` ...).
    """
    legs = vertices.shape[0] - 1
    clearances = np.empty(legs)
    problem = FLYABLE
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
    points = vertices.copy()
    smooth_corners(blocked, points, clearances, radius, own_cell, np.ones(legs + 1, np.bool_))
    points, clearances, changed = _reduce_corners(blocked, points, clearances, radius, own_cell)
    smooth_corners(blocked, points, clearances, radius, own_cell, changed)
    if not _corners_are_clear(blocked, points, clearances, radius, own_cell):
        problem = SHARP_CORNER
    length = _flown_length(points, radius)
    points = split_corners(blocked, points, clearances, radius)
    if legs > 0 and (heading[0] != 0.0 or heading[1] != 0.0):
        angle = math.atan2(heading[1], heading[0])
        x = points[0, 0]
        y = points[0, 1]
        to_x = points[1, 0]
        to_y = points[1, 1]
        margin = start_clearance(blocked, min(clearance, clearances[0]), x, y)
        straight = math.hypot(to_x - x, to_y - y)
        problem += SHARP_START
        # A direct turn with less clearance is preferred to an explicit turn with more.
        for attempt in range(2 * _CLEARANCE_HALVINGS):
            tried = margin * 0.5 ** (attempt % _CLEARANCE_HALVINGS)
            if attempt < _CLEARANCE_HALVINGS:
                if is_turn_safe(blocked, tried, x, y, angle, to_x, to_y, radius, own_cell):
                    length += turn_to(Pose(x, y, angle), to_x, to_y, radius)[2] - straight
                    problem -= SHARP_START
                    break
                continue
            other, word_length = plan_initial_turn(blocked, points, tried, angle, radius, own_cell)
            if other.shape[0] > points.shape[0]:
                points = other
                length += word_length - straight
                problem -= SHARP_START
                break
    return points, length, problem
