"""Compiled joint association: the children of hypotheses after a scan.

Prediction and update are one step (Vo, Vo & Hoang 2017): each track of a hypothesis takes one of its options
(see `gates`), no detection is taken twice, and a child's weight is its parent's times its options'.

A hypothesis with few joint options is enumerated by branch and bound, which finds exactly the children above
the floor; a larger one is Gibbs-sampled (section III-C of the paper): each track in turn draws anew among the
options that the others leave free, and every distinct state visited is a child with its exact weight.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf, spliced
from gcs.tracking.glmb.hypotheses import Clusters, Limits, Options, filled, key_of, mix, room_for_groups
from gcs.tracking.glmb.hypothesis_pool import HypothesisPool, offer, room_for_children
from gcs.tracking.numerics.sorting import Order, greatest_first, power_of_two, room_to_order

_FEW_JOINT_OPTIONS = 1000
_LOSS_BINS = 16


@inlined
def _uniform(rng: Any) -> float:
    """Next uniform number in [0, 1) of the generator whose state is `rng` (1,): SplitMix64."""
    rng[0] = rng[0] + np.uint64(0x9E3779B97F4A7C15)
    return float(mix(rng[0]) >> np.uint64(11)) * 2.0**-53


@inlined
def _enumerate(
    pool: HypothesisPool,
    room: int,
    slots: int,
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
            count, floor = offer(pool, room, slots, count, floor, total[n], pick, n, options, limits)
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
    pool: HypothesisPool,
    room: int,
    slots: int,
    count: int,
    floor: float,
    base: float,
    tracks: Any,
    options: Options,
    used: Any,
    limits: Limits,
    pick: Any,
    sweeps: int,
    seen: Any,
    rng: Any,
) -> Any:
    """Offer the distinct children that a Gibbs sampler visits, from the greedy one on; `seen` is scratch."""
    start, meas = options.start, options.meas
    n = tracks.size
    _greedy(tracks, options, used, pick)
    size = power_of_two(2 * sweeps + 2)
    for i in range(size):
        seen[i] = 0
    mask = np.uint64(size - 1)
    for _ in range(sweeps):
        logw, key = base, np.uint64(1)
        for i in range(n):
            logw += options.logw[pick[i]]
            key += key_of(pick[i])
        at = key & mask
        while seen[at] != 0 and seen[at] != key:
            at = (at + np.uint64(1)) & mask
        if seen[at] == 0:
            seen[at] = key
            floor = max(floor, logw + limits.log_prune)
            if logw >= floor:
                count, floor = offer(pool, room, slots, count, floor, logw, pick, n, options, limits)
        for i in range(n):
            if meas[pick[i]] >= 0:
                used[meas[pick[i]]] = False
            pick[i] = _draw(start[tracks[i]], start[tracks[i] + 1], options, used, rng)
            if meas[pick[i]] >= 0:
                used[meas[pick[i]]] = True
    _free(tracks, options, used, pick)
    return count, floor


class _Bounds(NamedTuple):
    """What a search can come to."""

    joint: Any
    """How many joint options each hypothesis has."""
    best: Any
    """The best that a child of each can be."""
    room: Any
    """How many children each group can have."""
    widest: Any
    """And how many tracks these."""


class _Search(NamedTuple):
    """Scratch of the search for one hypothesis's children."""

    used: Any
    """(detections,) whether one of the tracks has taken each."""
    pick: Any
    above: Any
    tail: Any
    losses: Any
    seen: Any
    order: Order


@leaf
def _bound(groups: Clusters, options: Options, most: int, to: _Bounds) -> Any:
    """Fill the bounds.

    Returns the widest group, the most room of one, hypotheses and items of all that can go on, and the most
    hypotheses of a group.
    """
    first, start, items = groups.first, groups.start, groups.items
    broadest, roomiest, most_hyps, most_items, longest = 0, 0, 0, 0, 0
    for g in range(first.size - 1):
        total, wide = 0.0, 1
        for h in range(first[g], first[g + 1]):
            joint, best = 1.0, groups.logw[h]
            wide = max(wide, start[h + 1] - start[h])
            for i in range(start[h], start[h + 1]):
                o = options.start[items[i]]
                joint *= options.start[items[i] + 1] - o
                best += options.logw[o]
            to.joint[h], to.best[h] = joint, best
            total += joint
        to.room[g], to.widest[g] = int(min(total, 4.0 * most)) + 1, wide
        most_hyps += min(to.room[g], most)
        most_items += min(to.room[g], most) * wide
        broadest, roomiest = max(broadest, wide), max(roomiest, to.room[g])
        longest = max(longest, first[g + 1] - first[g])
    return broadest, roomiest, most_hyps, most_items, longest


@spliced
def _search(
    groups: Clusters,
    g: int,
    options: Options,
    limits: Limits,
    bound: _Bounds,
    pool: HypothesisPool,
    work: _Search,
    rng: Any,
) -> Any:
    """Put the children of group g into the pool; return how many."""
    room, slots = bound.room[g], power_of_two(2 * bound.room[g])
    for i in range(slots):
        pool.slot[i] = -1
    count, floor = ZERO, -np.inf
    greatest_first(bound.best, groups.first[g], groups.first[g + 1], work.order)
    for k in range(groups.first[g + 1] - groups.first[g]):
        h = work.order.index[k]
        if bound.best[h] < floor:
            break
        base = groups.logw[h]
        tracks = groups.items[groups.start[h] : groups.start[h + 1]]
        contenders = bound.joint[h]
        if contenders > _FEW_JOINT_OPTIONS:
            greedy = base + _greedy(tracks, options, work.used, work.pick)
            _free(tracks, options, work.used, work.pick)
            slack = bound.best[h] - max(floor, greedy + limits.log_prune)
            contenders = min(contenders, _contenders(tracks, options, slack, work.losses))
        if contenders <= limits.enumerable:
            count, floor = _enumerate(
                pool, room, slots, count, floor, base, tracks, options,
                work.used, limits, work.pick, work.above, work.tail,
            )  # fmt: skip
        else:
            sweeps = math.ceil(limits.sweeps * math.exp(base)) + 8
            count, floor = _sample(
                pool, room, slots, count, floor, base, tracks, options,
                work.used, limits, work.pick, sweeps, work.seen, rng,
            )  # fmt: skip
    return count


@leaf
def _children(
    groups: Clusters,
    options: Options,
    limits: Limits,
    bound: _Bounds,
    pool: HypothesisPool,
    work: _Search,
    rng: Any,
    out: Clusters,
) -> Any:
    """Fill `out` with the children of all groups; return how many."""
    n, logw = 0, out.logw
    out.first[0] = out.start[0] = 0
    for g in range(groups.first.size - 1):
        count = _search(groups, g, options, limits, bound, pool, work, rng)
        greatest_first(pool.logw, ZERO, count, pool.order)
        best, low, total = pool.logw[pool.order.index[0]], n, 0.0
        for k in range(count):
            i = pool.order.index[k]
            if n == low + limits.hypotheses or pool.logw[i] < best + limits.log_prune:
                break
            logw[n], out.start[n + 1] = pool.logw[i] - best, out.start[n] + pool.size[i]
            for j in range(pool.size[i]):
                out.items[out.start[n] + j] = pool.items[i, j]
            total += math.exp(logw[n])
            n += 1
        log_total = math.log(total)
        for h in range(low, n):
            logw[h] -= log_total
        out.first[g + 1] = n
    return n


@kernel
def children(groups: Clusters, options: Options, n_detections: int, limits: Limits, rng: Any) -> Any:
    """Jointly predict and update groups of several labels; the result's items are options.

    `rng` (1,) uint64 advances.
    """
    n_groups, n_hyps = groups.first.size - 1, groups.logw.size
    bound = _Bounds(
        np.empty(n_hyps), np.empty(n_hyps), np.empty(n_groups, np.int64), np.empty(n_groups, np.int64)
    )
    broadest, roomiest, most_hyps, most_items, longest = _bound(groups, options, limits.hypotheses, bound)
    work = _Search(
        np.zeros(n_detections, np.bool_),
        np.empty(broadest, np.int64),
        np.empty(broadest + 1),
        np.empty(broadest + 1),
        np.empty(_LOSS_BINS),
        np.empty(power_of_two(2 * (limits.sweeps + 9) + 2), np.uint64),
        room_to_order(longest),
    )
    out = room_for_groups(n_groups, most_hyps, most_items)
    n = _children(groups, options, limits, bound, room_for_children(roomiest, broadest), work, rng, out)
    return filled(out, n_groups, n)
