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
name (track, detection) pairs and so become the next scan's tracks. Why the kernels of this room look as they
do, and which file's cache to clear after an edit: see `gcs.compiling`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gcs.compiling import called, inlined, kernel
from gcs.tracking.ordering import greatest_first, head

DIED = -2
_FEW_JOINT_OPTIONS = 1000
_LOSS_BINS = 16


class Groups(NamedTuple):
    """Independent groups of hypotheses: group g has hypotheses `first[g]` to `first[g + 1]`."""

    first: Any
    start: Any
    """Hypothesis h has items `start[h]` to `start[h + 1]`."""
    items: Any
    logw: Any


class Options(NamedTuple):
    """What each track may do (see `gates.options`)."""

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
    conflict: float
    """Labels that would take the same detection less probably than this are associated apart."""
    dependence: float
    """Labels whose joint differs by less (total variation) from the product of marginals part."""
    enumerable: int
    """Most joint options within `log_prune` of the best of a hypothesis that is enumerated; beyond, it is
    sampled."""
    sweeps: int
    """Gibbs sweeps that a group's sampled hypotheses share by weight."""


class Pool(NamedTuple):
    """Distinct hypotheses so far: item sets with log-weights, found again by key (open addressing)."""

    logw: Any
    key: Any
    size: Any
    items: Any
    slot: Any
    """Which hypothesis is where in the table, -1 in free places; a power of two of them."""


@inlined
def _mix(x: Any) -> Any:
    """Bijective scrambling of 64 bits (the finaliser of SplitMix64, Steele et al. 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@inlined
def _uniform(rng: Any) -> float:
    """Next uniform number in [0, 1) of the generator whose state is `rng` (1,): SplitMix64."""
    rng[0] = rng[0] + np.uint64(0x9E3779B97F4A7C15)
    return float(_mix(rng[0]) >> np.uint64(11)) * 2.0**-53


@kernel
def option_keys(n: int) -> Any:
    """Keys of the options 0 to n - 1."""
    key = np.empty(n, np.uint64)
    for i in range(n):
        key[i] = _mix(np.uint64(i + 1) * np.uint64(0x9E3779B97F4A7C15))
    return key


@inlined
def _power_of_two(n: int) -> int:
    size = 4
    while size < n:
        size *= 2
    return size


@inlined
def _pool(capacity: int, widest: int) -> Pool:
    slot = np.empty(_power_of_two(2 * capacity), np.int64)
    slot[:] = -1
    return Pool(
        np.empty(capacity),
        np.empty(capacity, np.uint64),
        np.empty(capacity, np.int64),
        np.empty((capacity, widest), np.int64),
        slot,
    )


@inlined
def _find(slot: Any, known: Any, key: Any) -> Any:
    """Where in the table `slot` the hypothesis with `key` is, or the free place for it."""
    mask = slot.size - 1
    at = np.int64(key & np.uint64(mask))
    while slot[at] >= 0 and known[slot[at]] != key:
        at = (at + 1) & mask
    return at


@inlined
def _keep_best(pool: Pool, count: int, most: int) -> Any:
    """Drop all but the `most` best; return how many those are and the log-weight of the worst of them."""
    order = greatest_first(pool.logw, 0, count)
    kept = min(most, count)
    worst = pool.logw[order[kept - 1]]
    # Copying down in their old order never overwrites what is still to be copied.
    stays = np.zeros(count, np.bool_)
    for i in range(kept):
        stays[order[i]] = True
    pool.slot[:] = -1
    i = 0
    for k in range(count):
        if stays[k]:
            pool.logw[i], pool.key[i], pool.size[i] = pool.logw[k], pool.key[k], pool.size[k]
            for j in range(pool.size[k]):
                pool.items[i, j] = pool.items[k, j]
            pool.slot[_find(pool.slot, pool.key, pool.key[i])] = i
            i += 1
    return kept, worst


@called
def _offer(
    pool: Pool, count: int, floor: float, logw: float, pick: Any, n: int, options: Options, limits: Limits
) -> Any:
    """Offer the child in which track i of n takes option `pick[i]`; who died is not in it.

    A child that is in the pool already gains the weight. A full pool keeps its best alone, and the floor, the
    log-weight below which nothing is worth adding, rises to the worst of these. Returns the pool's count and
    the floor.
    """
    key = np.uint64(0)
    for i in range(n):
        if options.meas[pick[i]] != DIED:
            key += options.key[pick[i]]
    at = _find(pool.slot, pool.key, key)
    same = pool.slot[at]
    if same >= 0:
        high, low = max(pool.logw[same], logw), min(pool.logw[same], logw)
        pool.logw[same] = high + math.log1p(math.exp(low - high))
        return count, floor
    if count == pool.logw.size:
        count, worst = _keep_best(pool, count, limits.hypotheses)
        floor = max(floor, worst)
        if logw < floor:
            return count, floor
        at = _find(pool.slot, pool.key, key)
    size = 0
    for i in range(n):
        if options.meas[pick[i]] != DIED:
            pool.items[count, size] = pick[i]
            size += 1
    pool.slot[at] = count
    pool.logw[count], pool.key[count], pool.size[count] = logw, key, size
    return count + 1, floor


@inlined
def _enumerate(
    pool: Pool,
    count: int,
    floor: float,
    base: float,
    tracks: Any,
    options: Options,
    used: Any,
    limits: Limits,
    pick: Any,
    total: Any,
    tail: Any,
) -> Any:
    """Offer every child of a hypothesis above the floor: depth first, options best first, bounded from above.

    The bound lets the tracks still to choose have their best options as if nobody competed for detections.
    """
    start, meas, logw = options.start, options.meas, options.logw
    n = tracks.size
    tail[n], total[0] = 0.0, base
    for d in range(n - 1, -1, -1):
        pick[d] = start[tracks[d]] - 1
        tail[d] = tail[d + 1] + logw[start[tracks[d]]]
    d = 0
    while d >= 0:
        if d == n:
            floor = max(floor, total[n] + limits.log_prune)
            count, floor = _offer(pool, count, floor, total[n], pick, n, options, limits)
            d -= 1
            continue
        first, end, o = start[tracks[d]], start[tracks[d] + 1], pick[d]
        if o >= first and meas[o] >= 0:
            used[meas[o]] = False
        o += 1
        while o < end and meas[o] >= 0 and used[meas[o]]:
            o += 1
        if o == end or total[d] + logw[o] + tail[d + 1] < floor:
            pick[d] = first - 1
            d -= 1
            continue
        pick[d] = o
        if meas[o] >= 0:
            used[meas[o]] = True
        total[d + 1] = total[d] + logw[o]
        d += 1
    return count, floor


@inlined
def _greedy(tracks: Any, options: Options, used: Any, pick: Any) -> float:
    """Let each track in turn `pick` its best free option, which is `used` then; return their log-weight."""
    start, meas = options.start, options.meas
    total = 0.0
    for i in range(tracks.size):
        o = start[tracks[i]]
        while meas[o] >= 0 and used[meas[o]]:
            o += 1
        pick[i] = o
        if meas[o] >= 0:
            used[meas[o]] = True
        total += options.logw[o]
    return total


@inlined
def _free(tracks: Any, options: Options, used: Any, pick: Any) -> None:
    for i in range(tracks.size):
        if options.meas[pick[i]] >= 0:
            used[options.meas[pick[i]]] = False


@inlined
def _contenders(tracks: Any, options: Options, slack: float, count: Any) -> float:
    """About how many joint options lose less than `slack` against each track's best, competition aside.

    What is lost is counted in steps of a bin of `count` (bins,), rounded down, so the number is rather too
    great.
    """
    start, logw = options.start, options.logw
    count[:] = 0.0
    count[0] = 1.0
    per_step = count.size / slack
    for i in range(tracks.size):
        first, end = start[tracks[i]], start[tracks[i] + 1]
        for b in range(count.size - 1, -1, -1):
            total = 0.0
            for o in range(first, end):
                loss = (logw[first] - logw[o]) * per_step
                if loss >= b + 1:
                    break
                total += count[b - int(loss)]
            count[b] = total
    number = 0.0
    for b in range(count.size):
        number += count[b]
    return number


@inlined
def _draw(first: int, end: int, options: Options, used: Any, rng: Any) -> int:
    """Draw one of a track's free options in proportion to its weight."""
    meas, logw = options.meas, options.logw
    while meas[first] >= 0 and used[meas[first]]:
        first += 1
    total = 0.0
    for o in range(first, end):
        if meas[o] < 0 or not used[meas[o]]:
            total += math.exp(logw[o] - logw[first])
    left, chosen = _uniform(rng) * total, first
    for o in range(first, end):
        if meas[o] < 0 or not used[meas[o]]:
            chosen = o
            left -= math.exp(logw[o] - logw[first])
            if left < 0.0:
                break
    return chosen


@inlined
def _sample(
    pool: Pool,
    count: int,
    floor: float,
    base: float,
    tracks: Any,
    options: Options,
    used: Any,
    limits: Limits,
    pick: Any,
    sweeps: int,
    rng: Any,
) -> Any:
    """Offer the distinct children that a Gibbs sampler visits, from the greedy one on."""
    start, meas = options.start, options.meas
    n = tracks.size
    _greedy(tracks, options, used, pick)
    seen = np.empty(_power_of_two(2 * sweeps + 2), np.uint64)
    seen[:] = 0
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
            floor = max(floor, logw + limits.log_prune)
            if logw >= floor:
                count, floor = _offer(pool, count, floor, logw, pick, n, options, limits)
        for i in range(n):
            if meas[pick[i]] >= 0:
                used[meas[pick[i]]] = False
            pick[i] = _draw(start[tracks[i]], start[tracks[i] + 1], options, used, rng)
            if meas[pick[i]] >= 0:
                used[meas[pick[i]]] = True
    _free(tracks, options, used, pick)
    return count, floor


@kernel
def children(groups: Groups, options: Options, n_detections: int, limits: Limits, rng: Any) -> Groups:
    """Jointly predict and update groups of several labels; the result's items are options.

    `rng` (1,) uint64 advances.
    """
    first, start = groups.first, groups.start
    items, logw = groups.items, groups.logw
    n_groups, n_hyps = first.size - 1, logw.size
    joint, bound = np.empty(n_hyps), np.empty(n_hyps)
    widest, room = np.empty(n_groups, np.int64), np.empty(n_groups, np.int64)
    broadest, most_hyps, most_items = 0, 0, 0
    for g in range(n_groups):
        total, wide = 0.0, 1
        for h in range(first[g], first[g + 1]):
            joint[h], bound[h] = 1.0, logw[h]
            wide = max(wide, start[h + 1] - start[h])
            for i in range(start[h], start[h + 1]):
                t = items[i]
                joint[h] *= options.start[t + 1] - options.start[t]
                bound[h] += options.logw[options.start[t]]
            total += joint[h]
        room[g], widest[g] = int(min(total, 4.0 * limits.hypotheses)) + 1, wide
        most_hyps += min(room[g], limits.hypotheses)
        most_items += min(room[g], limits.hypotheses) * wide
        broadest = max(broadest, wide)
    used = np.zeros(n_detections, np.bool_)
    out_first, out_start = np.zeros(n_groups + 1, np.int64), np.zeros(most_hyps + 1, np.int64)
    out_items, out_logw = np.empty(most_items, np.int64), np.empty(most_hyps)
    pick, above, tail = np.empty(broadest, np.int64), np.empty(broadest + 1), np.empty(broadest + 1)
    losses = np.empty(_LOSS_BINS)
    n = 0
    for g in range(n_groups):
        pool = _pool(room[g], widest[g])
        count, floor = np.int64(0), -np.inf
        for h in greatest_first(bound, first[g], first[g + 1]):
            if bound[h] < floor:
                break
            tracks = items[start[h] : start[h + 1]]
            contenders = joint[h]
            if contenders > _FEW_JOINT_OPTIONS:
                greedy = logw[h] + _greedy(tracks, options, used, pick)
                _free(tracks, options, used, pick)
                slack = bound[h] - max(floor, greedy + limits.log_prune)
                contenders = min(contenders, _contenders(tracks, options, slack, losses))
            if contenders <= limits.enumerable:
                count, floor = _enumerate(
                    pool, count, floor, logw[h], tracks, options, used, limits, pick, above, tail
                )
            else:
                sweeps = math.ceil(limits.sweeps * math.exp(logw[h])) + 8
                count, floor = _sample(
                    pool, count, floor, logw[h], tracks, options, used, limits, pick, sweeps, rng
                )
        order = greatest_first(pool.logw, 0, count)
        best, low, total = pool.logw[order[0]], n, 0.0
        for i in order:
            if n == low + limits.hypotheses or pool.logw[i] < best + limits.log_prune:
                break
            out_logw[n], out_start[n + 1] = pool.logw[i] - best, out_start[n] + pool.size[i]
            for j in range(pool.size[i]):
                out_items[out_start[n] + j] = pool.items[i, j]
            total += math.exp(out_logw[n])
            n += 1
        for h in range(low, n):
            out_logw[h] -= math.log(total)
        out_first[g + 1] = n
    return Groups(out_first, head(out_start, n + 1), head(out_items, out_start[n]), head(out_logw, n))
