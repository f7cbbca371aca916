"""Lengths of paths without turns from every place to a goal, by the height at the place.

A one-to-all Dijkstra search from the goal over nodes some 40 m apart, with sixteen moves from each. A
label is a length with an interval of heights (`gcs.planning.terrain.intervals`): from any of these
heights a path of that length leads to the goal inside the band. A longer path gets a label of its own if
it serves other heights. So the field knows that a climb of 300 m takes 2 km, in serpentines where the
slope is steeper.

The field is the heuristic of `gcs.planning.terrain.pose_search`, and the cost matrix of all starts and
goals.

A move maps an interval in closed form. For the greatest gains c d and losses s d over the move,

    low' = max(low - s d, F),  high' = min(high + c d, C),  possible if low <= A and high >= B

where F and C are the least and the greatest height at its end that floor and ceiling on the way allow,
and A and B follow from the floor and the ceiling at each place on the way. The four numbers of each move
are computed once for a band (`move_limits`). The search runs backwards, so climb and sink change places.

Labels are kept in buckets of costs narrower than the shortest move: each is final when its bucket is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.jit import ZERO, kernel, leaf, spliced
from gcs.model import Float32Array, FloatArray, Int32Array, IntArray
from gcs.planning.terrain.band import FlightBand, Vertical, read_limits

MOVES = np.array(
    [
        *((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)),
        *((1, 2), (2, 1), (2, -1), (1, -2), (-1, -2), (-2, -1), (-2, 1), (-1, 2)),
    ]
)
"""(16, 2): rows north, columns east."""
MAX_LABELS = 3
"""Labels of a node."""
_SPACING_M = 40.0
_MAX_NODES = 60_000
_SAME_HEIGHT_M = 4.0
"""Heights that a longer path must add to an interval to be kept."""
_BUCKET_SHARE = 0.25
"""Width of a bucket, as a share of the shortest move."""
_MAX_ENTRIES_PER_NODE = 48
_CLOSE_HEIGHT_M = 6.0
"""Gap between two heights of places a move apart that costs nothing."""


@dataclass(frozen=True, eq=False)
class MoveMap:
    """Nodes of a search and the limits of each move between them, for one band and `Vertical`.

    Attributes
    ----------
    band : FlightBand
    vertical : Vertical
    spacing_m : float
        Distance of neighbouring nodes; node (0, 0) is that of the band.
    limits : ndarray of float32, shape (rows, cols, 16, 4)
        F, C, A and B of the move against the flight, from each node.
    """

    band: FlightBand
    vertical: Vertical
    spacing_m: float
    limits: Float32Array


def make_move_map(band: FlightBand, vertical: Vertical) -> MoveMap:
    """Return the nodes and the limits of their moves; about 0.1 s for 20,000 nodes."""
    rows, cols, _ = band.surfaces_msl_m.shape
    size_m = np.array([rows - 1, cols - 1]) * band.spacing_m
    spacing_m = max(_SPACING_M, band.spacing_m, math.sqrt(float(np.prod(size_m)) / _MAX_NODES))
    shape = (size_m // spacing_m).astype(np.int64) + 1
    limits = move_limits(
        band.surfaces_msl_m,
        band.spacing_m,
        spacing_m,
        shape,
        vertical.climb_gradient,
        vertical.sink_gradient,
    )
    return MoveMap(band, vertical, spacing_m, limits)


@kernel
def move_limits(
    surfaces: Float32Array,
    band_spacing_m: float,
    spacing_m: float,
    shape: IntArray,
    climb: float,
    sink: float,
) -> Float32Array:
    """Return F, C, A and B of each move, (rows, cols, 16, 4); without a band on the way A is -inf."""
    rows = shape[0]
    cols = shape[1]
    limits = np.empty((rows, cols, 16, 4), np.float32)
    per_m = 1.0 / band_spacing_m
    for row in range(rows):
        for col in range(cols):
            for move in range(16):
                up = MOVES[move, 0]
                along = MOVES[move, 1]
                to_row = row + up
                to_col = col + along
                length = spacing_m * math.hypot(up, along)
                count = math.ceil(length * per_m)
                step = length / count
                lower = -np.inf
                upper = np.inf
                low_below = np.inf
                high_above = -np.inf
                if not (0 <= to_row < rows and 0 <= to_col < cols):
                    low_below = -np.inf
                    count = 0
                for i in range(1, count + 1):
                    share = i / count
                    floor, ceiling = read_limits(
                        surfaces,
                        (col + share * along) * spacing_m * per_m,
                        (row + share * up) * spacing_m * per_m,
                    )
                    # Backwards: a lower height climbs to the goal, a higher one sinks.
                    lower = max(lower - climb * step, floor)
                    upper = min(upper + sink * step, ceiling)
                    if lower > upper:
                        low_below = -np.inf
                        break
                    low_below = min(low_below, upper + climb * i * step)
                    high_above = max(high_above, lower - sink * i * step)
                limits[row, col, move, 0] = lower
                limits[row, col, move, 1] = upper
                limits[row, col, move, 2] = low_below
                limits[row, col, move, 3] = high_above
    return limits


@leaf
def _is_covered(
    counts: Int32Array, labels: Float32Array, row: int, col: int, low: float, high: float
) -> bool:
    """Return True if a label of a node serves about the same heights."""
    for k in range(counts[row, col]):
        if labels[row, col, k, 1] <= low + _SAME_HEIGHT_M and labels[row, col, k, 2] >= high - _SAME_HEIGHT_M:
            return True
    return False


@kernel
def fill_field(
    limits: Float32Array, spacing_m: float, climb: float, sink: float, seeds: FloatArray, most_m: float
) -> tuple[Int32Array, Float32Array]:
    """Return the number of labels of each node, and the labels, for lengths up to `most_m`.

    Labels (rows, cols, MAX_LABELS, 3): length, least and greatest height, the shortest first. `seeds` (n, 5):
    row, column, length, lowest, highest.
    """
    rows = limits.shape[0]
    cols = limits.shape[1]
    counts = np.zeros((rows, cols), np.int32)
    labels = np.empty((rows, cols, MAX_LABELS, 3), np.float32)
    width = _BUCKET_SHARE * spacing_m
    ring = 1024
    heads = np.full(ring, -1, np.int32)
    size = rows * cols * _MAX_ENTRIES_PER_NODE
    entries = np.empty((size, 3), np.float32)
    nodes = np.empty(size, np.int32)
    behind = np.empty(size, np.int32)
    used = 0
    live = 0
    bucket = 1 << 60
    for i in range(seeds.shape[0]):
        bucket = min(bucket, int(seeds[i, 2] / width))
    for i in range(seeds.shape[0]):
        # A seed beyond the ring of buckets is too far from the goal to begin a path.
        if int(seeds[i, 2] / width) < bucket + ring and used < size:
            slot = int(seeds[i, 2] / width) % ring
            nodes[used] = int(seeds[i, 0]) * cols + int(seeds[i, 1])
            for k in range(3):
                entries[used, k] = seeds[i, 2 + k]
            behind[used] = heads[slot]
            heads[slot] = used
            used += 1
            live += 1
    while live > 0 and bucket * width <= most_m:
        slot = bucket % ring
        entry = heads[slot]
        heads[slot] = -1
        while entry >= 0:
            live -= 1
            cost = entries[entry, 0]
            low = entries[entry, 1]
            high = entries[entry, 2]
            row = nodes[entry] // cols
            col = nodes[entry] - row * cols
            entry = behind[entry]
            count = counts[row, col]
            if count == MAX_LABELS or _is_covered(counts, labels, row, col, low, high):
                continue
            labels[row, col, count, 0] = cost
            labels[row, col, count, 1] = low
            labels[row, col, count, 2] = high
            counts[row, col] = count + 1
            for move in range(16):
                if low > limits[row, col, move, 2] or high < limits[row, col, move, 3]:
                    continue
                to_row = row + MOVES[move, 0]
                to_col = col + MOVES[move, 1]
                length = spacing_m * math.hypot(MOVES[move, 0], MOVES[move, 1])
                to_low = max(low - climb * length, limits[row, col, move, 0])
                to_high = min(high + sink * length, limits[row, col, move, 1])
                if counts[to_row, to_col] == MAX_LABELS or used == size:
                    continue
                if _is_covered(counts, labels, to_row, to_col, to_low, to_high):
                    continue
                far = int((cost + length) / width) % ring
                nodes[used] = to_row * cols + to_col
                entries[used, 0] = cost + length
                entries[used, 1] = to_low
                entries[used, 2] = to_high
                behind[used] = heads[far]
                heads[far] = used
                used += 1
                live += 1
        bucket += 1
    return counts, labels


@spliced
def field_length(
    counts: Int32Array, labels: Float32Array, stage: int, spacing_m: float, x: float, y: float, low: float,
    high: float, gradient: float,
) -> float:  # fmt: skip
    """Return the length in a field from a place in metres and a height in [low, high]; inf without a path.

    A height apart from those of a label costs the length of the climb (`gradient`) between them.
    """
    _, rows, cols = counts.shape
    u = min(max(x / spacing_m, 0.0), cols - 1.0)
    v = min(max(y / spacing_m, 0.0), rows - 1.0)
    col = min(int(u), cols - 2)
    row = min(int(v), rows - 2)
    u -= col
    v -= row
    total = 0.0
    weights = 0.0
    for corner in range(4):
        r = row + (corner >> 1)
        c = col + (corner & 1)
        weight = (u if corner & 1 else 1.0 - u) * (v if corner >> 1 else 1.0 - v)
        best = np.inf
        for k in range(counts[stage, r, c]):
            gap = max(labels[stage, r, c, k, 1] - high, low - labels[stage, r, c, k, 2], 0.0)
            best = min(best, labels[stage, r, c, k, 0] + max(gap - _CLOSE_HEIGHT_M, 0.0) / gradient)
        if best < np.inf:
            # Weights of the corners that have a path, never zero for the only one.
            total += (weight + 1e-9) * best
            weights += weight + 1e-9
    return total / weights if weights > 0.0 else np.inf


@kernel
def field_lengths(
    counts: Int32Array, labels: Float32Array, spacing_m: float, places: FloatArray, gradient: float
) -> FloatArray:
    """Return `field_length` in the first field of places (n, 4): x and y in metres, lowest and highest."""
    result = np.empty(places.shape[0])
    for i in range(places.shape[0]):
        result[i] = field_length(
            counts, labels, ZERO, spacing_m, places[i, 0], places[i, 1], places[i, 2], places[i, 3], gradient
        )
    return result
