"""Corner splitting: a sharp corner becomes two, since autopilots cut sharp corners or overshoot."""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import called
from gcs.model import BoolArray, FloatArray
from gcs.planning.map.line_of_sight import NO_CELL, clear_leg, is_free_at
from gcs.planning.path.corner_smoothing import half_angle_tan, leg_fits, turn_angle
from gcs.planning.path.points import copy_point, leg_vector, set_point

MAX_TURN_RAD = math.radians(107.0)
"""Corners with a sharper turn are split."""


@called
def split_corners(
    blocked: BoolArray, points: FloatArray, clearances: FloatArray, radius: float
) -> FloatArray:
    """Split sharp corners in two around the same arc, where that is clear."""
    size = points.shape[0]
    result = np.empty((2 * size, 2))
    count = 0
    for i in range(size):
        copy_point(points, i, result, count)
        count += 1
        turn = abs(turn_angle(points, i)) if 0 < i < size - 1 else 0.0
        if turn <= MAX_TURN_RAD or not (leg_fits(points, i - 1, radius) and leg_fits(points, i, radius)):
            continue
        ux, uy = leg_vector(points, i - 1)
        vx, vy = leg_vector(points, i)
        back = radius * abs(half_angle_tan(points, i)) - radius * math.tan(0.25 * turn)
        u = back / math.hypot(ux, uy)
        v = back / math.hypot(vx, vy)
        ax = points[i, 0] - u * ux
        ay = points[i, 1] - u * uy
        bx = points[i, 0] + v * vx
        by = points[i, 1] + v * vy
        margin = min(clearances[i - 1], clearances[i])
        if is_free_at(blocked, ax, ay) and clear_leg(blocked, ax, ay, bx, by, margin, NO_CELL):
            set_point(result, count - 1, ax, ay)
            set_point(result, count, bx, by)
            count += 1
    return result[:count].copy()
