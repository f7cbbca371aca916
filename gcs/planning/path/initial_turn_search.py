"""The first turn where the plain one (`gcs.planning.path.initial_turn`) would hit an obstacle.

The shortest first, the turn to either side and its tangent are tried, and every Dubins word
(`gcs.planning.path.dubins`) that ends along the leg: at the leg's end, or soon, where the vehicle swings back
on to the leg that the plain turn would leave it beside. Arcs become the corners of the tangents around them.

Places in cells; angles counter-clockwise from east.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import called
from gcs.planning.map.line_of_sight import clear_leg
from gcs.planning.path.dubins import TURNS, words
from gcs.planning.path.initial_turn import MOST_ARC, arc_is_clear, arc_to

SPLIT = math.radians(107.0)
"""A sharper corner is flown as two: an autopilot cuts sharp corners, or swings out of them."""
_JOINS = 5
"""Places on the first leg where a word may end: 2, 4, 8, 16 radii ahead, or its end."""


@called
def _trace(blocked, room, x, y, angle, turns, pieces, radius, own, tips):  # type: ignore[no-untyped-def]
    """Follow one Dubins word: the corners of its arcs to `tips`; how many, -1 if it is not clear."""
    count, last_x, last_y = 0, x, y
    for piece in range(3):
        side, long = turns[piece], pieces[piece]
        if side == 0:
            to_x, to_y = x + long * radius * math.cos(angle), y + long * radius * math.sin(angle)
            if not clear_leg(blocked, x, y, to_x, to_y, room, own):
                return -1
            x, y = to_x, to_y
            continue
        if long > MOST_ARC or not arc_is_clear(blocked, room, x, y, angle, side, long, radius, own):
            return -1
        parts = max(1, math.ceil(long / SPLIT))
        tip = radius * math.tan(0.5 * long / parts)
        for _ in range(parts):
            if long > 1e-6:
                tip_x, tip_y = x + tip * math.cos(angle), y + tip * math.sin(angle)
                if not clear_leg(blocked, last_x, last_y, tip_x, tip_y, room, own):
                    return -1
                tips[count, 0], tips[count, 1] = tip_x, tip_y
                last_x, last_y = tip_x, tip_y
                count += 1
            turned = angle + side * long / parts
            x += side * radius * (math.sin(turned) - math.sin(angle))
            y -= side * radius * (math.cos(turned) - math.cos(angle))
            angle = turned
    return count if clear_leg(blocked, last_x, last_y, x, y, room, own) else -1


@called
def _choices(points, angle, radius):  # type: ignore[no-untyped-def]
    """Ways on to the first leg, n of them: what turns they are of, pieces, and what is left of the leg.

    All in radii; (n, 3), (n, 3), (n,).
    """
    count = 2 + 6 * _JOINS
    turns, pieces, left = np.zeros((count, 3), np.int64), np.zeros((count, 3)), np.zeros(count)
    ax, ay, bx, by = points[0, 0], points[0, 1], points[1, 0], points[1, 1]
    leg, toward = math.hypot(bx - ax, by - ay), math.atan2(by - ay, bx - ax)
    for k in range(2):
        sweep, tangent = arc_to(ax, ay, angle, bx, by, 1.0 - 2.0 * k, radius)
        turns[k, 0], pieces[k, 0], pieces[k, 1] = 1 - 2 * k, sweep, tangent / radius
    at = 2
    for join in range(_JOINS):
        end = leg if join == _JOINS - 1 else min(radius * 2.0 ** (join + 1), leg)
        share = end / max(leg, 1e-12)
        found = words(ax, ay, angle, ax + share * (bx - ax), ay + share * (by - ay), toward, radius)
        for word in range(6):
            for piece in range(3):
                turns[at, piece], pieces[at, piece] = TURNS[word, piece], found[word, piece]
            left[at] = (leg - end) / radius
            at += 1
    return turns, pieces, left


@called
def entry(blocked, points, room, angle, radius, own):  # type: ignore[no-untyped-def]
    """The points with the shortest clear way on to the first leg; the same without one.

    Also returns the length of that way to the first corner.
    """
    turns, pieces, left = _choices(points, angle, radius)
    x, y = points[1, 0], points[1, 1]
    tips, lengths = np.empty((16, 2)), np.empty(left.size)
    for k in range(left.size):
        lengths[k] = pieces[k, 0] + pieces[k, 1] + pieces[k, 2] + left[k]
    for _ in range(left.size):
        best = 0
        for k in range(left.size):
            if lengths[k] < lengths[best]:
                best = k
        if lengths[best] == np.inf:
            break
        count = _trace(
            blocked, room, points[0, 0], points[0, 1], angle, turns[best], pieces[best], radius, own, tips
        )
        # Where the way joins the leg early, what is left of that must be clear too.
        if count >= 0 and (
            count == 0
            or left[best] == 0.0
            or clear_leg(blocked, tips[count - 1, 0], tips[count - 1, 1], x, y, room, own)
        ):
            # A tip beside the first corner is no corner.
            while count > 0:
                last, before = tips[count - 1], tips[count - 2] if count > 1 else points[0]
                if math.hypot(last[0] - x, last[1] - y) >= 0.5 * radius:
                    break
                if not clear_leg(blocked, before[0], before[1], x, y, room, own):
                    break
                count -= 1
            size = points.shape[0]
            result = np.empty((size + count, 2))
            result[0, 0], result[0, 1] = points[0, 0], points[0, 1]
            for k in range(count):
                result[1 + k, 0], result[1 + k, 1] = tips[k, 0], tips[k, 1]
            for k in range(1, size):
                result[count + k, 0], result[count + k, 1] = points[k, 0], points[k, 1]
            return result, radius * lengths[best]
        lengths[best] = np.inf
    return points, np.inf
