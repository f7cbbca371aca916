"""Compiled: what goes on to the next scan, those who went alone and, behind them, those of larger groups."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gcs.compiling import ZERO, kernel, leaf
from gcs.tracking.alone import Tracks
from gcs.tracking.hypotheses import Groups, room_for_groups


class Joint(NamedTuple):
    """Tracks of groups of several labels after a scan: their items are rows of `used`."""

    groups: Groups
    parent: Any
    option: Any
    mean: Any
    cov: Any
    used: Any
    """Which rows of the four before go on."""


class Carried(NamedTuple):
    """All tracks after a scan."""

    groups: Groups
    parent: Any
    """(n,) which track each was before the scan."""
    option: Any
    """(n,) which option of that it took."""
    label: Any
    """(n,) which of `kept` it is of."""
    kept: Any
    """(labels,) which labels go on, by their numbers before the scan."""


@leaf
def _append_groups(groups: Groups, g: int, h: int, size: int, first_item: int, out: Groups) -> Any:
    """Put groups behind the g groups, h hypotheses and so many items of `out`; return what it has then."""
    for i in range(groups.items.size):
        out.items[size + i] = first_item + groups.items[i]
    for i in range(groups.logw.size):
        out.logw[h + i], out.start[h + i + 1] = groups.logw[i], size + groups.start[i + 1]
    for i in range(groups.first.size - 1):
        out.first[g + i + 1] = h + groups.first[i + 1]
    return g + groups.first.size - 1, h + groups.logw.size, size + groups.items.size


@leaf
def _carry(lone: Tracks, joint: Joint, track_label: Any, out: Carried) -> int:
    """Fill `out`, and the rows of `lone` behind its tracks; return how many labels go on."""
    out.groups.first[0] = out.groups.start[0] = n_labels = ZERO
    g, h, size = _append_groups(lone.groups, ZERO, ZERO, ZERO, ZERO, out.groups)
    n = lone.parent.size
    _append_groups(joint.groups, g, h, size, n, out.groups)
    for t in range(n + joint.used.size):
        if t < n:
            parent, out.option[t] = lone.parent[t], lone.option[t]
        else:
            u = joint.used[t - n]
            parent, out.option[t] = joint.parent[u], joint.option[u]
            for i in range(4):
                lone.mean[t, i] = joint.mean[u, i]
                for j in range(4):
                    lone.cov[t, i, j] = joint.cov[u, i, j]
        label = track_label[parent]
        if n_labels == 0 or out.kept[n_labels - 1] != label:
            out.kept[n_labels] = label
            n_labels += 1
        out.parent[t], out.label[t] = parent, n_labels - 1
    return n_labels


@kernel
def carry(lone: Tracks, joint: Joint, track_label: Any) -> Carried:
    """Gather all tracks; their Gaussians are the first rows of those of `lone`, which has room for them.

    Tracks of a label stand together, in both.
    """
    both, n = lone.groups, lone.parent.size + joint.used.size
    groups = room_for_groups(
        both.first.size + joint.groups.first.size - 2,
        both.logw.size + joint.groups.logw.size,
        both.items.size + joint.groups.items.size,
    )
    parent, option = np.empty(n, np.int64), np.empty(n, np.int64)
    label, kept = np.empty(n, np.int64), np.empty(n, np.int64)
    count = _carry(lone, joint, track_label, Carried(groups, parent, option, label, kept))
    return Carried(groups, parent, option, label, kept[:count])
