"""Compiled parting: after a scan's update, labels that no longer depend on each other go on apart.

Labels too improbable to matter are forgotten, and labels whose joint distribution is the product of their
marginals, within a bound on total variation, go on as groups of their own. The test looks at pairs. It asks
about the density itself, not about distance: two labels that once crossed stay together for as long as it is
open who is who.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf, spliced
from gcs.tracking.glmb.hypotheses import Clusters, Limits, filled, key_of, room_for_groups
from gcs.tracking.numerics.fast_math import exponentials
from gcs.tracking.numerics.sorting import Distinct, distinct, head, rank, room_for_distinct


@inlined
def _number(items: Any, begin: int, end: int, item_label: Any, number: Any, used: Any, example: Any) -> int:
    """Number the tracks of each label among the items `begin` to `end` - 1, from 1 on, as they come.

    Fills `number` (of a track, 0 before), `used` (how many a label has) and `example` (where in `items` each
    is found); returns the greatest number.
    """
    most = 0
    for i in range(begin, end):
        if number[items[i]] == 0:
            used[item_label[i]] += 1
            number[items[i]] = used[item_label[i]]
            example[item_label[i], used[item_label[i]]] = i
            most = max(most, used[item_label[i]])
    return most


@inlined
def _dependent(
    choice: Any,
    n_hyps: int,
    marginal: Any,
    used: Any,
    weight: Any,
    low: int,
    p: int,
    q: int,
    joint: Any,
    bound: float,
) -> bool:
    """Whether labels p and q are further than `bound` (total variation) from being independent.

    `joint` is scratch, as great as any two labels need. It is two tables, taken in turns: most hypotheses add
    to the same few places, and would wait for each other.
    """
    for a in range(used[p] + 1):
        for b in range(used[q] + 1):
            joint[0, a, b] = joint[1, a, b] = 0.0
    for h in range(0, n_hyps - 1, 2):
        joint[0, choice[h, p], choice[h, q]] += weight[low + h]
        joint[1, choice[h + 1, p], choice[h + 1, q]] += weight[low + h + 1]
    if n_hyps % 2 == 1:
        joint[0, choice[n_hyps - 1, p], choice[n_hyps - 1, q]] += weight[low + n_hyps - 1]
    distance = 0.0
    for a in range(used[p] + 1):
        for b in range(used[q] + 1):
            distance += abs(joint[0, a, b] + joint[1, a, b] - marginal[p, a] * marginal[q, b])
    return 0.5 * distance > bound


class _Numbers(NamedTuple):
    """Where `_label` puts its numbers."""

    item_label: Any
    local: Any


class _Parting(NamedTuple):
    """Room to part the labels of one group."""

    used: Any
    """(labels,) how many tracks each has."""
    choice: Any
    """(hypotheses, labels) which of them it has in each hypothesis, 0 for none."""
    marginal: Any
    """(labels, tracks) probability of that."""
    example: Any
    """(labels, tracks) where among the items each of them is found."""
    joint: Any
    """(2, tracks, tracks)."""
    open: Any
    """(labels,) whether it may depend on others."""
    set_of: Any
    """(labels,) the first label of the set that each goes on in, or -1 for none."""
    item_label: Any
    """(items of all groups,) number of the label in its group."""
    local: Any
    """(all labels,) that number, -1 elsewhere."""
    number: Any
    """(all tracks,) number of the track in its label, from 1 on."""
    weight: Any
    """(all hypotheses,) probability."""
    same: Distinct


@spliced
def _split(groups: Clusters, g: int, n: int, limits: Limits, work: _Parting) -> None:
    """Fill `work.set_of` for the n labels of group g."""
    start, low, high = groups.start, groups.first[g], groups.first[g + 1]
    choice, marginal, used, set_of, open_ = work.choice, work.marginal, work.used, work.set_of, work.open
    for p in range(n):
        used[p] = 0
    most = _number(groups.items, start[low], start[high], work.item_label, work.number, used, work.example)
    for p in range(n):
        for a in range(most + 1):
            marginal[p, a] = 0.0
    for h in range(low, high):
        for p in range(n):
            choice[h - low, p] = 0
        for i in range(start[h], start[h + 1]):
            choice[h - low, work.item_label[i]] = work.number[groups.items[i]]
        for p in range(n):
            marginal[p, choice[h - low, p]] += work.weight[h]
    # A label that is almost sure of its track depends on nobody: it is at most 2 (1 - its probability) away.
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
                and _dependent(
                    choice, high - low, marginal, used, work.weight, low, p, q, work.joint, limits.dependence
                )
            ):
                a, b = set_of[p], set_of[q]
                for r in range(n):
                    if set_of[r] == max(a, b):
                        set_of[r] = min(a, b)


@inlined
def _one(p: int, work: _Parting) -> int:
    """Put the tracks of label p into `work.same`, as items, and that it is absent, as -1; return how many."""
    same, count = work.same, ZERO
    for a in range(work.used[p] + 1):
        if work.marginal[p, a] > 0.0:
            same.weight[count] = work.marginal[p, a]
            same.example[count] = work.example[p, a] if a > 0 else -1
            count += 1
    rank(count, same)
    return count


@inlined
def _several(groups: Clusters, g: int, p: int, work: _Parting) -> Any:
    """Put the hypotheses of group g over the labels of set p alone into `work.same`, equal ones as one.

    Returns how many.
    """
    low, high, same = groups.first[g], groups.first[g + 1], work.same
    for h in range(low, high):
        key = np.uint64(0)
        for i in range(groups.start[h], groups.start[h + 1]):
            if work.set_of[work.item_label[i]] == p:
                key += key_of(groups.items[i])
        same.key[h - low] = key
    return distinct(high - low, work.weight, low, same)


@leaf
def _label(groups: Clusters, g: int, track_label: Any, work: _Parting) -> Any:
    """Number the labels of group g as they come; return how many."""
    items, begin, end = groups.items, groups.start[groups.first[g]], groups.start[groups.first[g + 1]]
    n = 0
    for i in range(begin, end):
        label = track_label[items[i]]
        if work.local[label] < 0:
            work.local[label] = n
            n += 1
        work.item_label[i] = work.local[label]
    return n


@leaf
def _survey(groups: Clusters, track_label: Any, work: Any) -> Any:
    """Return the most labels and hypotheses of a group, the most tracks of a label, and hypotheses in all."""
    labels, hyps, tracks, run, room = 1, 1, 1, 0, 0
    for t in range(track_label.size):
        run = run + 1 if t > 0 and track_label[t] == track_label[t - 1] else 1
        tracks = max(tracks, run)
    for g in range(groups.first.size - 1):
        count, n = groups.first[g + 1] - groups.first[g], _label(groups, g, track_label, work)
        labels, hyps, room = max(labels, n), max(hyps, count), room + n * count
    return labels, hyps, tracks, room


@leaf
def _parted(groups: Clusters, limits: Limits, work: _Parting, out: Clusters) -> Any:
    """Fill `out` with the groups that go on; return how many, and how many hypotheses."""
    first, start, items = groups.first, groups.start, groups.items
    count, n_hyps, size = 0, 0, 0
    out.first[0] = out.start[0] = 0
    exponentials(groups.logw, work.weight)
    for g in range(first.size - 1):
        n = ZERO
        for i in range(start[first[g]], start[first[g + 1]]):
            n = max(n, work.item_label[i] + 1)
        _split(groups, g, n, limits, work)
        for p in range(n):
            members = 0
            for q in range(n):
                members += work.set_of[q] == p
            if members == 0:
                continue
            if members == n:
                for h in range(first[g], first[g + 1]):
                    for i in range(start[h], start[h + 1]):
                        out.items[size] = items[i]
                        size += 1
                    out.logw[n_hyps], out.start[n_hyps + 1] = groups.logw[h], size
                    n_hyps += 1
            elif members == 1:
                for k in range(_one(p, work)):
                    if work.same.which[k] >= 0:
                        out.items[size] = items[work.same.which[k]]
                        size += 1
                    out.logw[n_hyps], out.start[n_hyps + 1] = work.same.logw[k], size
                    n_hyps += 1
            else:
                for k in range(_several(groups, g, p, work)):
                    h = work.same.which[k]
                    for i in range(start[h], start[h + 1]):
                        if work.set_of[work.item_label[i]] == p:
                            out.items[size] = items[i]
                            size += 1
                    out.logw[n_hyps], out.start[n_hyps + 1] = work.same.logw[k], size
                    n_hyps += 1
            count += 1
            out.first[count] = n_hyps
    return count, n_hyps


@kernel
def part(groups: Clusters, track_label: Any, n_labels: int, limits: Limits) -> Any:
    """Split every group into groups of dependent labels, without the labels not worth keeping."""
    item_label, local = np.empty(groups.items.size, np.int64), np.empty(n_labels, np.int64)
    number, weight = np.zeros(track_label.size, np.int64), np.empty(groups.logw.size)
    local[:] = -1
    labels, hyps, tracks, room = _survey(groups, track_label, _Numbers(item_label, local))
    work = _Parting(
        np.empty(labels, np.int64),
        np.empty((hyps, labels), np.int64),
        np.empty((labels, tracks + 1)),
        np.empty((labels, tracks + 1), np.int64),
        np.empty((2, tracks + 1, tracks + 1)),
        np.empty(labels, np.bool_),
        np.empty(labels, np.int64),
        item_label,
        local,
        number,
        weight,
        room_for_distinct(hyps),
    )
    # A label is in one group, and at most a group of its own then.
    out = room_for_groups(n_labels, room, groups.items.size)
    count, n = _parted(groups, limits, work, out)
    return filled(out, count, n)


@leaf
def _renumber(old: Any, number: Any, used: Any, items: Any) -> int:
    for i in range(old.size):
        number[old[i]] = 1
    count = 0
    for o in range(number.size):
        if number[o]:
            number[o], used[count] = count, o
            count += 1
    for i in range(items.size):
        items[i] = number[old[i]]
    return count


@kernel
def renumber(groups: Clusters, n_options: int) -> tuple[Clusters, Any]:
    """Items 0, 1, 2 ... for the options in use, in their order; also returns which options those are."""
    number, used = np.zeros(n_options, np.int64), np.empty(n_options, np.int64)
    items = np.empty(groups.items.size, np.int64)
    count = _renumber(groups.items, number, used, items)
    return Clusters(groups.first, groups.start, items, groups.logw), head(used, count)
