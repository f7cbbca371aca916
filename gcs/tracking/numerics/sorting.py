"""Sorting of log-weights and merging of equal hypotheses, for the tracking kernels.

These functions are compiled into kernels of other files (see `gcs.jit` about their caches).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from gcs.jit import ZERO, called, inlined, int64, leaf, spliced
from gcs.model import FloatArray, IntArray, KeyArray

ArrayT = TypeVar("ArrayT", bound=npt.NDArray[Any])

_MAX_INSERTION = 8


@called
def head(array: ArrayT, n: int) -> ArrayT:
    """Return the first n elements."""
    return array[:n]  # type: ignore[return-value]


class SortBuffers(NamedTuple):
    """Buffers to sort n values, int64.

    ======  =======  ============================
    index   (n,)     sorted indices, the result
    other   (n,)     scratch
    begin   (n + 1,) scratch
    ======  =======  ============================
    """

    index: IntArray  # type: ignore[assignment]  # tuple.index
    other: IntArray
    begin: IntArray


@inlined
def allocate_sort(n: int) -> SortBuffers:
    """Allocate buffers for n values."""
    return SortBuffers(np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n + 1, np.int64))


@inlined
def _insertion_sort(value: FloatArray | IntArray, n: int, order: IntArray) -> None:
    """Sort n indices by insertion: fast if all are near their places."""
    for i in range(1, n):
        x = order[i]
        j = i
        while j > 0 and value[order[j - 1]] < value[x]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = x


@leaf
def _merge_sort(value: FloatArray | IntArray, n: int, to: SortBuffers) -> None:
    """Sort n indices by merging runs."""
    order = to.index
    merged = to.other
    run = 1
    while run < n:
        for low in range(0, n, 2 * run):
            mid = min(low + run, n)
            high = min(low + 2 * run, n)
            if mid == high or not value[order[mid - 1]] < value[order[mid]]:
                # Already in order.
                for k in range(low, high):
                    merged[k] = order[k]
                continue
            i = low
            j = mid
            for k in range(low, high):
                if j == high or (i < mid and not value[order[i]] < value[order[j]]):
                    merged[k] = order[i]
                    i += 1
                else:
                    merged[k] = order[j]
                    j += 1
        for k in range(n):
            order[k] = merged[k]
        run *= 2


@inlined
def _bucket_sort(
    value: FloatArray | IntArray, first: int, n: int, least: float, most: float, to: SortBuffers
) -> bool:
    """Distribute n indices over even steps from the greatest value to the least.

    Returns True if no step has more than a few values.
    """
    begin = to.begin
    step = to.other
    per_unit = (n - 0.5) / (most - least)
    for b in range(n + 1):
        begin[b] = 0
    for i in range(n):
        step[i] = min(max(int((most - value[first + i]) * per_unit), 0), n - 1)
        begin[step[i] + 1] += 1
    crowded = False
    for b in range(n):
        crowded |= begin[b + 1] > _MAX_INSERTION
        begin[b + 1] += begin[b]
    for i in range(n):
        to.index[begin[step[i]]] = first + i
        begin[step[i]] += 1
    return not crowded


@leaf
def _argsort_many(value: FloatArray | IntArray, first: int, n: int, to: SortBuffers) -> None:
    """Sort n indices from `first` on."""
    least = most = value[first]
    for i in range(n):
        to.index[i] = first + i
        least = min(least, value[first + i])
        most = max(most, value[first + i])
    if 0.0 < most - least < np.inf and _bucket_sort(value, first, n, least, most, to):
        _insertion_sort(value, n, to.index)
    else:
        _merge_sort(value, n, to)


@spliced
def argsort_descending(value: FloatArray | IntArray, first: int, end: int, to: SortBuffers) -> None:
    """Sort the indices `first` to `end` - 1 by value: greatest first, stable.

    Few values are sorted by insertion. More are first distributed over even steps, which leaves little to do
    for log-weights: a tenth of the time of a merge sort of 300.
    """
    n = end - first
    if n > _MAX_INSERTION:
        _argsort_many(value, first, n, to)
    else:
        for i in range(n):
            to.index[i] = first + i
        _insertion_sort(value, n, to.index)


@inlined
def power_of_two(n: int) -> int:
    """Return the least power of two, 4 or more, that is not below n."""
    size = 4
    while size < n:
        size *= 2
    return size


class UniqueBuffers(NamedTuple):
    """Buffers to merge n equal hypotheses.

    =======  ===============  =======  ======================================================
    key      (n,)             uint64   key of each hypothesis
    slot     (power of two,)  int64    hash table (open addressing): row found, or -1
    order    SortBuffers               scratch
    weight   (n,)             float64  weight of each distinct key
    example  (n,)             int64    a hypothesis with that key
    which    (n,)             int64    result: a hypothesis for each key, greatest weight first
    logw     (n,)             float64  result: log of the sum of the weights with that key
    =======  ===============  =======  ======================================================
    """

    key: KeyArray
    slot: IntArray
    order: SortBuffers
    weight: FloatArray
    example: IntArray
    which: IntArray
    logw: FloatArray


@inlined
def allocate_unique(n: int) -> UniqueBuffers:
    """Allocate buffers for n hypotheses."""
    return UniqueBuffers(
        np.empty(n, np.uint64),
        np.empty(power_of_two(2 * n), np.int64),
        allocate_sort(n),
        np.empty(n),
        np.empty(n, np.int64),
        np.empty(n, np.int64),
        np.empty(n),
    )


@spliced
def rank_by_weight(count: int, to: UniqueBuffers) -> None:
    """Sort `to.example` by `to.weight`, greatest first, stable; fill `which` and `logw`."""
    for k in range(count):
        to.weight[k] = math.log(to.weight[k])
    argsort_descending(to.weight, ZERO, count, to.order)
    order = to.order.index
    for k in range(count):
        to.which[k] = to.example[order[k]]
        to.logw[k] = to.weight[order[k]]


@leaf
def unique_hypotheses(n: int, weight: FloatArray, first: int, to: UniqueBuffers) -> int:
    """Merge hypotheses with equal keys among n from `first` on; return how many are distinct."""
    slots = power_of_two(2 * n)
    for i in range(slots):
        to.slot[i] = -1
    count = ZERO
    mask = slots - 1
    for h in range(n):
        at = int64(to.key[h] & np.uint64(mask))
        while to.slot[at] >= 0 and to.key[to.example[to.slot[at]] - first] != to.key[h]:
            at = (at + 1) & mask
        if to.slot[at] < 0:
            to.slot[at] = count
            to.weight[count] = 0.0
            to.example[count] = first + h
            count += 1
        to.weight[to.slot[at]] += weight[first + h]
    rank_by_weight(count, to)
    return count
