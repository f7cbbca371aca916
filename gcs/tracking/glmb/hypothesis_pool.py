"""Pool of the distinct posterior components of a cluster, with a bound on their number.

Components with equal track sets are one hypothesis: their weights add. A 64-bit key identifies a set.

==============  ===================  =======  ==================================================
HypothesisPool  shape                dtype    meaning (K capacity)
==============  ===================  =======  ==================================================
logw            (K,)                 float64  log-weight
key             (K,)                 uint64   key of the item set
size            (K,)                 int64    number of items
items           (K, max_size)        int64    option indices
slot            (power of two,)      int64    hash table (open addressing): component, or -1
is_kept         (K,)                 bool     scratch
order           SortBuffers                   scratch
==============  ===================  =======  ==================================================
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, int64, leaf, spliced
from gcs.model import BoolArray, FloatArray, IntArray, KeyArray
from gcs.tracking.glmb.hypotheses import ABSENT, AssociationOptions, item_key
from gcs.tracking.glmb.params import Limits
from gcs.tracking.numerics.sorting import SortBuffers, allocate_sort, argsort_descending, power_of_two


class HypothesisPool(NamedTuple):
    """Distinct posterior components, found by key (see the table above)."""

    logw: FloatArray
    key: KeyArray
    size: IntArray
    items: IntArray
    slot: IntArray
    is_kept: BoolArray
    order: SortBuffers


@inlined
def allocate_pool(capacity: int, max_size: int) -> HypothesisPool:
    """Allocate a pool for `capacity` components of at most `max_size` items."""
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
def _find_slot(slot: IntArray, slots: int, keys: KeyArray, key: np.uint64) -> int:
    """Return the slot of the component with `key`, or the free slot where it belongs."""
    mask = slots - 1
    at = int64(key & np.uint64(mask))
    while slot[at] >= 0 and keys[slot[at]] != key:
        at = (at + 1) & mask
    return at


@leaf
def _keep_best(pool: HypothesisPool, count: int, slots: int, max_kept: int) -> tuple[int, float]:
    """Keep the `max_kept` best components; return their number and the worst log-weight of these."""
    argsort_descending(pool.logw, ZERO, count, pool.order)
    order = pool.order.index
    is_kept = pool.is_kept
    kept = min(max_kept, count)
    worst = pool.logw[order[kept - 1]]
    # Rows move down in their old order, so no row is overwritten before it is copied.
    for i in range(count):
        is_kept[order[i]] = i < kept
    for i in range(slots):
        pool.slot[i] = -1
    i = 0
    for k in range(count):
        if is_kept[k]:
            pool.logw[i] = pool.logw[k]
            pool.key[i] = pool.key[k]
            pool.size[i] = pool.size[k]
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
    assignment: IntArray,
    n: int,
    options: AssociationOptions,
    limits: Limits,
) -> tuple[int, float]:
    """Add the component in which track i of n takes option `assignment[i]`; absent tracks are left out.

    A known component gains the weight. A full pool keeps its best components alone, and `floor`, the
    log-weight below which candidates are ignored, rises to the worst of them. Returns the number of
    components and the floor.
    """
    key = np.uint64(0)
    for i in range(n):
        if options.meas[assignment[i]] != ABSENT:
            key += item_key(assignment[i])
    at = _find_slot(pool.slot, slots, pool.key, key)
    found = pool.slot[at]
    if found >= 0:
        high = max(pool.logw[found], logw)
        low = min(pool.logw[found], logw)
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
        if options.meas[assignment[i]] != ABSENT:
            pool.items[count, size] = assignment[i]
            size += 1
    pool.slot[at] = count
    pool.logw[count] = logw
    pool.key[count] = key
    pool.size[count] = size
    return count + 1, floor
