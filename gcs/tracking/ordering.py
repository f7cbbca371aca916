"""Compiled sorting and joining of hypotheses, shared by the kernels of this room.

Its functions are compiled into the kernels of other files, so their caches must be cleared after an edit here
(see `gcs.compiling`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gcs.compiling import ZERO, called, inlined, leaf

_FEW = 12


@called
def head(array: Any, n: int) -> Any:
    """The first n elements, copied."""
    return array[:n].copy()


class Order(NamedTuple):
    """Room to order things in."""

    index: Any
    """(n,) what comes first, second and so on."""
    other: Any
    """(n,) scratch."""


@inlined
def room_to_order(n: int) -> Order:
    """Return room for n things."""
    return Order(np.empty(n, np.int64), np.empty(n, np.int64))


@leaf
def greatest_first(value: Any, first: int, end: int, to: Order) -> None:
    """Put the indices `first` to `end` - 1 of the values in order: greatest first, equal ones as they come.

    Insertion sort of a few, merge sort of more.
    """
    n, order, merged = end - first, to.index, to.other
    if n <= _FEW:
        for i in range(n):
            j = i
            while j > 0 and value[order[j - 1]] < value[first + i]:
                order[j] = order[j - 1]
                j -= 1
            order[j] = first + i
        return
    for i in range(n):
        order[i] = first + i
    run = 1
    while run < n:
        for low in range(0, n, 2 * run):
            mid, high = min(low + run, n), min(low + 2 * run, n)
            if mid == high or not value[order[mid - 1]] < value[order[mid]]:
                # In order as they are, as most of what comes from lists in order is.
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
def power_of_two(n: int) -> int:
    """Return the least power of two, 4 or more, that is not below n."""
    size = 4
    while size < n:
        size *= 2
    return size


class Distinct(NamedTuple):
    """Room to find hypotheses that are the same, and those found, greatest first."""

    key: Any
    """(n,) what each is known by."""
    slot: Any
    """Which of those found is where in a table by key (open addressing), -1 in free places."""
    order: Order
    weight: Any
    example: Any
    which: Any
    """(n,) one hypothesis for each key."""
    logw: Any
    """(n,) the log of the sum of the weights of those that share it."""


@inlined
def room_for_distinct(n: int) -> Distinct:
    """Return room for n hypotheses."""
    return Distinct(
        np.empty(n, np.uint64),
        np.empty(power_of_two(2 * n), np.int64),
        room_to_order(n),
        np.empty(n),
        np.empty(n, np.int64),
        np.empty(n, np.int64),
        np.empty(n),
    )


@leaf
def rank(count: int, to: Distinct) -> None:
    """Put `to.example` in the order of `to.weight`, greatest first, equal ones as they come."""
    greatest_first(to.weight, ZERO, count, to.order)
    order = to.order.index
    for k in range(count):
        to.which[k], to.logw[k] = to.example[order[k]], math.log(to.weight[order[k]])


@leaf
def distinct(n: int, weight: Any, first: int, to: Distinct) -> int:
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
    rank(count, to)
    return count
