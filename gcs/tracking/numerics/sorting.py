"""Compiled sorting and joining of hypotheses, shared by the kernels of this room.

Its functions are compiled into the kernels of other files, so their caches must be cleared after an edit here
(see `gcs.jit`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gcs.jit import ZERO, called, inlined, leaf, spliced

_MAX_INSERTION = 8


@called
def head(array: Any, n: int) -> Any:
    """The first n elements."""
    return array[:n]


class SortBuffers(NamedTuple):
    """Room to order things in."""

    index: Any
    """(n,) what comes first, second and so on."""
    other: Any
    """(n,) scratch."""
    begin: Any
    """(n + 1,) scratch."""


@inlined
def allocate_sort(n: int) -> SortBuffers:
    """Return room for n things."""
    return SortBuffers(np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n + 1, np.int64))


@inlined
def _insertion_sort(value: Any, n: int, order: Any) -> None:
    """Order the n indices by insertion: quick where all are near their places."""
    for i in range(1, n):
        x, j = order[i], i
        while j > 0 and value[order[j - 1]] < value[x]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = x


@leaf
def _merge_sort(value: Any, n: int, to: SortBuffers) -> None:
    """Order the n indices in `to` by merging runs."""
    order, merged, run = to.index, to.other, 1
    while run < n:
        for low in range(0, n, 2 * run):
            mid, high = min(low + run, n), min(low + 2 * run, n)
            if mid == high or not value[order[mid - 1]] < value[order[mid]]:
                # In order as they are, as most of what was in order before is.
                for k in range(low, high):
                    merged[k] = order[k]
                continue
            i, j = low, mid
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
def _bucket_sort(value: Any, first: int, n: int, least: float, most: float, to: SortBuffers) -> bool:
    """Put the n indices into as many even steps from the greatest value to the least, as they come.

    Returns whether none of the steps is crowded.
    """
    begin, step, per_unit = to.begin, to.other, (n - 0.5) / (most - least)
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
def _argsort_many(value: Any, first: int, n: int, to: SortBuffers) -> None:
    """Order n indices, `first` and those behind it."""
    least = most = value[first]
    for i in range(n):
        to.index[i] = first + i
        least, most = min(least, value[first + i]), max(most, value[first + i])
    if 0.0 < most - least < np.inf and _bucket_sort(value, first, n, least, most, to):
        _insertion_sort(value, n, to.index)
    else:
        _merge_sort(value, n, to)


@spliced
def argsort_descending(value: Any, first: int, end: int, to: SortBuffers) -> None:
    """Put the indices `first` to `end` - 1 of the values in order: greatest first, equal ones as they come.

    A few by insertion. More are spread over as many steps by their value first, which leaves little to
    do where they are spread evenly, as log-weights are: a tenth of the time of merging 300.
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
    """Room to find hypotheses that are the same, and those found, greatest first."""

    key: Any
    """(n,) what each is known by."""
    slot: Any
    """Which of those found is where in a table by key (open addressing), -1 in free places."""
    order: SortBuffers
    weight: Any
    example: Any
    which: Any
    """(n,) one hypothesis for each key."""
    logw: Any
    """(n,) the log of the sum of the weights of those that share it."""


@inlined
def allocate_unique(n: int) -> UniqueBuffers:
    """Return room for n hypotheses."""
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
    """Put `to.example` in the order of `to.weight`, greatest first, equal ones as they come."""
    for k in range(count):
        to.weight[k] = math.log(to.weight[k])
    argsort_descending(to.weight, ZERO, count, to.order)
    order = to.order.index
    for k in range(count):
        to.which[k], to.logw[k] = to.example[order[k]], to.weight[order[k]]


@leaf
def unique_hypotheses(n: int, weight: Any, first: int, to: UniqueBuffers) -> int:
    """Find hypotheses with equal keys among n, `first`, `first` + 1 ...; return how many are different."""
    slots = power_of_two(2 * n)
    for i in range(slots):
        to.slot[i] = -1
    count, mask = ZERO, slots - 1
    for h in range(n):
        at = np.int64(to.key[h] & np.uint64(mask))
        while to.slot[at] >= 0 and to.key[to.example[to.slot[at]] - first] != to.key[h]:
            at = (at + 1) & mask
        if to.slot[at] < 0:
            to.slot[at], to.weight[count], to.example[count] = count, 0.0, first + h
            count += 1
        to.weight[to.slot[at]] += weight[first + h]
    rank_by_weight(count, to)
    return count
