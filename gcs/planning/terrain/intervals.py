"""Heights that can be reached along a path: an interval at each place.

A vehicle at a height in [low, high] can have any height in

    [max(low - s d, floor), min(high + c d, ceiling)]

a distance d farther on, where s and c are the sink and the climb gradient. The interval is exact: each of its
heights is reached by a profile inside the band. If it is empty, no profile is. So a search over places and
courses with an interval as label is a search in three dimensions.

A vehicle outside the band enters it first: from below with the full climb, no deeper under the floor than
`FlightBand.entry_depth_m`; from above with the full descent. Until then its interval is one height.

`INSIDE`, `BELOW` and `ABOVE` say which. The plain form of a step is `advance`; kernels inline it.
"""

from __future__ import annotations

from gcs.jit import inlined, spliced
from gcs.model import Float32Array
from gcs.planning.terrain.band import read_limits

INSIDE = 0.0
BELOW = -1.0
ABOVE = 1.0
"""Entry state of an interval, as floats: they are kept in arrays with the heights."""


@inlined
def advance(
    low: float, high: float, entry: float, floor: float, ceiling: float, climb_m: float, sink_m: float,
    depth_m: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return interval and entry state after a step; empty (low above high) if no height is allowed.

    `climb_m` and `sink_m`: greatest height gained and lost in the step. `floor`, `ceiling`: at its end.
    `depth_m`: `FlightBand.entry_depth_m`.
    """
    low = low - sink_m
    high = high + climb_m
    if entry < 0.0 and high < floor:
        low = high if high >= floor - depth_m else high + 1.0
    elif entry > 0.0 and low > ceiling:
        high = low if ceiling >= floor else low - 1.0
    else:
        entry = 0.0
        low = max(low, floor)
        high = min(high, ceiling)
    return low, high, entry


@inlined
def begin(
    low: float, high: float, floor: float, ceiling: float, depth_m: float
) -> tuple[float, float, float]:
    """Return interval and entry state at the start of a path."""
    entry = 0.0
    if high < floor:
        entry = -1.0
        low = high if high >= floor - depth_m else high + 1.0
    elif low > ceiling:
        entry = 1.0
        high = low if ceiling >= floor else low - 1.0
    else:
        low = max(low, floor)
        high = min(high, ceiling)
    return low, high, entry


@spliced
def advance_to(
    surfaces: Float32Array, per_m: float, x: float, y: float, low: float, high: float, entry: float,
    climb_m: float, sink_m: float, depth_m: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return interval and entry state after a step to a place in metres; `per_m`: 1 / spacing."""
    floor, ceiling = read_limits(surfaces, x * per_m, y * per_m)
    return advance(low, high, entry, floor, ceiling, climb_m, sink_m, depth_m)
