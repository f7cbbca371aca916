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
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gcs.compiling import inlined, kernel
from gcs.tracking.claims import root_of, unite
from gcs.tracking.hypotheses import Groups, Limits, Options
from gcs.tracking.ordering import distinct, greatest_first, head


@inlined
def _widest(start: Any, low: int, high: int) -> int:
    """Most items of one of the hypotheses `low` to `high` - 1."""
    wide = 0
    for h in range(low, high):
        wide = max(wide, start[h + 1] - start[h])
    return wide


@inlined
def _product(
    start: Any, items: Any, logw: Any, low: int, high: int, groups: Groups, g: int, limits: Limits
) -> Any:
    """Hypotheses `low` to `high` - 1 and those of an independent group g together: the best pairs.

    Both are sorted, so the pair (i, j) has at least (i + 1)(j + 1) - 1 pairs that are no worse, and the best
    `limits.hypotheses` pairs lie under that hyperbola.
    """
    most, rows = limits.hypotheses, min(high - low, limits.hypotheses)
    g_low, columns = groups.first[g], groups.first[g + 1] - groups.first[g]
    bound = 0
    for i in range(rows):
        bound += min(columns, most // (i + 1))
    both, left, right = np.empty(bound), np.empty(bound, np.int64), np.empty(bound, np.int64)
    count, floor = 0, logw[low] + groups.logw[g_low] + limits.log_prune
    for i in range(rows):
        for j in range(min(columns, most // (i + 1))):
            w = logw[low + i] + groups.logw[g_low + j]
            if w < floor:
                break
            both[count], left[count], right[count] = w, low + i, g_low + j
            count += 1
    order, n = greatest_first(both, 0, count), min(count, most)
    wide = _widest(start, low, high) + _widest(groups.start, g_low, g_low + columns)
    out_start, out_items, out_logw = np.zeros(n + 1, np.int64), np.empty(n * wide, np.int64), np.empty(n)
    total, size = 0.0, 0
    for h in range(n):
        a, b = left[order[h]], right[order[h]]
        for i in range(start[a], start[a + 1]):
            out_items[size] = items[i]
            size += 1
        for i in range(groups.start[b], groups.start[b + 1]):
            out_items[size] = groups.items[i]
            size += 1
        out_start[h + 1], out_logw[h] = size, both[order[h]]
        total += math.exp(out_logw[h])
    for h in range(n):
        out_logw[h] -= math.log(total)
    return out_start, out_items, out_logw


@inlined
def _one_label(groups: Groups, g: int, track_label: Any) -> bool:
    begin = groups.start[groups.first[g]]
    for i in range(begin, groups.start[groups.first[g + 1]]):
        if track_label[groups.items[i]] != track_label[groups.items[begin]]:
            return False
    return True


@kernel
def meet(groups: Groups, options: Options, track_label: Any, n_detections: int, limits: Limits) -> Any:
    """Unite the groups whose labels want the same detections (see `claims`).

    Returns which groups are of one label that competes with nobody, and all others, united.
    """
    first, start = groups.first, groups.start
    items, logw = groups.items, groups.logw
    n_groups = first.size - 1
    parent, follower, last = (
        np.empty(n_groups, np.int64),
        np.empty(n_groups, np.int64),
        np.empty(n_groups, np.int64),
    )
    room, wide = np.empty(n_groups, np.int64), np.empty(n_groups, np.int64)
    unite(groups, options, track_label, n_detections, limits.conflict, parent)
    # From each root a chain through the groups that it is united with, in their order; and the union's size.
    for g in range(n_groups):
        root = root_of(parent, g)
        parent[g], follower[g], last[g] = root, -1, g
        room[g], wide[g] = first[g + 1] - first[g], _widest(start, first[g], first[g + 1])
        if root != g:
            follower[last[root]], last[root] = g, g
            room[root] = min(room[root] * room[g], limits.hypotheses)
            wide[root] += wide[g]
    n_hyps, n_items = 0, 0
    alone, n_alone = np.empty(n_groups, np.int64), 0
    for g in range(n_groups):
        if parent[g] == g and follower[g] < 0 and _one_label(groups, g, track_label):
            alone[n_alone], parent[g] = g, -1
            n_alone += 1
        if parent[g] == g:
            n_hyps += room[g]
            n_items += room[g] * wide[g]
    out_first, out_start = np.zeros(n_groups + 1, np.int64), np.zeros(n_hyps + 1, np.int64)
    out_items, out_logw = np.empty(n_items, np.int64), np.empty(n_hyps)
    count, n = 0, 0
    for g in range(n_groups):
        if parent[g] != g:
            continue
        low, high, other = first[g], first[g + 1], follower[g]
        u_start, u_items, u_logw = start, items, logw
        while other >= 0:
            u_start, u_items, u_logw = _product(u_start, u_items, u_logw, low, high, groups, other, limits)
            low, high, other = 0, u_logw.size, follower[other]
        for h in range(low, high):
            out_logw[n], size = u_logw[h], out_start[n]
            for i in range(u_start[h], u_start[h + 1]):
                out_items[size] = u_items[i]
                size += 1
            n += 1
            out_start[n] = size
        count += 1
        out_first[count] = n
    united = Groups(
        head(out_first, count + 1), head(out_start, n + 1), head(out_items, out_start[n]), head(out_logw, n)
    )
    return head(alone, n_alone), united


@inlined
def _number(items: Any, begin: int, end: int, item_label: Any, number: Any, used: Any) -> int:
    """Number the tracks of each label among the items `begin` to `end` - 1, from 1 on, as they come.

    Fills `number` (of a track, 0 before) and `used` (how many a label has); returns the greatest number.
    """
    most = 0
    for i in range(begin, end):
        if number[items[i]] == 0:
            used[item_label[i]] += 1
            number[items[i]] = used[item_label[i]]
            most = max(most, used[item_label[i]])
    return most


@inlined
def _dependent(
    choice: Any, marginal: Any, used: Any, weight: Any, low: int, p: int, q: int, joint: Any, bound: float
) -> bool:
    """Whether labels p and q are further than `bound` (total variation) from being independent.

    `joint` is scratch, as great as any two labels need.
    """
    for a in range(used[p] + 1):
        for b in range(used[q] + 1):
            joint[a, b] = 0.0
    for h in range(choice.shape[0]):
        joint[choice[h, p], choice[h, q]] += weight[low + h]
    distance = 0.0
    for a in range(used[p] + 1):
        for b in range(used[q] + 1):
            distance += abs(joint[a, b] - marginal[p, a] * marginal[q, b])
    return 0.5 * distance > bound


@inlined
def _split(
    groups: Groups, g: int, item_label: Any, number: Any, weight: Any, set_of: Any, n: int, limits: Limits
) -> None:
    """Fill `set_of` (n,) with what set each label of group g goes on in: its first label, or -1 for none."""
    start, low, high = groups.start, groups.first[g], groups.first[g + 1]
    used = np.zeros(n, np.int64)
    most = _number(groups.items, start[low], start[high], item_label, number, used)
    # Which track each label has in each hypothesis (0: none), and the probability of that.
    choice, marginal = np.empty((high - low, n), np.int64), np.zeros((n, most + 1))
    for h in range(low, high):
        for p in range(n):
            choice[h - low, p] = 0
        for i in range(start[h], start[h + 1]):
            choice[h - low, item_label[i]] = number[groups.items[i]]
        for p in range(n):
            marginal[p, choice[h - low, p]] += weight[h]
    # A label that is almost sure of its track depends on nobody: it is at most 2 (1 - its probability) away.
    open_, joint = np.empty(n, np.bool_), np.empty((most + 1, most + 1))
    for p in range(n):
        set_of[p] = p if 1.0 - marginal[p, 0] >= limits.existence else -1
        surest = 0.0
        for a in range(used[p] + 1):
            surest = max(surest, marginal[p, a])
        open_[p] = set_of[p] >= 0 and 2.0 * (1.0 - surest) >= limits.dependence
    for p in range(n):
        if not open_[p]:
            continue
        for q in range(p + 1, n):
            if (
                open_[q]
                and set_of[p] != set_of[q]
                and _dependent(choice, marginal, used, weight, low, p, q, joint, limits.dependence)
            ):
                a, b = set_of[p], set_of[q]
                for r in range(n):
                    if set_of[r] == max(a, b):
                        set_of[r] = min(a, b)


@inlined
def _marginal(groups: Groups, g: int, item_label: Any, set_of: Any, p: int, n: int, keys: Any) -> Any:
    """Hypotheses of group g over the labels of set p alone, those that become equal as one.

    Returns which hypotheses hold them, and their log-weights. `item_label` numbers the group's labels 0 to
    n - 1.
    """
    low, high = groups.first[g], groups.first[g + 1]
    which, logw = np.empty(high - low, np.int64), np.empty(high - low)
    key = np.empty(high - low, np.uint64)
    others = 0
    for q in range(n):
        others += set_of[q] != p
    for h in range(low, high):
        which[h - low], logw[h - low], key[h - low] = h, groups.logw[h], 0
        for i in range(groups.start[h], groups.start[h + 1]):
            if set_of[item_label[i]] == p:
                key[h - low] += keys[groups.items[i]]
    if others > 0:
        which, logw = distinct(key, groups.logw, low)
    return which, logw


@kernel
def part(groups: Groups, track_label: Any, n_labels: int, keys: Any, limits: Limits) -> Any:
    """Split every group into groups of dependent labels, without the labels not worth keeping."""
    first, start, items = groups.first, groups.start, groups.items
    weight, most = np.empty(groups.logw.size), 0
    for g in range(first.size - 1):
        most = max(most, first[g + 1] - first[g])
        for h in range(first[g], first[g + 1]):
            weight[h] = math.exp(groups.logw[h])
    # A label is in one group, and at most a group of its own then.
    out_first, out_start = np.zeros(n_labels + 1, np.int64), np.empty(most * n_labels + 1, np.int64)
    out_items, out_logw = np.empty(items.size, np.int64), np.empty(most * n_labels)
    local, set_of = np.empty(n_labels, np.int64), np.empty(n_labels, np.int64)
    most_item = -1
    for i in range(items.size):
        most_item = max(most_item, items[i])
    item_label, number = np.empty(items.size, np.int64), np.zeros(most_item + 1, np.int64)
    local[:] = -1
    out_start[0], count, h_out, size = 0, 0, 0, 0
    for g in range(first.size - 1):
        n = 0
        for i in range(start[first[g]], start[first[g + 1]]):
            label = track_label[items[i]]
            if local[label] < 0:
                local[label] = n
                n += 1
            item_label[i] = local[label]
        _split(groups, g, item_label, number, weight, set_of, n, limits)
        for p in range(n):
            if set_of[p] != p:
                continue
            which, logw = _marginal(groups, g, item_label, set_of, p, n, keys)
            for k in range(which.size):
                for i in range(start[which[k]], start[which[k] + 1]):
                    if set_of[item_label[i]] == p:
                        out_items[size] = items[i]
                        size += 1
                out_logw[h_out] = logw[k]
                h_out += 1
                out_start[h_out] = size
            count += 1
            out_first[count] = h_out
    return Groups(
        head(out_first, count + 1), head(out_start, h_out + 1), head(out_items, size), head(out_logw, h_out)
    )


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
    return Groups(groups.first, groups.start, items, groups.logw), head(used, count)
