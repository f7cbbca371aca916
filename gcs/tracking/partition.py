"""Compiled partition of the labels into groups that are independent of each other.

Objects whose gates share no detection are associated independently, so the density is kept as a product of
delta-GLMBs over disjoint sets of labels (Reuter et al. 2014; Beard, Vo & Vo 2020). Cost then grows with the
number of objects, not with the number of their joint hypotheses, and the cap on hypotheses cuts only where
objects interact: with fifty objects at p_D 0.98 there is a miss at every scan, and no cap could hold all
combinations of who was missed.

- `meet`: before a scan's update, groups that gated a common detection become one: the product of their
  hypotheses. Exact but for the cap.
- `part`: afterwards, labels too improbable to matter are forgotten, and labels whose joint distribution is
  the product of their marginals, within a bound on total variation, go on as groups of their own. The test
  looks at pairs. It asks about the density itself, not about distance: two labels that once crossed stay
  together for as long as it is open who is who.

Calls only kernels of this file: numba's cache does not see other files change.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gcs.compiling import called, inlined, kernel
from gcs.tracking.hypotheses import Groups, Limits, Options
from gcs.tracking.ordering import distinct, greatest_first


@inlined
def _root(parent: Any, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@inlined
def _join(parent: Any, i: int, j: int) -> None:
    """Unite two sets; the smaller index stays the root, so that order does not depend on history."""
    a, b = _root(parent, i), _root(parent, j)
    parent[max(a, b)] = min(a, b)


@inlined
def _roomy(array: Any, size: int) -> Any:
    """`array`, or a longer copy of it if it has no room for `size`."""
    if size <= array.size:
        return array
    longer = np.empty(2 * size, array.dtype)
    for i in range(array.size):
        longer[i] = array[i]
    return longer


@inlined
def _no_groups(most: int) -> Groups:
    """Room for `most` groups, none of them filled."""
    return Groups(np.zeros(most + 1, np.int64), np.zeros(64, np.int64), np.empty(64, np.int64), np.empty(64))


@called
def _append(groups: Groups, g: int, start: Any, items: Any, logw: Any) -> Groups:
    """Fill group g, the first one not filled. `groups` may have to move, so it is returned."""
    h, n = groups.first[g], groups.start[groups.first[g]]
    n_hyps, n_items = logw.size, start[logw.size] - start[0]
    all_start, all_items = _roomy(groups.start, h + n_hyps + 1), _roomy(groups.items, n + n_items)
    all_logw = _roomy(groups.logw, h + n_hyps)
    for i in range(n_hyps):
        all_logw[h + i] = logw[i]
        all_start[h + i + 1] = n + start[i + 1] - start[0]
    for i in range(n_items):
        all_items[n + i] = items[start[0] + i]
    groups.first[g + 1] = h + n_hyps
    return Groups(groups.first, all_start, all_items, all_logw)


@inlined
def _trimmed(groups: Groups, n: int) -> Groups:
    """The n groups that are filled."""
    first, start = groups.first[: n + 1].copy(), groups.start[: groups.first[n] + 1].copy()
    return Groups(first, start, groups.items[: start[first[n]]].copy(), groups.logw[: first[n]].copy())


@inlined
def _widest(start: Any, n: int) -> int:
    wide = 0
    for h in range(n):
        wide = max(wide, start[h + 1] - start[h])
    return wide


@inlined
def _product(
    a_start: Any, a_items: Any, a_logw: Any, b_start: Any, b_items: Any, b_logw: Any, limits: Limits
) -> Any:
    """Hypotheses of two independent groups together, as (start, items, logw): the best pairs.

    Both are sorted, so the pair (i, j) has at least (i + 1)(j + 1) - 1 pairs that are no worse, and the best
    `limits.hypotheses` pairs lie under that hyperbola.
    """
    most, rows = limits.hypotheses, min(a_logw.size, limits.hypotheses)
    bound = 0
    for i in range(rows):
        bound += min(b_logw.size, most // (i + 1))
    logw, left, right = np.empty(bound), np.empty(bound, np.int64), np.empty(bound, np.int64)
    count = 0
    for i in range(rows):
        for j in range(min(b_logw.size, most // (i + 1))):
            w = a_logw[i] + b_logw[j]
            if w < a_logw[0] + b_logw[0] + limits.log_prune:
                break
            logw[count], left[count], right[count] = w, i, j
            count += 1
    order, n = greatest_first(logw, count), min(count, most)
    out_start, out_logw = np.zeros(n + 1, np.int64), np.empty(n)
    out_items = np.empty(n * (_widest(a_start, a_logw.size) + _widest(b_start, b_logw.size)), np.int64)
    total, size = 0.0, 0
    for h in range(n):
        i, j = left[order[h]], right[order[h]]
        for k in range(a_start[i], a_start[i + 1]):
            out_items[size] = a_items[k]
            size += 1
        for k in range(b_start[j], b_start[j + 1]):
            out_items[size] = b_items[k]
            size += 1
        out_start[h + 1], out_logw[h] = size, logw[order[h]]
        total += math.exp(out_logw[h])
    for h in range(n):
        out_logw[h] -= math.log(total)
    return out_start, out_items, out_logw


@kernel
def meet(groups: Groups, options: Options, n_detections: int, limits: Limits) -> Any:
    """Unite the groups that have a detection in common among their tracks' options."""
    first, start, items, logw = groups.first, groups.start, groups.items, groups.logw
    n_groups = first.size - 1
    parent, follower, last = (
        np.empty(n_groups, np.int64),
        np.empty(n_groups, np.int64),
        np.empty(n_groups, np.int64),
    )
    owner, visited = np.empty(n_detections, np.int64), np.zeros(options.start.size - 1, np.bool_)
    owner[:] = -1
    for g in range(n_groups):
        parent[g] = g
        for i in range(start[first[g]], start[first[g + 1]]):
            t = items[i]
            if visited[t]:
                continue
            visited[t] = True
            for o in range(options.start[t], options.start[t + 1]):
                j = options.meas[o]
                if j >= 0 and owner[j] < 0:
                    owner[j] = g
                elif j >= 0:
                    _join(parent, owner[j], g)
    # A chain from each root through the groups that it is united with, in their order.
    for g in range(n_groups):
        root = _root(parent, g)
        follower[g], last[g] = -1, g
        if root != g:
            follower[last[root]], last[root] = g, g
    out, count = _no_groups(n_groups), np.int64(0)
    for g in range(n_groups):
        if parent[g] != g:
            continue
        low, high, other = first[g], first[g + 1], follower[g]
        a_start, a_items, a_logw = start[low : high + 1], items, logw[low:high]
        while other >= 0:
            low, high = first[other], first[other + 1]
            a_start, a_items, a_logw = _product(
                a_start, a_items, a_logw, start[low : high + 1], items, logw[low:high], limits
            )
            other = follower[other]
        out = _append(out, count, a_start, a_items, a_logw)
        count += 1
    return _trimmed(out, count)


@inlined
def _choices(groups: Groups, g: int, item_label: Any, weight: Any, n_labels: int) -> Any:
    """Which track each label has in each hypothesis, numbered from 1 (0: none), and their probabilities.

    Shapes (hypotheses, n_labels), (n_labels, most tracks of a label + 1), and how many tracks each label has.
    """
    start, items = groups.start, groups.items
    low, begin = groups.first[g], groups.start[groups.first[g]]
    n_hyps, n_items = groups.first[g + 1] - low, groups.start[groups.first[g + 1]] - begin
    key, number, used = (
        np.empty(n_items, np.uint64),
        np.empty(n_items, np.int64),
        np.zeros(n_labels, np.int64),
    )
    for i in range(n_items):
        key[i] = ~np.uint64(items[begin + i])
    by_item, most = greatest_first(key, n_items), 0
    for k in range(n_items):
        i = by_item[k]
        if k == 0 or key[i] != key[by_item[k - 1]]:
            used[item_label[begin + i]] += 1
        number[i] = used[item_label[begin + i]]
        most = max(most, number[i])
    choice, marginal = np.zeros((n_hyps, n_labels), np.int64), np.zeros((n_labels, most + 1))
    for h in range(n_hyps):
        for i in range(start[low + h], start[low + h + 1]):
            choice[h, item_label[i]] = number[i - begin]
        for p in range(n_labels):
            marginal[p, choice[h, p]] += weight[low + h]
    return choice, marginal, used


@inlined
def _dependent(
    choice: Any, marginal: Any, used: Any, weight: Any, low: int, p: int, q: int, bound: float
) -> bool:
    """Whether labels p and q are further than `bound` (total variation) from being independent.

    If one of them is almost sure of its option, it cannot be: the distance is at most 2 (1 - its
    probability).
    """
    surest = 0.0
    for a in range(marginal.shape[1]):
        surest = max(surest, marginal[p, a], marginal[q, a])
    if 2.0 * (1.0 - min(1.0, surest)) < bound:
        return False
    joint = np.zeros((used[p] + 1, used[q] + 1))
    for h in range(choice.shape[0]):
        joint[choice[h, p], choice[h, q]] += weight[low + h]
    distance = 0.0
    for a in range(used[p] + 1):
        for b in range(used[q] + 1):
            distance += abs(joint[a, b] - marginal[p, a] * marginal[q, b])
    return 0.5 * distance > bound


@inlined
def _marginal(groups: Groups, g: int, item_label: Any, parent: Any, root: int, keys: Any) -> Any:
    """Hypotheses over the labels of `root` alone, (start, items, logw); those that become equal are one."""
    first, start, items = groups.first, groups.start, groups.items
    key = np.zeros(first[g + 1] - first[g], np.uint64)
    for h in range(first[g], first[g + 1]):
        for i in range(start[h], start[h + 1]):
            if parent[item_label[i]] == root:
                key[h - first[g]] -= keys[items[i]]
    which, weight = distinct(key, groups.logw, first[g])
    n, size = which.size, 0
    out_start, out_logw = np.zeros(n + 1, np.int64), np.empty(n)
    out_items = np.empty(start[first[g + 1]] - start[first[g]], np.int64)
    for k in range(n):
        for i in range(start[which[k]], start[which[k] + 1]):
            if parent[item_label[i]] == root:
                out_items[size] = items[i]
                size += 1
        out_start[k + 1], out_logw[k] = size, math.log(weight[k])
    return out_start, out_items, out_logw


@kernel
def part(groups: Groups, track_label: Any, n_labels: int, keys: Any, limits: Limits) -> Any:
    """Split every group into groups of dependent labels, without the labels not worth keeping."""
    first, start, items, logw = groups.first, groups.start, groups.items, groups.logw
    out, count = _no_groups(n_labels), np.int64(0)
    weight, item_label = np.empty(logw.size), np.empty(items.size, np.int64)
    local, label, parent = (
        np.empty(n_labels, np.int64),
        np.empty(n_labels, np.int64),
        np.empty(n_labels, np.int64),
    )
    local[:] = -1
    for h in range(logw.size):
        weight[h] = math.exp(logw[h])
    for g in range(first.size - 1):
        low, high = first[g], first[g + 1]
        n = 0
        for i in range(start[low], start[high]):
            at = track_label[items[i]]
            if local[at] < 0:
                local[at], label[n] = n, at
                n += 1
            item_label[i] = local[at]
        choice, marginal, used = _choices(groups, g, item_label, weight, n)
        for p in range(n):
            local[label[p]] = -1
            parent[p] = p if 1.0 - marginal[p, 0] >= limits.existence else -1
        for p in range(n):
            for q in range(p + 1, n):
                if (
                    parent[p] >= 0
                    and parent[q] >= 0
                    and _root(parent, p) != _root(parent, q)
                    and _dependent(choice, marginal, used, weight, low, p, q, limits.dependence)
                ):
                    _join(parent, p, q)
        for p in range(n):
            if parent[p] >= 0:
                parent[p] = _root(parent, p)
        for root in range(n):
            if parent[root] != root:
                continue
            members = 0
            for p in range(n):
                members += parent[p] == root
            if members == n:
                out = _append(out, count, start[low : high + 1], items, logw[low:high])
            else:
                m_start, m_items, m_logw = _marginal(groups, g, item_label, parent, root, keys)
                out = _append(out, count, m_start, m_items, m_logw)
            count += 1
    return _trimmed(out, count)


@kernel
def renumber(groups: Groups, n_options: int) -> tuple[Groups, Any]:
    """Items 0, 1, 2 ... for the options in use, in their order; also returns which options those are."""
    number, used = np.zeros(n_options, np.int64), np.empty(n_options, np.int64)
    items = np.empty(groups.items.size, np.int64)
    for i in range(items.size):
        number[groups.items[i]] = 1
    count = 0
    for o in range(n_options):
        if number[o]:
            number[o], used[count] = count, o
            count += 1
    for i in range(items.size):
        items[i] = number[groups.items[i]]
    return Groups(groups.first, groups.start, items, groups.logw), used[:count].copy()
