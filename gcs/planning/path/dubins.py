"""Dubins paths: shortest paths between two poses with a minimum turn radius.

Source: L. E. Dubins, American Journal of Mathematics 79, 1957. The shortest path of bounded curvature has
three pieces, arcs of the minimum radius (L left, R right) and straight lines (S), in one of six words: LSL,
RSR, LSR, RSL, RLR, LRL. The pieces follow from the circles that touch the two poses. For LSL and RSR the line
is parallel to the line of centres; for LSR and RSL it crosses between the circles; for RLR and LRL a third
circle touches both.

Kernels use angles counter-clockwise from east. A public `Pose` has a course clockwise from north.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gcs.jit import inlined, kernel
from gcs.model import FloatArray

WORDS = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")
WORD_TURNS = np.array([[1, 0, 1], [-1, 0, -1], [1, 0, -1], [-1, 0, 1], [-1, 1, -1], [1, -1, 1]])
"""(6, 3): +1 for a left arc, -1 for a right one, 0 for a straight line, of each word."""

_FULL = 2.0 * math.pi


class Pose(NamedTuple):
    """Position and course over ground, clockwise from north."""

    east_m: float
    north_m: float
    course_rad: float


@inlined
def _swept(angle: float) -> float:
    """Return an arc in [0, 2 pi); 0 where rounding would make it a full circle."""
    turned = angle % _FULL
    return 0.0 if turned > _FULL - 1e-9 else turned


@kernel
def dubins_words(
    x0: float, y0: float, angle0: float, x1: float, y1: float, angle1: float, radius: float
) -> FloatArray:
    """Return the pieces of all six words, (6, 3): arcs in radians, lines in radii; inf if impossible.

    Angles are counter-clockwise from east. Rows as in `WORDS`.
    """
    pieces = np.full((6, 3), np.inf)
    for word in range(6):
        # A right turn first is a left turn first in the mirror.
        first, last = WORD_TURNS[word, 0], WORD_TURNS[word, 2]
        ax, ay = x0 - first * radius * math.sin(angle0), y0 + first * radius * math.cos(angle0)
        bx, by = x1 - last * radius * math.sin(angle1), y1 + last * radius * math.cos(angle1)
        dx, dy = (bx - ax) / radius, (by - ay) / radius
        gap, bearing = math.hypot(dx, dy), math.atan2(dy, dx)
        if word < 2:
            # On one circle there is no line, and its bearing would be a rounding error's.
            along, middle = bearing if gap > 1e-9 else angle0, gap
        elif word < 4:
            if gap < 2.0:
                continue
            middle = math.sqrt(gap * gap - 4.0)
            along = bearing + first * math.asin(min(2.0 / gap, 1.0))
        else:
            if gap > 4.0:
                continue
            # The middle circle lies to the side that makes its arc the long one.
            half = math.acos(gap / 4.0)
            middle = math.pi + 2.0 * half
            along = bearing + first * (half + 0.5 * math.pi)
        if word < 4:
            pieces[word, 0] = _swept(first * (along - angle0))
            pieces[word, 1] = middle
            pieces[word, 2] = _swept(last * (angle1 - along))
        else:
            leaves = along - first * middle
            pieces[word, 0] = _swept(first * (along - angle0))
            pieces[word, 1] = middle
            pieces[word, 2] = _swept(first * (angle1 - leaves))
    return pieces


@dataclass(frozen=True, slots=True)
class DubinsPath:
    """Shortest path of bounded curvature.

    Attributes
    ----------
    word : str
        One of `WORDS`.
    pieces_m : tuple of three float
        Length of each piece.
    """

    start: Pose
    radius_m: float
    word: str
    pieces_m: tuple[float, float, float]

    @property
    def length_m(self) -> float:
        """Length of the whole path."""
        return math.fsum(self.pieces_m)

    def at(self, along_m: float) -> Pose:
        """Return the pose at a distance along the path, at most its end."""
        east, north, course = self.start
        for kind, piece_m in zip(self.word, self.pieces_m, strict=True):
            go_m = min(along_m, piece_m)
            if kind == "S":
                east, north = east + go_m * math.sin(course), north + go_m * math.cos(course)
            else:
                side = 1.0 if kind == "R" else -1.0
                turned = course + side * go_m / self.radius_m
                east += side * self.radius_m * (math.cos(course) - math.cos(turned))
                north += side * self.radius_m * (math.sin(turned) - math.sin(course))
                course = turned
            along_m -= go_m
        return Pose(east, north, course)

    def sampled_m(self, step_m: float) -> FloatArray:
        """Return (k, 2) points at most `step_m` apart, both ends included."""
        count = max(2, math.ceil(self.length_m / step_m) + 1)
        return np.array([self.at(along)[:2] for along in np.linspace(0.0, self.length_m, count)])


def dubins_path(start: Pose, end: Pose, radius_m: float) -> DubinsPath:
    """Return the shortest path between two poses.

    Raises
    ------
    ValueError
        For a radius that is not a positive number.
    """
    if not (math.isfinite(radius_m) and radius_m > 0.0):
        raise ValueError(f"radius_m must be a positive number, not {radius_m}")
    pieces = dubins_words(
        start.east_m,
        start.north_m,
        0.5 * math.pi - start.course_rad,
        end.east_m,
        end.north_m,
        0.5 * math.pi - end.course_rad,
        radius_m,
    )
    best = int(np.argmin(pieces.sum(axis=1)))
    a, b, c = (float(piece) * radius_m for piece in pieces[best])
    return DubinsPath(start, radius_m, WORDS[best], (a, b, c))
