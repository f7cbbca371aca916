"""Compiled merging of tracks that have become alike, so that hypotheses are spent on differences that matter.

Association histories multiply at every scan, but two that differ in one detection long ago soon say the same.
Tracks of one label whose means are close, by the covariance of the more probable one, become a single
Gaussian with the mixture's mean and covariance (Salmond 1990, joining); hypotheses that then hold equal
tracks become one, and their weights add. Existence and cardinality are left exactly as they were; only the
shape of a label's density is approximated.

Calls only kernels of this file: numba's cache does not see other files change.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from gcs.tracking.hypotheses import Groups

if TYPE_CHECKING:
    from gcs.model import FloatArray

njit = numba.njit(nogil=True, cache=True, error_model="numpy")


@njit
def _factor(cov: FloatArray, lower: FloatArray) -> None:
    """Cholesky factor of a (4, 4) covariance."""
    for i in range(4):
        for j in range(i + 1):
            total = cov[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(max(total, 1e-300)) if i == j else total / lower[j, j]


@njit
def _distance2(a: FloatArray, b: FloatArray, lower: FloatArray, whitened: FloatArray) -> float:
    """Squared Mahalanobis distance of a and b under the covariance that `lower` factors."""
    total = 0.0
    for i in range(4):
        value = a[i] - b[i]
        for k in range(i):
            value -= lower[i, k] * whitened[k]
        whitened[i] = value / lower[i, i]
        total += whitened[i] * whitened[i]
    return total


@njit
def _weights(groups: Groups, n_tracks: int) -> FloatArray:
    weight = np.zeros(n_tracks)
    for h in range(groups.logw.size):
        w = math.exp(groups.logw[h])
        for t in groups.items[groups.start[h] : groups.start[h + 1]]:
            weight[t] += w
    return weight


@njit
def _leaders(
    mean: FloatArray, cov: FloatArray, weight: FloatArray, track_label: Any, distance2: float
) -> Any:
    """For each track the one that stands for it: itself, or a more probable one of its label nearby."""
    n = track_label.size
    leader, lower = np.arange(n), np.zeros((n, 4, 4))
    whitened = np.empty(4)
    first = 0
    while first < n:
        end = first
        while end < n and track_label[end] == track_label[first]:
            end += 1
        order = np.argsort(-weight[first:end], kind="mergesort")
        leading = np.empty(end - first, np.int64)
        count = 0
        for k in order:
            t = first + k
            for i in range(count):
                if _distance2(mean[t], mean[leading[i]], lower[leading[i]], whitened) < distance2:
                    leader[t] = leading[i]
                    break
            if leader[t] == t:
                leading[count] = t
                count += 1
                _factor(cov[t], lower[t])
        first = end
    return leader


@njit
def _join_moments(mean: FloatArray, cov: FloatArray, weight: FloatArray, leader: Any) -> None:
    """Give each leader the mean and covariance of the mixture that it stands for, in place."""
    n = leader.size
    total, centre = np.zeros(n), np.zeros((n, 4))
    for t in range(n):
        total[leader[t]] += weight[t]
        centre[leader[t]] += weight[t] * mean[t]
    joined = np.zeros(n, np.bool_)
    for t in range(n):
        if leader[t] != t:
            joined[leader[t]] = True
    spread = np.zeros((n, 4, 4))
    for t in range(n):
        at = leader[t]
        if joined[at]:
            share = weight[t] / total[at]
            for i in range(4):
                for j in range(4):
                    spread[at, i, j] += share * (
                        cov[t, i, j]
                        + (mean[t, i] - centre[at, i] / total[at]) * (mean[t, j] - centre[at, j] / total[at])
                    )
    for t in range(n):
        if joined[t]:
            mean[t] = centre[t] / total[t]
            cov[t] = spread[t]


@njit
def merge_alike(
    groups: Groups, mean: FloatArray, cov: FloatArray, track_label: Any, keys: Any, distance2: float
) -> Groups:
    """Merge tracks of one label within squared Mahalanobis `distance2`; `mean` and `cov` change in place.

    `track_label` must ascend. Tracks that were merged into others are in no hypothesis of the result.
    """
    weight = _weights(groups, track_label.size)
    leader = _leaders(mean, cov, weight, track_label, distance2)
    _join_moments(mean, cov, weight, leader)
    first, start = np.zeros_like(groups.first), np.zeros_like(groups.start)
    items, logw = np.empty_like(groups.items), np.empty_like(groups.logw)
    h_out = 0
    for g in range(groups.first.size - 1):
        low, n = groups.first[g], groups.first[g + 1] - groups.first[g]
        key = np.zeros(n, np.uint64)
        for h in range(n):
            for i in range(groups.start[low + h], groups.start[low + h + 1]):
                key[h] += keys[leader[groups.items[i]]]
        by_key = np.argsort(key, kind="mergesort")
        total, example, count = np.empty(n), np.empty(n, np.int64), 0
        for k in range(n):
            h = by_key[k]
            if k == 0 or key[h] != key[by_key[k - 1]]:
                total[count], example[count] = 0.0, low + h
                count += 1
            total[count - 1] += math.exp(groups.logw[low + h])
        for k in np.argsort(-total[:count], kind="mergesort"):
            logw[h_out] = math.log(total[k])
            size = start[h_out]
            for i in range(groups.start[example[k]], groups.start[example[k] + 1]):
                items[size] = leader[groups.items[i]]
                size += 1
            h_out += 1
            start[h_out] = size
        first[g + 1] = h_out
    return Groups(first, start[: h_out + 1].copy(), items[: start[h_out]].copy(), logw[:h_out].copy())
