"""Compiled meeting: before a scan's update, groups whose labels want the same detections become one.

Objects whose gates share no detection are associated independently, so the density is kept as a product of
delta-GLMBs over disjoint sets of labels (Reuter et al. 2014; Beard, Vo & Vo 2020). Cost then grows with the
number of objects, not with the number of their joint hypotheses, and the cap on hypotheses cuts only where
objects interact: with fifty objects at p_D 0.98 there is a miss at every scan, and no cap could hold all
combinations of who was missed.

Groups that compete (see `claims`) become the product of their hypotheses, which is exact but for the cap.
Afterwards they part again (see `parting`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf, spliced
from gcs.tracking.clusters.contention import room_for_claims, root_of, unite
from gcs.tracking.glmb.hypotheses import Clusters, Limits, Options, filled, room_for_groups
from gcs.tracking.numerics.sorting import Order, greatest_first, head, room_to_order


@inlined
def _widest(start: Any, low: int, high: int) -> int:
    """Most items of one of the hypotheses `low` to `high` - 1."""
    wide = 0
    for h in range(low, high):
        wide = max(wide, start[h + 1] - start[h])
    return wide


class _Pairs(NamedTuple):
    """Room for pairs of hypotheses of two groups, and for two unions of groups."""

    logw: Any
    left: Any
    right: Any
    order: Order
    one: Clusters
    other: Clusters


@spliced
def _product(
    start: Any,
    items: Any,
    logw: Any,
    low: int,
    high: int,
    groups: Clusters,
    g: int,
    limits: Limits,
    work: _Pairs,
    to: Clusters,
) -> int:
    """Hypotheses `low` to `high` - 1 and those of an independent group g together: the best pairs.

    Both are sorted, so the pair (i, j) has at least (i + 1)(j + 1) - 1 pairs that are no worse, and the best
    `limits.hypotheses` pairs lie under that hyperbola. Returns how many hypotheses `to` has then.
    """
    most, rows = limits.hypotheses, min(high - low, limits.hypotheses)
    g_low, columns = groups.first[g], groups.first[g + 1] - groups.first[g]
    count, floor = ZERO, logw[low] + groups.logw[g_low] + limits.log_prune
    for i in range(rows):
        for j in range(min(columns, most // (i + 1))):
            w = logw[low + i] + groups.logw[g_low + j]
            if w < floor:
                break
            work.logw[count], work.left[count], work.right[count] = w, low + i, g_low + j
            count += 1
    greatest_first(work.logw, ZERO, count, work.order)
    n, total, size = min(count, most), 0.0, 0
    to.start[0] = 0
    for h in range(n):
        pair = work.order.index[h]
        a, b = work.left[pair], work.right[pair]
        for i in range(start[a], start[a + 1]):
            to.items[size] = items[i]
            size += 1
        for i in range(groups.start[b], groups.start[b + 1]):
            to.items[size] = groups.items[i]
            size += 1
        to.start[h + 1], to.logw[h] = size, work.logw[pair]
        total += math.exp(to.logw[h])
    log_total = math.log(total)
    for h in range(n):
        to.logw[h] -= log_total
    return n


@inlined
def _pairs_at_most(rows: int, columns: int, most: int) -> int:
    """How many pairs `_product` may look at."""
    bound = 0
    for i in range(min(rows, most)):
        bound += min(columns, most // (i + 1))
    return bound


@inlined
def _one_label(groups: Clusters, g: int, track_label: Any) -> bool:
    begin = groups.start[groups.first[g]]
    for i in range(begin, groups.start[groups.first[g + 1]]):
        if track_label[groups.items[i]] != track_label[groups.items[begin]]:
            return False
    return True


class _Unions(NamedTuple):
    """Which groups are one, for each group."""

    parent: Any
    """The first group of its union; -1 for one label that competes with nobody."""
    follower: Any
    """The next one in its union, -1 behind the last."""
    last: Any
    """Scratch."""
    room: Any
    """Of a first one: most hypotheses of the union."""
    wide: Any
    """And most items of one of them."""


@leaf
def _chain(groups: Clusters, track_label: Any, limits: Limits, to: _Unions, alone: Any) -> Any:
    """Make of the trees in `to.parent` chains, and list in `alone` the labels that compete with nobody.

    Returns how many those are; hypotheses and items of all unions, and the most of one; pairs of a product.
    """
    first, n_groups = groups.first, groups.first.size - 1
    pairs = 1
    for g in range(n_groups):
        root, count = root_of(to.parent, g), first[g + 1] - first[g]
        to.parent[g], to.follower[g], to.last[g] = root, -1, g
        to.room[g], to.wide[g] = count, _widest(groups.start, first[g], first[g + 1])
        if root != g:
            to.follower[to.last[root]], to.last[root] = g, g
            pairs = max(pairs, _pairs_at_most(to.room[root], count, limits.hypotheses))
            to.room[root] = min(to.room[root] * count, limits.hypotheses)
            to.wide[root] += to.wide[g]
    n_alone, n_hyps, n_items, hyps, items = 0, 0, 0, 0, 0
    for g in range(n_groups):
        if to.parent[g] != g:
            continue
        if to.follower[g] < 0 and _one_label(groups, g, track_label):
            alone[n_alone], to.parent[g] = g, -1
            n_alone += 1
            continue
        n_hyps += to.room[g]
        n_items += to.room[g] * to.wide[g]
        if to.follower[g] >= 0:
            hyps, items = max(hyps, to.room[g]), max(items, to.room[g] * to.wide[g])
    return n_alone, n_hyps, n_items, hyps, items, pairs


@leaf
def _united(groups: Clusters, unions: _Unions, limits: Limits, work: _Pairs, out: Clusters) -> Any:
    """Fill `out` with the unions; return how many groups and hypotheses those are."""
    first = groups.first
    count, n = 0, 0
    out.first[0] = out.start[0] = 0
    for g in range(first.size - 1):
        if unions.parent[g] != g:
            continue
        low, high, other = first[g], first[g + 1], unions.follower[g]
        start, items, logw, even = groups.start, groups.items, groups.logw, True
        while other >= 0:
            to = work.one if even else work.other
            high = _product(start, items, logw, low, high, groups, other, limits, work, to)
            start, items, logw, low, even = to.start, to.items, to.logw, 0, not even
            other = unions.follower[other]
        for h in range(low, high):
            out.logw[n], size = logw[h], out.start[n]
            for i in range(start[h], start[h + 1]):
                out.items[size] = items[i]
                size += 1
            n += 1
            out.start[n] = size
        count += 1
        out.first[count] = n
    return count, n


@kernel
def meet(groups: Clusters, options: Options, track_label: Any, n_detections: int, limits: Limits) -> Any:
    """Unite the groups whose labels want the same detections (see `claims`).

    Returns which groups are of one label that competes with nobody, and all others, united.
    """
    n_groups = groups.first.size - 1
    unions = _Unions(
        np.empty(n_groups, np.int64),
        np.empty(n_groups, np.int64),
        np.empty(n_groups, np.int64),
        np.empty(n_groups, np.int64),
        np.empty(n_groups, np.int64),
    )
    claims = room_for_claims(groups.logw.size, track_label.size, options.meas.size, n_detections)
    unite(groups, options, track_label, limits.conflict, claims, unions.parent)
    alone = np.empty(n_groups, np.int64)
    n_alone, n_hyps, n_items, hyps, items, pairs = _chain(groups, track_label, limits, unions, alone)
    work = _Pairs(
        np.empty(pairs),
        np.empty(pairs, np.int64),
        np.empty(pairs, np.int64),
        room_to_order(pairs),
        room_for_groups(0, hyps, items),
        room_for_groups(0, hyps, items),
    )
    out = room_for_groups(n_groups, n_hyps, n_items)
    count, n = _united(groups, unions, limits, work, out)
    return head(alone, n_alone), filled(out, count, n)
