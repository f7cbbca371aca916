"""Points of a route, as the rows (x, y) of an array, in cells."""

from __future__ import annotations

from gcs.jit import inlined, spliced
from gcs.model import FloatArray


@inlined
def leg_vector(points: FloatArray, i: int) -> tuple[float, float]:
    """Return leg i, from its begin to its end."""
    return points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]


@spliced
def set_point(points: FloatArray, i: int, x: float, y: float) -> None:
    """Set point i."""
    points[i, 0] = x
    points[i, 1] = y


@spliced
def copy_point(source: FloatArray, i: int, points: FloatArray, k: int) -> None:
    """Set point k to point i of another route, or of the same."""
    points[k, 0] = source[i, 0]
    points[k, 1] = source[i, 1]
