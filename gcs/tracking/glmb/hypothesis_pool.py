"""Compiled pool: the distinct children of a group's hypotheses, as they are found.

Children with equal track sets are one hypothesis: their weights add under a 64-bit key of the set.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, leaf, spliced
from gcs.tracking.glmb.hypotheses import DIED, AssociationOptions, Limits, item_key
from gcs.tracking.numerics.sorting import SortBuffers, allocate_sort, argsort_descending, power_of_two


class HypothesisPool(NamedTuple):
    """Distinct hypotheses so far: item sets with log-weights, found again by key (open addressing)."""

    logw: Any
    key: Any
    size: Any
    items: Any
    slot: Any
    """Which hypothesis is where in the table, -1 in free places."""
    is_kept: Any
    """Scratch."""
    order: SortBuffers


@inlined
def allocate_pool(capacity: int, max_size: int) -> HypothesisPool:
    """Return room for so many hypotheses, of so many tracks."""
    return HypothesisPool(
        np.empty(capacity),
        np.empty(capacity, np.uint64),
        np.empty(capacity, np.int64),
        np.empty((capacity, max_size), np.int64),
        np.empty(power_of_two(2 * capacity), np.int64),
        np.empty(capacity, np.bool_),
        allocate_sort(capacity),
    )


@inlined
def _find_slot(slot: Any, slots: int, keys: Any, key: Any) -> Any:
    """Where in the table, the first `slots` of `slot`, the hypothesis with `key` is, or a place for it."""
    mask = slots - 1
    at = np.int64(key & np.uint64(mask))
    while slot[at] >= 0 and keys[slot[at]] != key:
        at = (at + 1) & mask
    return at


@leaf
def _keep_best(pool: HypothesisPool, count: int, slots: int, max_kept: int) -> Any:
    """Drop all but the `most` best; return how many those are and the log-weight of the worst of them."""
    argsort_descending(pool.logw, ZERO, count, pool.order)
    order, is_kept = pool.order.index, pool.is_kept
    kept = min(max_kept, count)
    worst = pool.logw[order[kept - 1]]
    # Copying down in their old order never overwrites what is still to be copied.
    for i in range(count):
        is_kept[order[i]] = i < kept
    for i in range(slots):
        pool.slot[i] = -1
    i = 0
    for k in range(count):
        if is_kept[k]:
            pool.logw[i], pool.key[i], pool.size[i] = pool.logw[k], pool.key[k], pool.size[k]
            for j in range(pool.size[k]):
                pool.items[i, j] = pool.items[k, j]
            pool.slot[_find_slot(pool.slot, slots, pool.key, pool.key[i])] = i
            i += 1
    return kept, worst


@spliced
def add_candidate(
    pool: HypothesisPool,
    capacity: int,
    slots: int,
    count: int,
    floor: float,
    logw: float,
    assignment: Any,
    n: int,
    options: AssociationOptions,
    limits: Limits,
) -> Any:
    """Offer the child in which track i of n takes option `pick[i]`; who died is not in it.

    A child that is in the pool already gains the weight. A pool with `room` children is full and keeps its
    best alone, and the floor, the log-weight below which nothing is worth adding, rises to their worst.
    Returns the pool's count and the floor.
    """
    key = np.uint64(0)
    for i in range(n):
        if options.meas[assignment[i]] != DIED:
            key += item_key(assignment[i])
    at = _find_slot(pool.slot, slots, pool.key, key)
    found = pool.slot[at]
    if found >= 0:
        high, low = max(pool.logw[found], logw), min(pool.logw[found], logw)
        pool.logw[found] = high + math.log1p(math.exp(low - high))
        return count, floor
    if count == capacity:
        count, worst = _keep_best(pool, count, slots, limits.max_hypotheses)
        floor = max(floor, worst)
        if logw < floor:
            return count, floor
        at = _find_slot(pool.slot, slots, pool.key, key)
    size = 0
    for i in range(n):
        if options.meas[assignment[i]] != DIED:
            pool.items[count, size] = assignment[i]
            size += 1
    pool.slot[at] = count
    pool.logw[count], pool.key[count], pool.size[count] = logw, key, size
    return count + 1, floor
