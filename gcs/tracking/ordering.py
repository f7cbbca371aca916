"""Compiled sorting and joining of hypotheses, shared by the kernels of this room.

Its functions are compiled into the kernels of other files, so their caches must be cleared after an edit here
(see `gcs.compiling`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gcs.compiling import called, inlined

_FEW = 12


@called
def head(array: Any, n: int) -> Any:
    """The first n elements, copied."""
    return array[:n].copy()


@called
def _sorted(value: Any, first: int, end: int) -> Any:
    """Insertion sort of a few, merge sort of more; see `greatest_first`."""
    n = end - first
    order = np.empty(n, np.int64)
    if n <= _FEW:
        for i in range(n):
            j = i
            while j > 0 and value[order[j - 1]] < value[first + i]:
                order[j] = order[j - 1]
                j -= 1
            order[j] = first + i
        return order
    merged = np.empty(n, np.int64)
    for i in range(n):
        order[i] = first + i
    run = 1
    while run < n:
        for low in range(0, n, 2 * run):
            mid, high = min(low + run, n), min(low + 2 * run, n)
            i, j = low, mid
            for k in range(low, high):
                if j == high or (i < mid and not value[order[i]] < value[order[j]]):
                    merged[k] = order[i]
                    i += 1
                else:
                    merged[k] = order[j]
                    j += 1
        order, merged = merged, order
        run *= 2
    return order


@inlined
def greatest_first(value: Any, first: int, end: int) -> Any:
    """Indices `first` to `end` - 1 of the values, the greatest first, equal ones in their order."""
    return _sorted(value, np.int64(first), np.int64(end))


@called
def distinct(key: Any, logw: Any, first: int) -> Any:
    """Hypotheses `first`, `first` + 1 ... that have keys `key` (n,), those with equal keys as one.

    Among equal weights the least key comes first; `key` is used up.
    Returns one hypothesis for each key and the log of the weights' sum, the greatest first.
    """
    n = key.size
    for h in range(n):
        key[h] = ~key[h]
    by_key = greatest_first(key, 0, n)
    weight, example = np.empty(n), np.empty(n, np.int64)
    count = 0
    for k in range(n):
        h = by_key[k]
        if k == 0 or key[h] != key[by_key[k - 1]]:
            weight[count], example[count] = 0.0, first + h
            count += 1
        weight[count - 1] += math.exp(logw[first + h])
    order = greatest_first(weight, 0, count)
    which, total = np.empty(count, np.int64), np.empty(count)
    for k in range(count):
        which[k], total[k] = example[order[k]], math.log(weight[order[k]])
    return which, total
