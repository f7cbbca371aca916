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

from gcs.compiling import inlined, kernel
from gcs.tracking.hypotheses import Groups
from gcs.tracking.ordering import distinct, greatest_first, head

if TYPE_CHECKING:
    from gcs.model import FloatArray


@inlined
def factor(cov: FloatArray, t: int, lower: FloatArray, at: int) -> None:
    """Put the Cholesky factor of covariance t at place `at`; `cov` and `lower` (n, 4, 4)."""
    for i in range(4):
        for j in range(i + 1):
            total = cov[t, i, j]
            for k in range(j):
                total -= lower[at, i, k] * lower[at, j, k]
            lower[at, i, j] = math.sqrt(max(total, 1e-300)) if i == j else total / lower[at, j, j]


@inlined
def distance2_to(
    mean: FloatArray, a: int, centre: FloatArray, lower: FloatArray, b: int, whitened: FloatArray
) -> float:
    """Squared Mahalanobis distance of the mean a from the centre b under the covariance that `lower` factors.

    `whitened` (4,) is scratch.
    """
    total = 0.0
    for i in range(4):
        value = mean[a, i] - centre[b, i]
        for k in range(i):
            value -= lower[b, i, k] * whitened[k]
        whitened[i] = value / lower[b, i, i]
        total += whitened[i] * whitened[i]
    return total


@inlined
def _weights(groups: Groups, n_tracks: int) -> FloatArray:
    start, items = groups.start, groups.items
    weight = np.zeros(n_tracks)
    for h in range(groups.logw.size):
        w = math.exp(groups.logw[h])
        for i in range(start[h], start[h + 1]):
            weight[items[i]] += w
    return weight


@inlined
def _leaders(
    mean: FloatArray, cov: FloatArray, weight: FloatArray, track_label: Any, distance2: float
) -> Any:
    """For each track the one that stands for it: itself, or a more probable one of its label nearby."""
    n = track_label.size
    leader, leading = np.empty(n, np.int64), np.empty(n, np.int64)
    lower, whitened = np.empty((n, 4, 4)), np.empty(4)
    first = 0
    while first < n:
        end = first
        while end < n and track_label[end] == track_label[first]:
            end += 1
        count = 0
        if end == first + 1:
            leader[first], first = first, end
            continue
        for t in greatest_first(weight, first, end):
            leader[t] = t
            for i in range(count):
                if distance2_to(mean, t, mean, lower, leading[i], whitened) < distance2:
                    leader[t] = leading[i]
                    break
            if leader[t] == t:
                leading[count] = t
                count += 1
                factor(cov, t, lower, t)
        first = end
    return leader


@inlined
def _join_moments(mean: FloatArray, cov: FloatArray, weight: FloatArray, leader: Any) -> None:
    """Give each leader the mean and covariance of the mixture that it stands for, in place."""
    n = leader.size
    # Which of the mixtures each leader stands for, -1 for those that stand for themselves alone.
    mixture, count = np.empty(n, np.int64), 0
    mixture[:] = -1
    for t in range(n):
        if leader[t] != t and mixture[leader[t]] < 0:
            mixture[leader[t]] = count
            count += 1
    total, centre, spread = np.zeros(count), np.zeros((count, 4)), np.zeros((count, 4, 4))
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


@kernel
def merge_alike(
    groups: Groups, mean: FloatArray, cov: FloatArray, track_label: Any, keys: Any, distance2: float
) -> Groups:
    """Merge tracks of one label within squared Mahalanobis `distance2`; `mean` and `cov` change in place.

    Tracks of a label stand together. Those that were merged into others are in no hypothesis of the result.
    """
    first, start, items = groups.first, groups.start, groups.items
    weight = _weights(groups, track_label.size)
    leader = _leaders(mean, cov, weight, track_label, distance2)
    _join_moments(mean, cov, weight, leader)
    out_first, out_start = np.zeros(first.size, np.int64), np.zeros(start.size, np.int64)
    out_items, out_logw = np.empty(items.size, np.int64), np.empty(groups.logw.size)
    n = 0
    for g in range(first.size - 1):
        changed = False
        for i in range(start[first[g]], start[first[g + 1]]):
            changed |= leader[items[i]] != items[i]
        if not changed:
            for h in range(first[g], first[g + 1]):
                out_logw[n], size = groups.logw[h], out_start[n]
                for i in range(start[h], start[h + 1]):
                    out_items[size] = items[i]
                    size += 1
                n += 1
                out_start[n] = size
            out_first[g + 1] = n
            continue
        key = np.empty(first[g + 1] - first[g], np.uint64)
        for h in range(first[g], first[g + 1]):
            key[h - first[g]] = 0
            for i in range(start[h], start[h + 1]):
                key[h - first[g]] += keys[leader[items[i]]]
        which, total = distinct(key, groups.logw, first[g])
        for k in range(which.size):
            out_logw[n] = total[k]
            size = out_start[n]
            for i in range(start[which[k]], start[which[k] + 1]):
                out_items[size] = leader[items[i]]
                size += 1
            n += 1
            out_start[n] = size
        out_first[g + 1] = n
    return Groups(out_first, head(out_start, n + 1), head(out_items, out_start[n]), head(out_logw, n))
