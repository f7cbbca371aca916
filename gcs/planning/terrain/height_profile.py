"""Heights along a path inside the band: a profile near a share of the band, with few knots.

Autopilots fly each leg with a height that is linear between its two waypoints. So a profile is linear between
knots: the middle of each turn, whose height is that of its waypoint, and places on straight legs, which get a
waypoint of their own.

1. Intervals from the start and from the end give the heights that belong to a whole profile inside the band.
2. A profile follows the wanted share of the band as closely as those heights and the gradients allow.
3. A taut string within `_TUBE_M` of it smooths it. Of all profiles in a tube with given ends the taut string
   has the least of every convex measure of its slopes, so it keeps the gradients, too. It keeps away from
   floor and ceiling where the profile does, so that a line between two of its places has room.
4. Knots are added where a line between two knots would leave the band.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.jit import kernel, leaf
from gcs.model import Float32Array, FloatArray, Int32Array, IntArray
from gcs.planning.terrain.band import NO_BAND_M, read_limits
from gcs.planning.terrain.corner_path import turn_at
from gcs.planning.terrain.intervals import advance, begin

_TUBE_M = 10.0
_NO_LENGTH_M = 1e-6
_BAND_TOLERANCE_M = 0.25
"""Distance by which a line between two knots may leave the band that a profile is planned in."""


@kernel
def sample_path(
    points: FloatArray, radius: float, step_m: float
) -> tuple[FloatArray, Int32Array, Int32Array]:
    """Return places along a path with its turns.

    Returns
    -------
    places : ndarray, shape (n, 3)
        x, y and length flown, at most `step_m` apart.
    corners : ndarray of int32, shape (n,)
        Index of the point whose turn a place lies in, -1 on a straight leg.
    knots : ndarray of int32, shape (k,)
        Place of each point: the middle of its turn.
    """
    count = points.shape[0]
    bound = 2
    for i in range(count - 1):
        leg = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        bound += int(leg / step_m) + 2 + int(radius * math.pi / step_m) + 4
    places = np.empty((bound, 3))
    corners = np.empty(bound, np.int32)
    knots = np.empty(count, np.int32)
    places[0, 0] = points[0, 0]
    places[0, 1] = points[0, 1]
    places[0, 2] = 0.0
    corners[0] = -1
    knots[0] = 0
    size = 1
    along = 0.0
    before = 0.0
    for i in range(count - 1):
        dx = points[i + 1, 0] - points[i, 0]
        dy = points[i + 1, 1] - points[i, 1]
        leg = math.hypot(dx, dy)
        course = math.atan2(dy, dx)
        turn = turn_at(points, i + 1, count)
        behind = radius * abs(math.tan(0.5 * turn))
        line_m = max(leg - before - behind, 0.0)
        parts = math.ceil(line_m / step_m) if line_m > _NO_LENGTH_M else 0
        for k in range(1, parts + 1):
            at = before + line_m * k / parts
            places[size, 0] = points[i, 0] + at * math.cos(course)
            places[size, 1] = points[i, 1] + at * math.sin(course)
            places[size, 2] = along + line_m * k / parts
            corners[size] = -1
            size += 1
        along += line_m
        knots[i + 1] = size - 1
        before = behind
        if radius * abs(turn) > _NO_LENGTH_M:
            side = 1.0 if turn > 0.0 else -1.0
            x = points[i + 1, 0] - behind * math.cos(course) - side * radius * math.sin(course)
            y = points[i + 1, 1] - behind * math.sin(course) + side * radius * math.cos(course)
            arc_m = radius * abs(turn)
            parts = 2 * math.ceil(0.5 * arc_m / step_m)
            for k in range(1, parts + 1):
                turned = course + turn * k / parts
                places[size, 0] = x + side * radius * math.sin(turned)
                places[size, 1] = y - side * radius * math.cos(turned)
                places[size, 2] = along + arc_m * k / parts
                corners[size] = i + 1 if k < parts else -1
                if 2 * k == parts:
                    knots[i + 1] = size
                size += 1
            along += arc_m
    return places[:size], corners[:size], knots


@leaf
def _pull_string(along: FloatArray, lows: FloatArray, highs: FloatArray, heights: FloatArray) -> None:
    """Replace a profile by the taut string with the same ends between two others."""
    last = along.size - 1
    knot = 0
    at = heights[0]
    end = heights[last]
    while knot < last:
        steepest = -np.inf
        flattest = np.inf
        low_knot = last
        high_knot = last
        to = last
        height = end
        for i in range(knot + 1, last + 1):
            apart = max(along[i] - along[knot], 1e-9)
            low = (end if i == last else lows[i]) - at
            high = (end if i == last else highs[i]) - at
            if low > flattest * apart:
                to = high_knot
                height = highs[to]
                break
            if high < steepest * apart:
                to = low_knot
                height = lows[to]
                break
            if low >= steepest * apart:
                steepest = low / apart
                low_knot = i
            if high <= flattest * apart:
                flattest = high / apart
                high_knot = i
        for i in range(knot + 1, to + 1):
            heights[i] = at + (height - at) * (along[i] - along[knot]) / max(along[to] - along[knot], 1e-9)
        knot = to
        at = height


@leaf
def _fill_limits(
    surfaces: Float32Array, per_m: float, rates: FloatArray, places: FloatArray, ends: FloatArray,
    limits: FloatArray, ahead: FloatArray, behind: FloatArray,
) -> bool:  # fmt: skip
    """Fill floor and ceiling, and the intervals from the start and from the end; False if one is empty."""
    size = places.shape[0]
    for i in range(size):
        floor, ceiling = read_limits(surfaces, places[i, 0] * per_m, places[i, 1] * per_m)
        limits[i, 0] = floor
        limits[i, 1] = ceiling
    low, high, entry = begin(ends[0, 4], ends[0, 5], limits[0, 0], limits[0, 1], rates[2])
    for i in range(size):
        if i > 0:
            step = places[i, 2] - places[i - 1, 2]
            low, high, entry = advance(
                low, high, entry, limits[i, 0], limits[i, 1], rates[0] * step, rates[1] * step, rates[2]
            )
        if low > high:
            return False
        ahead[i, 0] = low
        ahead[i, 1] = high
        ahead[i, 2] = entry
    low = max(ends[1, 4], low)
    high = min(ends[1, 5], high)
    if entry != 0.0 or low > high:
        return False
    for i in range(size - 1, -1, -1):
        if ahead[i, 2] != 0.0:
            # The profile that enters the band is fixed.
            low = ahead[i, 0]
            high = ahead[i, 1]
        elif i < size - 1:
            step = places[i + 1, 2] - places[i, 2]
            low = max(low - rates[0] * step, limits[i, 0])
            high = min(high + rates[1] * step, limits[i, 1])
        if low > high:
            return False
        behind[i, 0] = low
        behind[i, 1] = high
    return True


@kernel
def plan_heights(
    surfaces: Float32Array, band_spacing_m: float, rates: FloatArray, places: FloatArray, ends: FloatArray,
    share: float, spare_m: float,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return a profile (n,) and its floor and ceiling (n, 2); empty if there is none.

    `rates`: climb and sink gradient, entry depth. `places` as of `sample_path`, `ends` as of `shorten_path`.
    `spare_m`: distance from floor and ceiling that the string keeps where the profile does.
    """
    size = places.shape[0]
    limits = np.empty((size, 2))
    ahead = np.empty((size, 3))
    behind = np.empty((size, 2))
    heights = np.empty(size)
    if not _fill_limits(surfaces, 1.0 / band_spacing_m, rates, places, ends, limits, ahead, behind):
        return heights[:0], limits
    inside = 0
    for i in range(size):
        wanted = limits[i, 0] + share * (limits[i, 1] - limits[i, 0])
        low = max(ahead[i, 0], behind[i, 0])
        high = min(ahead[i, 1], behind[i, 1])
        if i > 0 and ahead[i, 2] == 0.0:
            step = places[i, 2] - places[i - 1, 2]
            low = max(behind[i, 0], heights[i - 1] - rates[1] * step)
            high = min(behind[i, 1], heights[i - 1] + rates[0] * step)
        if ahead[i, 2] != 0.0:
            inside = i + 1
            # Limits of a vehicle that enters the band.
            limits[i, 0] -= rates[2] if ahead[i, 2] < 0.0 else 0.0
            limits[i, 1] += NO_BAND_M if ahead[i, 2] > 0.0 else 0.0
        heights[i] = min(max(wanted, low), high)
    tube = np.empty((size, 2))
    for i in range(size):
        tube[i, 0] = min(max(limits[i, 0] + spare_m, heights[i] - _TUBE_M), heights[i])
        tube[i, 1] = max(min(limits[i, 1] - spare_m, heights[i] + _TUBE_M), heights[i])
    _pull_string(places[inside:, 2], tube[inside:, 0], tube[inside:, 1], heights[inside:])
    return heights, limits


@kernel
def choose_knots(
    along: FloatArray, corners: Int32Array, heights: FloatArray, limits: FloatArray, knots: IntArray,
) -> tuple[IntArray, int]:  # fmt: skip
    """Return the knots of a profile that is linear between them and stays in the band, in order.

    Given knots stay. Knots are added on straight legs. Also returns the corner in whose turn the profile
    leaves the band nevertheless, -1 for none.
    """
    size = along.size
    result = np.empty(size, np.int64)
    is_knot = np.zeros(size, np.bool_)
    for i in range(knots.size):
        is_knot[knots[i]] = True
    sharp = -1
    first = 0
    while first < size - 1:
        last = first + 1
        while not is_knot[last]:
            last += 1
        worst = _BAND_TOLERANCE_M
        at = -1
        for i in range(first + 1, last):
            share = (along[i] - along[first]) / (along[last] - along[first])
            height = heights[first] + share * (heights[last] - heights[first])
            off = max(limits[i, 0] - height, height - limits[i, 1])
            if off > worst:
                worst = off
                at = i
        if at < 0:
            first = last
            continue
        # The nearest place on a straight leg, inwards of both knots.
        before = at
        while before > first and corners[before] >= 0:
            before -= 1
        behind = at
        while behind < last and corners[behind] >= 0:
            behind += 1
        if before <= first and behind >= last:
            if sharp < 0:
                sharp = corners[at]
            first = last
        elif before <= first or (behind < last and behind - at < at - before):
            is_knot[behind] = True
        else:
            is_knot[before] = True
    count = 0
    for i in range(size):
        if is_knot[i]:
            result[count] = i
            count += 1
    return result[:count], sharp
