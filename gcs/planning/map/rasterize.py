"""Polygon rasterisation: the cells that edges pass through, and the cells whose centre is inside.

A polygon has one or more rings, filled by the even-odd rule: a ring within a ring is a hole. Each edge adds
differences along its rows, and a cumulative sum fills them. The work grows with the rows that edges cross,
not with the area.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from gcs.model import FloatArray, Int32Array

_TOUCH = 1e-9
"""In cells: an edge that enters a cell by less only touches it."""


def cover(
    shape: tuple[int, int], rings: Iterable[Sequence[Sequence[float]]] | Iterable[FloatArray]
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Return the cells that an edge passes through, and those with their centre inside: both (rows, cols).

    `rings` are vertices (x, y) in cells; cell (row, col) is the unit square around (col, row). Rings are
    closed automatically.
    """
    steps, crossings = (np.zeros((shape[0], shape[1] + 1), dtype=np.int32) for _ in range(2))
    for ring in rings:
        corners = np.asarray(ring, dtype=np.float64).reshape(-1, 2)
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            _follow(steps, x0, y0, x1, y1)
            _cross(crossings, x0, y0, x1, y1)
    passed = np.cumsum(steps, axis=1)[:, :-1] > 0
    return passed, np.cumsum(crossings, axis=1)[:, :-1] % 2 == 1


def _follow(steps: Int32Array, x0: float, y0: float, x1: float, y1: float) -> None:
    """Mark the cells that an edge enters."""
    last_col = steps.shape[1] - 1
    rows = _rows(min(y0, y1) - 0.5 + _TOUCH, max(y0, y1) + 0.5 - _TOUCH, steps.shape[0])
    if y0 == y1:
        left = np.full(len(rows), min(x0, x1))
        right = np.full(len(rows), max(x0, x1))
    else:
        low, high = (np.clip(rows + half, min(y0, y1), max(y0, y1)) for half in (-0.5, 0.5))
        ends = x0 + (np.stack((low, high)) - y0) * ((x1 - x0) / (y1 - y0))
        left = ends.min(axis=0)
        right = ends.max(axis=0)
    first = np.ceil(np.clip(left - 0.5 + _TOUCH, 0, last_col)).astype(np.int64)
    behind = np.floor(np.clip(right + 0.5 - _TOUCH, -1, last_col - 1)).astype(np.int64) + 1
    some = first < behind
    steps[rows[some], first[some]] += 1
    steps[rows[some], behind[some]] -= 1


def _cross(crossings: Int32Array, x0: float, y0: float, x1: float, y1: float) -> None:
    """Mark the cells whose centre lies east of the edge in its row."""
    if y0 != y1:
        rows = _rows(min(y0, y1), max(y0, y1), crossings.shape[0])
        rows = rows[rows < max(y0, y1)]
        at = np.clip(x0 + (rows - y0) * ((x1 - x0) / (y1 - y0)), 0, crossings.shape[1] - 1)
        crossings[rows, np.ceil(at).astype(np.int64)] += 1


def _rows(low: float, high: float, size: int) -> npt.NDArray[np.int64]:
    """Return the rows from `low` to `high`, both included, within the map."""
    return np.arange(np.ceil(max(low, 0.0)), np.floor(min(high, size - 1.0)) + 1.0).astype(np.int64)
