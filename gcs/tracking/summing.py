"""Compiled summaries of the groups: who is there, how probably, and how many.

Groups are independent, so existence adds up within a group, and the distributions of the groups' numbers of
objects convolve.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.compiling import ZERO, inlined, kernel
from gcs.tracking.hypotheses import Groups
from gcs.tracking.ordering import head

if TYPE_CHECKING:
    from gcs.model import FloatArray

_TAIL = 1e-15


@inlined
def _reference(groups: Groups, g: int, track_label: Any, existence: FloatArray) -> Any:
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
def _weigh_sizes(groups: Groups, g: int, weight: FloatArray) -> int:
    """Fill `weight` with the probability of each number of objects of group g; return the greatest number.

    `weight` must be 0 up to there.
    """
    widest = 0
    for h in range(groups.first[g], groups.first[g + 1]):
        size = groups.start[h + 1] - groups.start[h]
        widest = max(widest, size)
        weight[size] += math.exp(groups.logw[h])
    return widest


@inlined
def _likeliest(groups: Groups, g: int, weight: FloatArray, widest: int) -> Any:
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


@kernel
def summary(groups: Groups, track_label: Any, n_labels: int) -> tuple[FloatArray, Any, Any, FloatArray]:
    """Existence of each label, the track that shows it, `map_tracks`, and the number's distribution.

    Shapes (n_labels,), (n_labels,), (estimated,), (n_labels + 1,). A label's track is that of its group's
    reference hypothesis, or of the best that holds the label.
    """
    first, start, items = groups.first, groups.start, groups.items
    existence, shown = np.zeros(n_labels), np.empty(n_labels, np.int64)
    chosen, n = np.empty(n_labels, np.int64), ZERO
    cardinality, convolved = np.zeros(n_labels + 1), np.zeros(n_labels + 1)
    shown[:] = -1
    # `least` to `most` objects are all that is probable so far; the tails left out are below 1e-12.
    cardinality[0], least, most = 1.0, 0, 0
    size_weight = np.zeros(n_labels + 1)
    for g in range(first.size - 1):
        low, high = first[g], first[g + 1]
        widest = _weigh_sizes(groups, g, size_weight)
        for h in range(low, high):
            if start[h] < start[h + 1]:
                w = math.exp(groups.logw[h])
                for i in range(start[h], start[h + 1]):
                    existence[track_label[items[i]]] += w
        _convolve(cardinality, convolved, least, most, size_weight, widest)
        most += widest
        while least < most and convolved[least] < _TAIL:
            convolved[least] = 0.0
            least += 1
        while most > least and convolved[most] < _TAIL:
            convolved[most] = 0.0
            most -= 1
        cardinality, convolved = convolved, cardinality
        reference = low if high == low + 1 else _reference(groups, g, track_label, existence)
        for i in range(start[reference], start[reference + 1]):
            shown[track_label[items[i]]] = items[i]
        for i in range(start[low], start[high]):
            if shown[track_label[items[i]]] < 0:
                shown[track_label[items[i]]] = items[i]
        best = _likeliest(groups, g, size_weight, widest)
        for i in range(start[best], start[best + 1]):
            chosen[n] = items[i]
            n += 1
        for size in range(widest + 1):
            size_weight[size] = 0.0
    for i in range(n_labels):
        existence[i] = min(existence[i], 1.0)
    for k in range(n_labels + 1):
        if not least <= k <= most:
            cardinality[k] = 0.0
    return existence, shown, head(chosen, n), cardinality


@kernel
def probabilities(groups: Groups, n_tracks: int) -> Any:
    """Probability of each track: that of the hypotheses that hold it."""
    probability = np.zeros(n_tracks)
    for h in range(groups.logw.size):
        w = math.exp(groups.logw[h])
        for i in range(groups.start[h], groups.start[h + 1]):
            probability[groups.items[i]] += w
    return probability


@kernel
def map_tracks(groups: Groups) -> Any:
    """Tracks of the best hypothesis of each group's most probable number of objects."""
    chosen, n = np.empty(groups.items.size, np.int64), ZERO
    weight = np.zeros(groups.items.size + 1)
    for g in range(groups.first.size - 1):
        widest = _weigh_sizes(groups, g, weight)
        best = _likeliest(groups, g, weight, widest)
        for i in range(groups.start[best], groups.start[best + 1]):
            chosen[n] = groups.items[i]
            n += 1
        for size in range(widest + 1):
            weight[size] = 0.0
    return head(chosen, n)
