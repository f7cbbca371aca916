"""Compiled joint association: the children of hypotheses after a scan.

A delta-GLMB density over labels is a list of weighted hypotheses, each a set of tracks (Vo, Vo & Phung 2014).
Prediction and update are one step (Vo, Vo & Hoang 2017): each track of a hypothesis takes one of its options
(see `kernels`), no detection is taken twice, and a child's weight is its parent's times its options'.

A hypothesis with few joint options is enumerated by branch and bound, which finds exactly the children above
the floor; a larger one is Gibbs-sampled (section III-C of the paper): each track in turn draws anew among the
options that the others leave free, and every distinct state visited is a child with its exact weight.
Children with equal track sets are one hypothesis: their weights add under a 64-bit key of the set.

Weights are logarithms throughout; hypotheses of a group are sorted, best first, and their weights sum to 1.
Lists of lists are flat: list i is `items[start[i]:start[i + 1]]`. A child's items are option indices, which
name (track, detection) pairs and so become the next scan's tracks. Calls only kernels of this file: numba's
cache does not see other files change.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np

njit = numba.njit(nogil=True, cache=True, error_model="numpy")

DIED = -2


class Groups(NamedTuple):
    """Independent groups of hypotheses: group g has hypotheses `first[g]` to `first[g + 1]`."""

    first: Any
    start: Any
    """Hypothesis h has items `start[h]` to `start[h + 1]`."""
    items: Any
    logw: Any


class Options(NamedTuple):
    """What each track may do (see `kernels.options`)."""

    start: Any
    meas: Any
    logw: Any
    key: Any
    """Random-looking 64 bits for each option, the same at every scan."""


class Limits(NamedTuple):
    """What bounds the work and the approximation."""

    hypotheses: int
    """Most hypotheses of one group."""
    log_prune: float
    """Log of the least weight kept, relative to the group's best."""
    existence: float
    """Labels below it are forgotten."""
    dependence: float
    """Labels whose joint differs by less (total variation) from the product of marginals part."""
    enumerable: int
    """Most joint options of a hypothesis that is enumerated; beyond, it is sampled."""
    sweeps: int
    """Gibbs sweeps that a group's sampled hypotheses share by weight."""


class Pool(NamedTuple):
    """Distinct hypotheses so far: item sets with log-weights, found again by key (open addressing)."""

    logw: Any
    key: Any
    size: Any
    items: Any
    slot: Any
    count: Any
    """(1,) how many there are."""
    floor: Any
    """(1,) log-weight below which nothing is worth adding."""


@njit
def _mix(x: Any) -> Any:
    """Bijective scrambling of 64 bits (the finaliser of SplitMix64, Steele et al. 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@njit
def _uniform(rng: Any) -> float:
    """Next uniform number in [0, 1) of the generator whose state is `rng` (1,): SplitMix64."""
    rng[0] = rng[0] + np.uint64(0x9E3779B97F4A7C15)
    return float(_mix(rng[0]) >> np.uint64(11)) * 2.0**-53


@njit
def option_keys(n: int) -> Any:
    """Keys of the options 0 to n - 1."""
    key = np.empty(n, np.uint64)
    for i in range(n):
        key[i] = _mix(np.uint64(i + 1) * np.uint64(0x9E3779B97F4A7C15))
    return key


@njit
def _power_of_two(n: int) -> int:
    size = 4
    while size < n:
        size *= 2
    return size


@njit
def _pool(capacity: int, widest: int) -> Pool:
    return Pool(
        np.empty(capacity),
        np.empty(capacity, np.uint64),
        np.empty(capacity, np.int64),
        np.empty((capacity, widest), np.int64),
        np.full(_power_of_two(2 * capacity), -1),
        np.zeros(1, np.int64),
        np.full(1, -np.inf),
    )


@njit
def _slot(pool: Pool, key: Any) -> Any:
    """Where `key` is in the table, or the free place for it."""
    mask = pool.slot.size - 1
    at = np.int64(key & np.uint64(mask))
    while pool.slot[at] >= 0 and pool.key[pool.slot[at]] != key:
        at = (at + 1) & mask
    return at


@njit
def _ranked(pool: Pool, most: int) -> Any:
    """Indices of the `most` best hypotheses, best first, equal ones in the order of their arrival."""
    return np.argsort(-pool.logw[: pool.count[0]], kind="mergesort")[:most]


@njit
def _keep_best(pool: Pool, most: int) -> None:
    """Drop all but the `most` best and raise the floor to the worst of them."""
    order = _ranked(pool, most)
    worst = pool.logw[order[-1]]
    pool.floor[0] = max(pool.floor[0], worst)
    order.sort()  # so that copying down never overwrites what is still to be copied
    pool.slot[:] = -1
    for i in range(order.size):
        k = order[i]
        pool.logw[i], pool.key[i], pool.size[i] = pool.logw[k], pool.key[k], pool.size[k]
        for j in range(pool.size[k]):
            pool.items[i, j] = pool.items[k, j]
        pool.slot[_slot(pool, pool.key[i])] = i
    pool.count[0] = order.size


@njit
def _offer(pool: Pool, logw: float, items: Any, n: int, key: Any, most: int) -> None:
    """Add a hypothesis, or its weight to the equal one there. A full pool keeps its `most` best alone."""
    at = _slot(pool, key)
    same = pool.slot[at]
    if same >= 0:
        high, low = max(pool.logw[same], logw), min(pool.logw[same], logw)
        pool.logw[same] = high + math.log1p(math.exp(low - high))
        return
    if pool.count[0] == pool.logw.size:
        _keep_best(pool, most)
        if logw < pool.floor[0]:
            return
        at = _slot(pool, key)
    new = pool.count[0]
    pool.slot[at] = new
    pool.logw[new], pool.key[new], pool.size[new] = logw, key, n
    for i in range(n):
        pool.items[new, i] = items[i]
    pool.count[0] = new + 1


@njit
def _offer_child(
    pool: Pool, logw: float, pick: Any, n: int, options: Options, scratch: Any, most: int
) -> None:
    """Offer the child in which track i of n takes option `pick[i]`; who died is not in it."""
    size, key = 0, np.uint64(0)
    for i in range(n):
        if options.meas[pick[i]] != DIED:
            scratch[size] = pick[i]
            size += 1
            key += options.key[pick[i]]
    _offer(pool, logw, scratch, size, key, most)


@njit
def _enumerate(
    pool: Pool, base: float, tracks: Any, options: Options, used: Any, limits: Limits, work: Any
) -> None:
    """Offer every child of a hypothesis above the floor: depth first, options best first, bounded from above.

    The bound lets the tracks still to choose have their best options as if nobody competed for detections.
    """
    pick, scratch, total, tail = work
    n = tracks.size
    tail[n], total[0] = 0.0, base
    for d in range(n - 1, -1, -1):
        tail[d] = tail[d + 1] + options.logw[options.start[tracks[d]]]
    d, pick[0] = 0, options.start[tracks[0]] - 1
    while d >= 0:
        first, end, o = options.start[tracks[d]], options.start[tracks[d] + 1], pick[d]
        if o >= first and options.meas[o] >= 0:
            used[options.meas[o]] = False
        o += 1
        while o < end and options.meas[o] >= 0 and used[options.meas[o]]:
            o += 1
        if o == end or total[d] + options.logw[o] + tail[d + 1] < pool.floor[0]:
            d -= 1
            continue
        pick[d] = o
        if options.meas[o] >= 0:
            used[options.meas[o]] = True
        total[d + 1] = total[d] + options.logw[o]
        if d + 1 == n:
            pool.floor[0] = max(pool.floor[0], total[n] + limits.log_prune)
            _offer_child(pool, total[n], pick, n, options, scratch, limits.hypotheses)
        else:
            d += 1
            pick[d] = options.start[tracks[d]] - 1


@njit
def _draw(first: int, end: int, options: Options, used: Any, rng: Any) -> int:
    """Draw one of a track's free options in proportion to its weight."""
    while options.meas[first] >= 0 and used[options.meas[first]]:
        first += 1
    total = 0.0
    for o in range(first, end):
        if options.meas[o] < 0 or not used[options.meas[o]]:
            total += math.exp(options.logw[o] - options.logw[first])
    left, chosen = _uniform(rng) * total, first
    for o in range(first, end):
        if options.meas[o] < 0 or not used[options.meas[o]]:
            chosen = o
            left -= math.exp(options.logw[o] - options.logw[first])
            if left < 0.0:
                break
    return chosen


@njit
def _sample(
    pool: Pool,
    base: float,
    tracks: Any,
    options: Options,
    used: Any,
    limits: Limits,
    work: Any,
    sweeps: int,
    rng: Any,
) -> None:
    """Offer the distinct children that a Gibbs sampler visits, from the greedy one on."""
    pick, scratch, _, _ = work
    n = tracks.size
    for i in range(n):
        o = options.start[tracks[i]]
        while options.meas[o] >= 0 and used[options.meas[o]]:
            o += 1
        pick[i] = o
        if options.meas[o] >= 0:
            used[options.meas[o]] = True
    seen = np.zeros(_power_of_two(2 * sweeps + 2), np.uint64)
    mask = np.uint64(seen.size - 1)
    for _ in range(sweeps):
        logw, key = base, np.uint64(1)
        for i in range(n):
            logw += options.logw[pick[i]]
            key += options.key[pick[i]]
        at = key & mask
        while seen[at] != 0 and seen[at] != key:
            at = (at + np.uint64(1)) & mask
        if seen[at] == 0:
            seen[at] = key
            pool.floor[0] = max(pool.floor[0], logw + limits.log_prune)
            if logw >= pool.floor[0]:
                _offer_child(pool, logw, pick, n, options, scratch, limits.hypotheses)
        for i in range(n):
            if options.meas[pick[i]] >= 0:
                used[options.meas[pick[i]]] = False
            pick[i] = _draw(options.start[tracks[i]], options.start[tracks[i] + 1], options, used, rng)
            if options.meas[pick[i]] >= 0:
                used[options.meas[pick[i]]] = True
    for i in range(n):
        if options.meas[pick[i]] >= 0:
            used[options.meas[pick[i]]] = False


@njit
def _group_children(
    pool: Pool, groups: Groups, g: int, sizes: Any, options: Options, used: Any, limits: Limits, rng: Any
) -> None:
    """Fill `pool` with the children of group g; `sizes[h]` is how many joint options hypothesis h has."""
    low, high = groups.first[g], groups.first[g + 1]
    widest = pool.items.shape[1]
    work = (
        np.empty(widest, np.int64),
        np.empty(widest, np.int64),
        np.empty(widest + 1),
        np.empty(widest + 1),
    )
    bound = groups.logw[low:high].copy()
    for h in range(low, high):
        for t in groups.items[groups.start[h] : groups.start[h + 1]]:
            bound[h - low] += options.logw[options.start[t]]
    for k in np.argsort(-bound, kind="mergesort"):
        if bound[k] < pool.floor[0]:
            break
        h = low + k
        tracks = groups.items[groups.start[h] : groups.start[h + 1]]
        if tracks.size == 0:
            pool.floor[0] = max(pool.floor[0], groups.logw[h] + limits.log_prune)
            _offer_child(pool, groups.logw[h], work[0], 0, options, work[1], limits.hypotheses)
        elif sizes[h] <= limits.enumerable:
            _enumerate(pool, groups.logw[h], tracks, options, used, limits, work)
        else:
            sweeps = math.ceil(limits.sweeps * math.exp(groups.logw[h])) + 8
            _sample(pool, groups.logw[h], tracks, options, used, limits, work, sweeps, rng)


@njit
def children(groups: Groups, options: Options, n_detections: int, limits: Limits, rng: Any) -> Groups:
    """Jointly predict and update every group; the result's items are options. `rng` (1,) uint64 advances."""
    n_groups, n_hyps = groups.first.size - 1, groups.logw.size
    sizes = np.ones(n_hyps)
    widest, room = np.ones(n_groups, np.int64), np.zeros(n_groups, np.int64)
    for g in range(n_groups):
        total = 0.0
        for h in range(groups.first[g], groups.first[g + 1]):
            widest[g] = max(widest[g], groups.start[h + 1] - groups.start[h])
            for t in groups.items[groups.start[h] : groups.start[h + 1]]:
                sizes[h] *= options.start[t + 1] - options.start[t]
            total += sizes[h]
        room[g] = int(min(total, 4.0 * limits.hypotheses)) + 1
    used = np.zeros(n_detections, np.bool_)
    kept = np.minimum(room, limits.hypotheses)
    first, start = np.zeros(n_groups + 1, np.int64), np.zeros(kept.sum() + 1, np.int64)
    logw, items = np.empty(kept.sum()), np.empty((kept * widest).sum(), np.int64)
    n = 0
    for g in range(n_groups):
        pool = _pool(room[g], widest[g])
        _group_children(pool, groups, g, sizes, options, used, limits, rng)
        order = _ranked(pool, limits.hypotheses)
        best = pool.logw[order[0]]
        for i in order:
            if pool.logw[i] < best + limits.log_prune:
                break
            logw[n], start[n + 1] = pool.logw[i] - best, start[n] + pool.size[i]
            for j in range(pool.size[i]):
                items[start[n] + j] = pool.items[i, j]
            n += 1
        logw[first[g] : n] -= math.log(np.exp(logw[first[g] : n]).sum())
        first[g + 1] = n
    return Groups(first, start[: n + 1].copy(), items[: start[n]].copy(), logw[:n].copy())
