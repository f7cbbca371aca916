"""Compiled summaries of the groups: who is there, how probably, and how many.

Groups are independent, so existence adds up within a group, and the distributions of the groups' numbers of
objects convolve.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf
from gcs.tracking.glmb.hypotheses import Clusters
from gcs.tracking.numerics.fast_math import exponentials
from gcs.tracking.numerics.sorting import head

if TYPE_CHECKING:
    from gcs.model import FloatArray

_TAIL = 1e-15


@inlined
def _reference(groups: Clusters, g: int, track_label: Any, existence: FloatArray) -> Any:
    """Return the hypothesis of group g that shows its likely labels (existence above 1/2).

    The most probable one of those that hold the most of them. Each label's own best hypothesis would not do:
    when it is open which of two labels is where, both would be shown at one place.
    """
    first, start, items = groups.first, groups.start, groups.items
    chosen, most = first[g], -1
    for h in range(first[g], first[g + 1]):
        likely = 0
        for i in range(start[h], start[h + 1]):
            if existence[track_label[items[i]]] > 0.5:
                likely += 1
        if likely > most:
            chosen, most = h, likely
    return chosen


@inlined
def _weigh_sizes(groups: Clusters, g: int, chance: FloatArray, weight: FloatArray) -> int:
    """Fill `weight` with the probability of each number of objects of group g; return the greatest number.

    `chance` is that of each hypothesis, `weight` 0 up to there.
    """
    widest = 0
    for h in range(groups.first[g], groups.first[g + 1]):
        size = groups.start[h + 1] - groups.start[h]
        widest = max(widest, size)
        weight[size] += chance[h]
    return widest


@inlined
def _likeliest(groups: Clusters, g: int, weight: FloatArray, widest: int) -> Any:
    """Return the best hypothesis of the most probable number of objects of group g."""
    size = 0
    for k in range(1, widest + 1):
        if weight[k] > weight[size]:
            size = k
    h = groups.first[g]
    while groups.start[h + 1] - groups.start[h] != size:
        h += 1
    return h


@inlined
def _convolve(
    old: FloatArray, new: FloatArray, least: int, most: int, weight: FloatArray, widest: int
) -> None:
    """Put the convolution of `old`, which is `least` to `most`, with `weight`, 0 to `widest`, into `new`."""
    if widest == 1:
        w0, w1, n = weight[0], weight[1], most - least
        new[least], new[most + 1] = w0 * old[least], w1 * old[most]
        lower, upper, to = old[least:most], old[least + 1 : most + 1], new[least + 1 : most + 1]
        for k in range(n):
            to[k] = w0 * upper[k] + w1 * lower[k]
        return
    for k in range(least, most + widest + 1):
        new[k] = 0.0
    for size in range(widest + 1):
        if weight[size] > 0.0:
            for k in range(least, most + 1):
                new[k + size] += weight[size] * old[k]


class Summary(NamedTuple):
    """What the groups say of labels and tracks."""

    existence: Any
    """(labels,)."""
    shown: Any
    """(labels,) the track of each that its group's reference hypothesis holds, or else the best that does."""
    estimated: Any
    """The tracks that are in the MAP-cardinality estimate, as `map_tracks` finds them."""
    cardinality: Any
    """(labels + 1,) probability of each number of objects."""
    probability: Any
    """(tracks,)."""


@leaf
def _sum_up(
    groups: Clusters, track_label: Any, weight: FloatArray, other: FloatArray, chance: Any, out: Summary
) -> Any:
    """Fill `out`; `weight` (labels + 1,) is 0, `other` as well and takes turns with `out.cardinality`.

    Returns how many tracks are estimated.
    """
    first, start, items = groups.first, groups.start, groups.items
    # `least` to `most` objects are all that is probable so far; the tails left out are below 1e-12.
    n = least = most = ZERO
    before, after = out.cardinality, other
    before[0] = 1.0
    exponentials(groups.logw, chance)
    for g in range(first.size - 1):
        low, high, widest = first[g], first[g + 1], ZERO
        for h in range(low, high):
            w = chance[h]
            widest = max(widest, start[h + 1] - start[h])
            weight[start[h + 1] - start[h]] += w
            for i in range(start[h], start[h + 1]):
                out.probability[items[i]] += w
                out.existence[track_label[items[i]]] += w
        _convolve(before, after, least, most, weight, widest)
        most += widest
        while least < most and after[least] < _TAIL:
            after[least] = 0.0
            least += 1
        while most > least and after[most] < _TAIL:
            after[most] = 0.0
            most -= 1
        before, after = after, before
        reference = low if high == low + 1 else _reference(groups, g, track_label, out.existence)
        for i in range(start[reference], start[reference + 1]):
            out.shown[track_label[items[i]]] = items[i]
        for i in range(start[low], start[high]):
            if out.shown[track_label[items[i]]] < 0:
                out.shown[track_label[items[i]]] = items[i]
        best = _likeliest(groups, g, weight, widest)
        for i in range(start[best], start[best + 1]):
            out.estimated[n] = items[i]
            n += 1
        for size in range(widest + 1):
            weight[size] = 0.0
    for i in range(out.existence.size):
        out.existence[i] = min(out.existence[i], 1.0)
    for k in range(before.size):
        if not least <= k <= most:
            before[k] = 0.0
    return n


@inlined
def summary(groups: Clusters, track_label: Any, n_labels: int) -> Summary:
    """Sum up what the groups believe."""
    existence, probability = np.zeros(n_labels), np.zeros(track_label.size)
    shown, estimated = np.empty(n_labels, np.int64), np.empty(n_labels, np.int64)
    even, odd = np.zeros(n_labels + 1), np.zeros(n_labels + 1)
    shown[:] = -1
    out = Summary(existence, shown, estimated, even, probability)
    n = _sum_up(groups, track_label, np.zeros(n_labels + 1), odd, np.empty(groups.logw.size), out)
    cardinality = even if groups.first.size % 2 == 1 else odd
    return Summary(existence, shown, head(estimated, n), cardinality, probability)


@kernel
def probabilities(groups: Clusters, n_tracks: int) -> Any:
    """Probability of each track: that of the hypotheses that hold it."""
    probability, chance = np.zeros(n_tracks), np.empty(groups.logw.size)
    exponentials(groups.logw, chance)
    for h in range(groups.logw.size):
        for i in range(groups.start[h], groups.start[h + 1]):
            probability[groups.items[i]] += chance[h]
    return probability


@kernel
def map_tracks(groups: Clusters) -> Any:
    """Tracks of the best hypothesis of each group's most probable number of objects."""
    chosen, n = np.empty(groups.items.size, np.int64), ZERO
    weight, chance = np.zeros(groups.items.size + 1), np.empty(groups.logw.size)
    exponentials(groups.logw, chance)
    for g in range(groups.first.size - 1):
        widest = _weigh_sizes(groups, g, chance, weight)
        best = _likeliest(groups, g, weight, widest)
        for i in range(groups.start[best], groups.start[best + 1]):
            chosen[n] = groups.items[i]
            n += 1
        for size in range(widest + 1):
            weight[size] = 0.0
    return head(chosen, n)
