"""Metrics of estimates against ground truth: OSPA, OSPA(2), GOSPA, cardinality error, identity switches.

- OSPA (Schuhmacher, Vo & Vo, IEEE TSP 56, 2008): for m <= n points, the distances of the best pairing, cut
  off at c, and c for each of the n - m unpaired points, averaged in the order p:
  ``((min sum min(d, c)^p + c^p (n - m)) / n)^(1/p)``.
- OSPA(2) (Beard, Vo & Vo, IEEE TSP 68, 2020): OSPA between sets of tracks over a time window. The distance of
  two tracks is the mean, over the times at which either exists, of min(d, c), and of c where one exists. It
  sees swapped and broken labels, which OSPA does not.
- GOSPA (Rahmathullah, Garcia-Fernandez & Svensson, 2017), alpha = 2: not averaged. A missed or false object
  costs c^p / 2: ``(min over partial pairings of sum d^p + c^p / 2 (missed + false))^(1/p)``.
- Cardinality error: mean over time of the absolute error of the number of objects.
- Identity switches (Bernardin & Stiefelhagen, "CLEAR MOT", 2008): number of times that a true object changes
  its label. A pair lasts while it is within c. Others are paired by distance.

Points are (n, 2) arrays of east and north in metres, or (n, 3) with heights. Results are in metres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from gcs.model import FloatArray, IntArray

LabelT = TypeVar("LabelT")
IdT = TypeVar("IdT")
Tracks: TypeAlias = Mapping[LabelT, FloatArray]
"""Position (2,), or (3,), by label at one time."""


@dataclass(frozen=True, slots=True)
class Ospa:
    """OSPA and its parts: ``total_m**p == localisation_m**p + cardinality_m**p``."""

    total_m: float
    localisation_m: float
    cardinality_m: float


@dataclass(frozen=True, slots=True)
class Gospa:
    """GOSPA and its parts: ``total_m**p == localisation_m**p + c**p / 2 * (missed + false)``."""

    total_m: float
    localisation_m: float
    missed: int
    false: int


def _distances(x_m: FloatArray, y_m: FloatArray) -> FloatArray:
    x, y = (_points(positions) for positions in (x_m, y_m))
    if not len(x) or not len(y):
        return np.empty((len(x), len(y)))
    if x.shape[1] != y.shape[1]:
        raise ValueError(f"expected points of the same dimension, got {x.shape} and {y.shape}")
    return np.asarray(np.sqrt(((x[:, None] - y) ** 2).sum(axis=-1)))


def _points(positions_m: ArrayLike) -> FloatArray:
    """Return points as (n, 2) or (n, 3); (0, 2) for none."""
    points = np.asarray(positions_m, np.float64)
    if not points.size:
        return np.empty((0, 2))
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"expected points (n, 2) or (n, 3) in metres, got {points.shape}")
    return points


def _check_order(c_m: float, p: float) -> None:
    if not (c_m > 0.0 and p >= 1.0):
        raise ValueError(f"expected c_m above 0 and p of at least 1, got {c_m!r} and {p!r}")


def _check_times(x_m: Sequence[Tracks[LabelT]], y_m: Sequence[Tracks[IdT]]) -> None:
    if len(x_m) != len(y_m):
        raise ValueError(f"expected as many times of both, got {len(x_m)} and {len(y_m)}")
    for scan in (*x_m, *y_m):
        if not isinstance(scan, Mapping):
            raise ValueError(
                f"expected positions by label at each time, {{label: (2,)}}; got {type(scan).__name__}"
            )


def _optimal_assignment(cost: FloatArray) -> tuple[IntArray, IntArray]:
    """Return rows and columns of the cheapest assignment."""
    # Half of the start-up time of a program that tracks without ground truth.
    from scipy.optimize import linear_sum_assignment

    rows, cols = linear_sum_assignment(cost)
    return rows, cols


def _assignment_cost(cost: FloatArray) -> float:
    rows, cols = _optimal_assignment(cost)
    return float(cost[rows, cols].sum())


def _ospa_from_distances(distances: FloatArray, c_m: float, p: float) -> Ospa:
    """Return OSPA from distances (m, n) already cut off at `c_m`."""
    fewer = min(distances.shape)
    more = max(distances.shape)
    if more == 0:
        return Ospa(0.0, 0.0, 0.0)
    local = _assignment_cost(distances**p) if fewer else 0.0
    extra = c_m**p * (more - fewer)
    return Ospa(*(float((part / more) ** (1.0 / p)) for part in (local + extra, local, extra)))


def ospa(x_m: FloatArray, y_m: FloatArray, c_m: float = 100.0, p: float = 1.0) -> Ospa:
    """Return OSPA of two sets of points, with cut-off `c_m` > 0 and order `p` >= 1."""
    _check_order(c_m, p)
    return _ospa_from_distances(np.minimum(_distances(x_m, y_m), c_m), c_m, p)


def ospa2(
    x_m: Sequence[Tracks[LabelT]], y_m: Sequence[Tracks[IdT]], c_m: float = 100.0, p: float = 1.0
) -> Ospa:
    """Return OSPA(2) of two sets of tracks over a window; element k is what exists at time k."""
    _check_order(c_m, p)
    _check_times(x_m, y_m)
    size = max((len(point) for scans in (x_m, y_m) for scan in scans for point in scan.values()), default=2)
    x = _stack_tracks(x_m, size)
    y = _stack_tracks(y_m, size)
    gap = np.sqrt(((x[:, None] - y[None, :]) ** 2).sum(axis=-1))
    here_x = ~np.isnan(x[:, None, :, 0])
    here_y = ~np.isnan(y[None, :, :, 0])
    cut = np.where(here_x & here_y, np.minimum(gap, c_m), np.where(here_x | here_y, c_m, 0.0))
    either = np.maximum((here_x | here_y).sum(axis=-1), 1)
    return _ospa_from_distances(cut.sum(axis=-1) / either, c_m, p)


def _stack_tracks(scans: Sequence[Tracks[LabelT]], size: int) -> FloatArray:
    """Return positions (labels, times, size), NaN where a label does not exist."""
    row = {label: i for i, label in enumerate(dict.fromkeys(label for scan in scans for label in scan))}
    stacked = np.full((len(row), len(scans), size), np.nan)
    for k, scan in enumerate(scans):
        for label, position in scan.items():
            stacked[row[label], k] = position
    return stacked


def gospa(x_m: FloatArray, y_m: FloatArray, c_m: float = 50.0, p: float = 2.0) -> Gospa:
    """Return GOSPA (alpha = 2) of an estimate `x_m` against the truth `y_m`."""
    _check_order(c_m, p)
    distances = _distances(x_m, y_m)
    cost = np.minimum(distances, c_m) ** p
    rows, cols = _optimal_assignment(cost)
    is_localised = distances[rows, cols] < c_m
    local = float(cost[rows, cols][is_localised].sum())
    pairs = int(is_localised.sum())
    missed = distances.shape[1] - pairs
    false = distances.shape[0] - pairs
    total = local + c_m**p / 2.0 * (missed + false)
    return Gospa(float(total ** (1.0 / p)), float(local ** (1.0 / p)), missed, false)


def cardinality_error(found_m: Sequence[Tracks[LabelT]], true_m: Sequence[Tracks[IdT]]) -> float:
    """Return the mean over time of | estimated number - true number |; 0 without any time."""
    _check_times(found_m, true_m)
    errors = [abs(len(found) - len(true)) for found, true in zip(found_m, true_m, strict=True)]
    return sum(errors) / max(1, len(errors))


def identity_switches(
    found_m: Sequence[Tracks[LabelT]], true_m: Sequence[Tracks[IdT]], c_m: float = 50.0
) -> int:
    """Count the label changes of true objects, paired within `c_m`."""
    _check_times(found_m, true_m)
    shown_by: dict[IdT, LabelT] = {}
    last: dict[IdT, LabelT] = {}
    switches = 0
    for found, true in zip(found_m, true_m, strict=True):
        pairs = {
            id_: label
            for id_, label in shown_by.items()
            if id_ in true and label in found and _distance(true[id_], found[label]) < c_m
        }
        ids = [id_ for id_ in true if id_ not in pairs]
        kept = set(pairs.values())
        labels = [label for label in found if label not in kept]
        gaps = _distances(_points([true[id_] for id_ in ids]), _points([found[n] for n in labels]))
        for i, j in zip(*_optimal_assignment(np.minimum(gaps, c_m)), strict=True):
            if gaps[i, j] < c_m:
                pairs[ids[i]] = labels[j]
                switches += last.get(ids[i], labels[j]) != labels[j]
        last.update(pairs)
        shown_by = pairs
    return switches


def _distance(a_m: FloatArray, b_m: FloatArray) -> float:
    return float(np.sqrt(((a_m - b_m) ** 2).sum()))
