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

import numba
import numpy as np

from gcs.tracking.hypotheses import Groups, Limits, Options

njit = numba.njit(nogil=True, cache=True, error_model="numpy")


@njit
def _root(parent: Any, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit
def _join(parent: Any, i: int, j: int) -> None:
    """Unite two sets; the smaller index stays the root, so that order does not depend on history."""
    i, j = _root(parent, i), _root(parent, j)
    parent[max(i, j)] = min(i, j)


@njit
def _flat(parts: Any) -> Groups:
    """One flat record of a list of groups (logw, start, items)."""
    n_hyps, n_items = 0, 0
    for logw, _, items in parts:
        n_hyps += logw.size
        n_items += items.size
    first, start = np.zeros(len(parts) + 1, np.int64), np.zeros(n_hyps + 1, np.int64)
    all_items, all_logw = np.empty(n_items, np.int64), np.empty(n_hyps)
    h, n = 0, 0
    for g in range(len(parts)):
        logw, begin, items = parts[g]
        all_logw[h : h + logw.size] = logw
        start[h + 1 : h + logw.size + 1] = n + begin[1:]
        all_items[n : n + items.size] = items
        h += logw.size
        n += items.size
        first[g + 1] = h
    return Groups(first, start, all_items, all_logw)


@njit
def _group(groups: Groups, g: int) -> Any:
    """Group g as (logw, start, items)."""
    low, high = groups.first[g], groups.first[g + 1]
    begin, end = groups.start[low], groups.start[high]
    return groups.logw[low:high].copy(), groups.start[low : high + 1] - begin, groups.items[begin:end].copy()


@njit
def _product(a: Any, b: Any, most: int, log_prune: float) -> Any:
    """Hypotheses of two independent groups together: the `most` best pairs.

    Both are sorted, so the pair (i, j) has at least (i + 1)(j + 1) - 1 pairs that are no worse, and the best
    `most` pairs lie under that hyperbola.
    """
    (a_logw, a_start, a_items), (b_logw, b_start, b_items) = a, b
    bound = 0
    for i in range(min(a_logw.size, most)):
        bound += min(b_logw.size, most // (i + 1))
    logw, left, right = np.empty(bound), np.empty(bound, np.int64), np.empty(bound, np.int64)
    count = 0
    for i in range(min(a_logw.size, most)):
        for j in range(min(b_logw.size, most // (i + 1))):
            w = a_logw[i] + b_logw[j]
            if w < a_logw[0] + b_logw[0] + log_prune:
                break
            logw[count], left[count], right[count] = w, i, j
            count += 1
    order = np.argsort(-logw[:count], kind="mergesort")[:most]
    out_start = np.zeros(order.size + 1, np.int64)
    out_items = np.empty(order.size * (np.diff(a_start).max() + np.diff(b_start).max()), np.int64)
    for h in range(order.size):
        i, j = left[order[h]], right[order[h]]
        n = out_start[h]
        for k in range(a_start[i], a_start[i + 1]):
            out_items[n] = a_items[k]
            n += 1
        for k in range(b_start[j], b_start[j + 1]):
            out_items[n] = b_items[k]
            n += 1
        out_start[h + 1] = n
    out_logw = logw[order]
    out_logw -= math.log(np.exp(out_logw).sum())
    return out_logw, out_start, out_items[: out_start[-1]].copy()


@njit
def meet(groups: Groups, options: Options, n_detections: int, limits: Limits) -> Any:
    """Unite the groups that have a detection in common among their tracks' options."""
    n_groups = groups.first.size - 1
    parent, owner = np.arange(n_groups), np.full(n_detections, -1)
    visited = np.zeros(options.start.size - 1, np.bool_)
    for g in range(n_groups):
        for t in groups.items[groups.start[groups.first[g]] : groups.start[groups.first[g + 1]]]:
            if visited[t]:
                continue
            visited[t] = True
            for j in options.meas[options.start[t] : options.start[t + 1]]:
                if j >= 0 and owner[j] < 0:
                    owner[j] = g
                elif j >= 0:
                    _join(parent, owner[j], g)
    place = np.full(n_groups, -1)
    parts = [_group(groups, 0) for _ in range(0)]
    for g in range(n_groups):
        root = _root(parent, g)
        if root == g:
            place[g] = len(parts)
            parts.append(_group(groups, g))
        else:
            at = place[root]
            parts[at] = _product(parts[at], _group(groups, g), limits.hypotheses, limits.log_prune)
    return _flat(parts)


@njit
def _dependent(choice: Any, weight: Any, marginal: Any, p: int, q: int, bound: float) -> bool:
    """Whether labels p and q are further than `bound` (total variation) from being independent.

    If one of them is almost sure of its option, it cannot be: the distance is at most 2 (1 - its
    probability).
    """
    if 2.0 * (1.0 - min(1.0, max(marginal[p].max(), marginal[q].max()))) < bound:
        return False
    joint = np.zeros((choice[:, p].max() + 1, choice[:, q].max() + 1))
    for h in range(weight.size):
        joint[choice[h, p], choice[h, q]] += weight[h]
    distance = 0.0
    for a in range(joint.shape[0]):
        for b in range(joint.shape[1]):
            distance += abs(joint[a, b] - marginal[p, a] * marginal[q, b])
    return 0.5 * distance > bound


@njit
def _marginal(group: Any, item_label: Any, keys: Any, member: Any) -> Any:
    """Hypotheses over the labels marked in `member` alone; those that become equal are one."""
    logw, start, items = group
    n = logw.size
    key = np.zeros(n, np.uint64)
    for h in range(n):
        for i in range(start[h], start[h + 1]):
            if member[item_label[i]]:
                key[h] += keys[items[i]]
    by_key = np.argsort(key, kind="mergesort")
    weight, example, count = np.empty(n), np.empty(n, np.int64), 0
    for k in range(n):
        h = by_key[k]
        if k == 0 or key[h] != key[by_key[k - 1]]:
            weight[count], example[count] = 0.0, h
            count += 1
        weight[count - 1] += math.exp(logw[h])
    order = np.argsort(-weight[:count], kind="mergesort")
    out_start, out_items, size = np.zeros(count + 1, np.int64), np.empty(items.size, np.int64), 0
    for k in range(count):
        h = example[order[k]]
        for i in range(start[h], start[h + 1]):
            if member[item_label[i]]:
                out_items[size] = items[i]
                size += 1
        out_start[k + 1] = size
    return np.log(weight[order]), out_start, out_items[:size].copy()


@njit
def _choices(group: Any, item_label: Any, n_labels: int) -> Any:
    """Which track each label has in each hypothesis, numbered from 1 (0: none), and their probabilities."""
    logw, start, items = group
    choice, used = np.zeros((logw.size, n_labels), np.int64), np.zeros(n_labels, np.int64)
    by_item, number = np.argsort(items, kind="mergesort"), np.empty(items.size, np.int64)
    for k in range(items.size):
        i = by_item[k]
        if k == 0 or items[i] != items[by_item[k - 1]]:
            used[item_label[i]] += 1
        number[i] = used[item_label[i]]
    marginal = np.zeros((n_labels, used.max() + 1))
    for h in range(logw.size):
        for i in range(start[h], start[h + 1]):
            choice[h, item_label[i]] = number[i]
        for p in range(n_labels):
            marginal[p, choice[h, p]] += math.exp(logw[h])
    return choice, marginal


@njit
def part(groups: Groups, track_label: Any, n_labels: int, keys: Any, limits: Limits) -> Any:
    """Split every group into groups of dependent labels, without the labels not worth keeping."""
    parts = [_group(groups, 0) for _ in range(0)]
    local = np.full(n_labels, -1)
    for g in range(groups.first.size - 1):
        group = _group(groups, g)
        logw, _, items = group
        item_label, labels = np.empty(items.size, np.int64), np.empty(items.size, np.int64)
        n = 0
        for i in range(items.size):
            label = track_label[items[i]]
            if local[label] < 0:
                local[label], labels[n] = n, label
                n += 1
            item_label[i] = local[label]
        for label in labels[:n]:
            local[label] = -1
        if n == 0:
            continue
        choice, marginal = _choices(group, item_label, n)
        weight, parent = np.exp(logw), np.arange(n)
        kept = 1.0 - marginal[:, 0] >= limits.existence
        for p in range(n):
            for q in range(p + 1, n):
                if (
                    kept[p]
                    and kept[q]
                    and _root(parent, p) != _root(parent, q)
                    and _dependent(choice, weight, marginal, p, q, limits.dependence)
                ):
                    _join(parent, p, q)
        for root in range(n):
            if not kept[root] or parent[root] != root:
                continue
            member = np.zeros(n, np.bool_)
            for p in range(n):
                member[p] = kept[p] and _root(parent, p) == root
            parts.append(group if member.all() else _marginal(group, item_label, keys, member))
    return _flat(parts)


@njit
def renumber(groups: Groups, n_options: int) -> tuple[Groups, Any]:
    """Items 0, 1, 2 ... for the options in use, in their order; also returns which options those are."""
    number = np.full(n_options, -1)
    for o in groups.items:
        number[o] = 0
    used = np.flatnonzero(number == 0)
    for i in range(used.size):
        number[used[i]] = i
    return Groups(groups.first, groups.start, number[groups.items], groups.logw), used
