"""Dubins paths: shortest paths between two poses with a minimum turn radius.

Source: L. E. Dubins, American Journal of Mathematics 79, 1957. The shortest path of bounded curvature has
three pieces, arcs of the minimum radius (L left, R right) and straight lines (S), in one of six words: LSL,
RSR, LSR, RSL, RLR, LRL. The pieces follow from the circles that touch the two poses. For LSL and RSR the line
is parallel to the line of centres; for LSR and RSL it crosses between the circles; for RLR and LRL a third
circle touches both.

Angles are counter-clockwise from east.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import inlined, kernel
from gcs.model import FloatArray

WORD_TURNS = np.array([[1, 0, 1], [-1, 0, -1], [1, 0, -1], [-1, 0, 1], [-1, 1, -1], [1, -1, 1]])
"""(6, 3): +1 for a left arc, -1 for a right one, 0 for a straight line; LSL, RSR, LSR, RSL, RLR, LRL."""

_FULL = 2.0 * math.pi


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

    Rows as in `WORD_TURNS`.
    """
    pieces = np.full((6, 3), np.inf)
    for word in range(6):
        # A right turn first is a left turn first in the mirror.
        first = WORD_TURNS[word, 0]
        last = WORD_TURNS[word, 2]
        ax = x0 - first * radius * math.sin(angle0)
        ay = y0 + first * radius * math.cos(angle0)
        bx = x1 - last * radius * math.sin(angle1)
        by = y1 + last * radius * math.cos(angle1)
        dx = (bx - ax) / radius
        dy = (by - ay) / radius
        gap = math.hypot(dx, dy)
        bearing = math.atan2(dy, dx)
        if word < 2:
            # On one circle there is no line, and its bearing would be a rounding error's.
            along = bearing if gap > 1e-9 else angle0
            middle = gap
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
        leaves = along if word < 4 else along - first * middle
        pieces[word, 0] = _swept(first * (along - angle0))
        pieces[word, 1] = middle
        pieces[word, 2] = _swept(last * (angle1 - leaves))
    return pieces
