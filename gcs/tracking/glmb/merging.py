"""Compiled merging of tracks that have become alike, so that hypotheses are spent on differences that matter.

Association histories multiply at every scan, but two that differ in one detection long ago soon say the same.
Tracks of one label whose means are close, by the covariance of the more probable one, become a single
Gaussian with the mixture's mean and covariance (Salmond 1990, joining); hypotheses that then hold equal
tracks become one, and their weights add. Existence and cardinality are left exactly as they were; only the
shape of a label's density is approximated.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf
from gcs.tracking.glmb.hypotheses import Clusters, key_of
from gcs.tracking.numerics.fast_math import exponentials
from gcs.tracking.numerics.sorting import (
    Distinct,
    Order,
    distinct,
    greatest_first,
    head,
    room_for_distinct,
    room_to_order,
)

if TYPE_CHECKING:
    from gcs.model import FloatArray


@inlined
def factor(cov: FloatArray, t: int, lower: FloatArray, at: int) -> None:
    """Put the Cholesky factor of covariance t at place `at`; `cov` and `lower` (n, 4, 4).

    Element by element: loops over so small a matrix take several times as long.
    """
    l00 = math.sqrt(max(cov[t, 0, 0], 1e-300))
    l10, l20, l30 = cov[t, 1, 0] / l00, cov[t, 2, 0] / l00, cov[t, 3, 0] / l00
    l11 = math.sqrt(max(cov[t, 1, 1] - l10 * l10, 1e-300))
    l21, l31 = (cov[t, 2, 1] - l20 * l10) / l11, (cov[t, 3, 1] - l30 * l10) / l11
    l22 = math.sqrt(max(cov[t, 2, 2] - l20 * l20 - l21 * l21, 1e-300))
    l32 = (cov[t, 3, 2] - l30 * l20 - l31 * l21) / l22
    l33 = math.sqrt(max(cov[t, 3, 3] - l30 * l30 - l31 * l31 - l32 * l32, 1e-300))
    lower[at, 0, 0] = l00
    lower[at, 1, 0], lower[at, 1, 1] = l10, l11
    lower[at, 2, 0], lower[at, 2, 1], lower[at, 2, 2] = l20, l21, l22
    lower[at, 3, 0], lower[at, 3, 1], lower[at, 3, 2], lower[at, 3, 3] = l30, l31, l32, l33


@inlined
def near(
    mean: FloatArray, a: int, centre: FloatArray, b: int, lower: FloatArray, f: int, distance2: float
) -> bool:
    """Whether mean a is nearer to the centre b than `distance2` (Mahalanobis, squared; see `factor`)."""
    w0 = (mean[a, 0] - centre[b, 0]) / lower[f, 0, 0]
    total = w0 * w0
    if total >= distance2:
        return False
    w1 = (mean[a, 1] - centre[b, 1] - lower[f, 1, 0] * w0) / lower[f, 1, 1]
    total += w1 * w1
    if total >= distance2:
        return False
    w2 = (mean[a, 2] - centre[b, 2] - lower[f, 2, 0] * w0 - lower[f, 2, 1] * w1) / lower[f, 2, 2]
    total += w2 * w2
    w3 = mean[a, 3] - centre[b, 3] - lower[f, 3, 0] * w0 - lower[f, 3, 1] * w1 - lower[f, 3, 2] * w2
    w3 /= lower[f, 3, 3]
    return bool(total + w3 * w3 < distance2)


@inlined
def far(
    mean: FloatArray, a: int, centre: FloatArray, b: int, cov: FloatArray, t: int, distance2: float
) -> bool:
    """Whether mean a is beyond `distance2` of the centre b along one of the axes, under covariance t.

    Then it is not `near`, and nothing need be factored to know it.
    """
    for i in range(4):
        off = mean[a, i] - centre[b, i]
        if off * off > 1.001 * distance2 * cov[t, i, i]:
            return True
    return False


@leaf
def _leaders(
    groups: Clusters,
    mean: FloatArray,
    cov: FloatArray,
    track_label: Any,
    distance2: float,
    chance: FloatArray,
    weight: FloatArray,
    lower: FloatArray,
    factored: Any,
    order: Order,
    leader: Any,
    leading: Any,
) -> None:
    """Fill `leader`: what stands for each track, itself or a more probable one of its label nearby.

    And `chance` (hypotheses,) and `weight` (tracks,), 0 before, with their probabilities; the others are
    scratch.
    """
    exponentials(groups.logw, chance)
    for h in range(groups.logw.size):
        w = chance[h]
        for i in range(groups.start[h], groups.start[h + 1]):
            weight[groups.items[i]] += w
    n, first = track_label.size, ZERO
    while first < n:
        end = first
        while end < n and track_label[end] == track_label[first]:
            end += 1
        count = 0
        if end == first + 1:
            leader[first], first = first, end
            continue
        greatest_first(weight, first, end, order)
        for k in range(end - first):
            t = order.index[k]
            leader[t], factored[t] = t, False
            for i in range(count):
                d = leading[i]
                if not factored[d]:
                    if far(mean, t, mean, d, cov, d, distance2):
                        continue
                    factor(cov, d, lower, d)
                    factored[d] = True
                if near(mean, t, mean, d, lower, d, distance2):
                    leader[t] = d
                    break
            if leader[t] == t:
                leading[count] = t
                count += 1
        first = end


@leaf
def _mixtures(leader: Any, mixture: Any) -> int:
    """Number the leaders of others in `mixture` (tracks,), -1 for those that stand for themselves alone."""
    count = 0
    mixture[:] = -1
    for t in range(leader.size):
        if leader[t] != t and mixture[leader[t]] < 0:
            mixture[leader[t]] = count
            count += 1
    return count


@leaf
def _join_moments(
    mean: FloatArray,
    cov: FloatArray,
    weight: FloatArray,
    leader: Any,
    mixture: Any,
    total: FloatArray,
    centre: FloatArray,
    spread: FloatArray,
) -> None:
    """Give each leader the mean and covariance of the mixture that it stands for, in place.

    `total`, `centre` and `spread` are 0: sums for each mixture.
    """
    n = leader.size
    for t in range(n):
        at = mixture[leader[t]]
        if at < 0:
            continue
        total[at] += weight[t]
        for i in range(4):
            centre[at, i] += weight[t] * mean[t, i]
    for t in range(n):
        at = mixture[leader[t]]
        if at >= 0:
            share = weight[t] / total[at]
            for i in range(4):
                off = mean[t, i] - centre[at, i] / total[at]
                for j in range(4):
                    spread[at, i, j] += share * (
                        cov[t, i, j] + off * (mean[t, j] - centre[at, j] / total[at])
                    )
    for t in range(n):
        at = mixture[t]
        if at >= 0:
            for i in range(4):
                mean[t, i] = centre[at, i] / total[at]
                for j in range(4):
                    cov[t, i, j] = spread[at, i, j]


@leaf
def _broadest(groups: Clusters) -> int:
    """Most hypotheses of a group."""
    most = 0
    for g in range(groups.first.size - 1):
        most = max(most, groups.first[g + 1] - groups.first[g])
    return most


@leaf
def _renamed(groups: Clusters, chance: FloatArray, leader: Any, same: Distinct, out: Clusters) -> None:
    """Let leaders take the places of those for whom they stand; hypotheses that are then equal become one."""
    first, start, items = groups.first, groups.start, groups.items
    n = 0
    out.first[0] = out.start[0] = 0
    for g in range(first.size - 1):
        changed = False
        for i in range(start[first[g]], start[first[g + 1]]):
            changed |= leader[items[i]] != items[i]
        count = first[g + 1] - first[g]
        if changed:
            for h in range(first[g], first[g + 1]):
                key = np.uint64(0)
                for i in range(start[h], start[h + 1]):
                    key += key_of(leader[items[i]])
                same.key[h - first[g]] = key
            count = distinct(count, chance, first[g], same)
        for k in range(count):
            h = same.which[k] if changed else first[g] + k
            out.logw[n], size = same.logw[k] if changed else groups.logw[h], out.start[n]
            for i in range(start[h], start[h + 1]):
                out.items[size] = leader[items[i]]
                size += 1
            n += 1
            out.start[n] = size
        out.first[g + 1] = n


@kernel
def merge_alike(
    groups: Clusters, mean: FloatArray, cov: FloatArray, track_label: Any, distance2: float
) -> Clusters:
    """Merge tracks of one label within squared Mahalanobis `distance2`; `mean` and `cov` change in place.

    Tracks of a label stand together. Those that were merged into others are in no hypothesis of the result.
    """
    n = track_label.size
    chance, weight = np.empty(groups.logw.size), np.zeros(n)
    leader, mixture = np.empty(n, np.int64), np.empty(n, np.int64)
    lower, factored = np.empty((n, 4, 4)), np.empty(n, np.bool_)
    order = room_to_order(n)
    _leaders(
        groups, mean, cov, track_label, distance2, chance, weight, lower, factored, order, leader, mixture
    )
    count = _mixtures(leader, mixture)
    total, centre, spread = np.zeros(count), np.zeros((count, 4)), np.zeros((count, 4, 4))
    _join_moments(mean, cov, weight, leader, mixture, total, centre, spread)
    out = Clusters(
        np.empty(groups.first.size, np.int64),
        np.empty(groups.start.size, np.int64),
        np.empty(groups.items.size, np.int64),
        np.empty(groups.logw.size),
    )
    _renamed(groups, chance, leader, room_for_distinct(_broadest(groups)), out)
    n = out.first[out.first.size - 1]
    return Clusters(out.first, head(out.start, n + 1), head(out.items, out.start[n]), head(out.logw, n))
