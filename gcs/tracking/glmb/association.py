"""Compiled: a scan's association from beginning to end, and what goes on to the next scan.

Labels that compete with nobody go first (`alone`), the groups of the others behind them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, leaf
from gcs.tracking.clusters.factorisation import part, renumber
from gcs.tracking.clusters.merging import meet
from gcs.tracking.clusters.singleton import SingletonUpdate, Tracks, alone
from gcs.tracking.glmb.hypotheses import Clusters, Limits, Options, room_for_groups
from gcs.tracking.glmb.kalman import update
from gcs.tracking.glmb.marginals import probabilities
from gcs.tracking.glmb.merging import merge_alike
from gcs.tracking.glmb.ranked_assignment import children

if TYPE_CHECKING:
    from gcs.model import FloatArray
    from gcs.tracking.models.measurement import LinearisedMeasurement


class Joint(NamedTuple):
    """Tracks of groups of several labels after a scan: their items are rows of `used`."""

    groups: Clusters
    parent: Any
    option: Any
    mean: Any
    cov: Any
    used: Any
    """Which rows of the four before go on."""


class Carried(NamedTuple):
    """All tracks after a scan."""

    groups: Clusters
    parent: Any
    """(n,) which track each was before the scan."""
    option: Any
    """(n,) which option of that it took."""
    label: Any
    """(n,) which of `kept` it is of."""
    kept: Any
    """(labels,) which labels go on, by their numbers before the scan."""
    mean: Any
    """(n or more, 4): behind the tracks there may be room."""
    cov: Any
    """(n or more, 4, 4)."""


@leaf
def _append_groups(groups: Clusters, g: int, h: int, size: int, first_item: int, out: Clusters) -> Any:
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


@inlined
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
    count = _carry(
        lone, joint, track_label, Carried(groups, parent, option, label, kept, lone.mean, lone.cov)
    )
    return Carried(groups, parent, option, label, kept[:count], lone.mean, lone.cov)


@leaf
def _look_up(options: Options, track_label: Any, option: Any, parent: Any, meas: Any, label: Any) -> None:
    """Fill in which track each of some options, in their order, is of, which detection, and whose label."""
    t = 0
    for i in range(option.size):
        while options.start[t + 1] <= option[i]:
            t += 1
        parent[i], meas[i], label[i] = t, options.meas[option[i]], track_label[t]


@leaf
def _account(probability: FloatArray, meas: Any, label: Any, made: SingletonUpdate) -> None:
    """Add to `made` what tracks of such a probability tell."""
    for i in range(meas.size):
        made.there[label[i]] += probability[i]
        if meas[i] >= 0:
            made.explained[meas[i]] += probability[i]
            made.detected[label[i]] += probability[i]


@inlined
def associate(
    groups: Clusters,
    options: Options,
    track_label: Any,
    n_labels: int,
    mean: FloatArray,
    cov: FloatArray,
    z: FloatArray,
    view: LinearisedMeasurement,
    limits: Limits,
    rng: Any,
    made: SingletonUpdate,
) -> Any:
    """Update predicted tracks by a scan's detections; return (`Carried`) those that some hypothesis holds.

    `rng` (1,) uint64 advances; `made` is added to, where it has room.
    """
    lone, several = meet(groups, options, track_label, z.shape[0], limits)
    several, option = renumber(children(several, options, z.shape[0], limits, rng), options.meas.size)
    tracks = alone(
        groups, lone, options, mean, cov, track_label, z, view, limits, limits.merge_chi2, option.size, made
    )
    parent, meas, label = np.empty_like(option), np.empty_like(option), np.empty_like(option)
    _look_up(options, track_label, option, parent, meas, label)
    joint_mean, joint_cov = update(mean, cov, parent, meas, z, view)
    if made.there.size > 0:
        _account(probabilities(several, meas.size), meas, label, made)
    several = merge_alike(several, joint_mean, joint_cov, label, limits.merge_chi2)
    several, used = renumber(part(several, label, n_labels, limits), option.size)
    joint = Joint(several, parent, option, joint_mean, joint_cov, used)
    return carry(tracks, joint, track_label)
