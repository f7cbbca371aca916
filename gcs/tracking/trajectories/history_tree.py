"""Compiled: association histories as a forest of nodes that are reused.

A node is one track after one scan, and points at the track that it came from. Nodes are counted by who refers
to them (tracks that live on, children, labels that were estimated), and free when nobody does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from gcs.jit import inlined, kernel, leaf
from gcs.tracking.glmb.marginals import map_tracks

if TYPE_CHECKING:
    from gcs.model import FloatArray
    from gcs.tracking.glmb.recursion import Posterior

NONE: Final = -1


class HistoryTree(NamedTuple):
    """Nodes, in use or free."""

    references: Any
    parent: Any
    scan: Any
    birth: Any
    """Which birth of its scan, in a node without parent."""
    made: Any
    """Which detection of its scan, negative for none."""
    z_m: Any
    """(nodes, 2) that detection."""
    logw: Any
    """Of what the track did, relative to its detection being clutter."""
    free: Any
    """The first `n_free` of these nodes are not in use."""
    n_free: Any
    """(1,)."""

    @classmethod
    def of(cls, n: int) -> HistoryTree:
        """Return a forest of n free nodes."""
        references, parent, scan, birth, made = np.zeros((5, n), np.int64)
        z_m, logw, free = np.zeros((n, 2)), np.zeros(n), np.arange(n)
        return cls(references, parent, scan, birth, made, z_m, logw, free, np.full(1, n))

    def larger(self, n: int) -> HistoryTree:
        """Return the same with n more free nodes, and twice as many nodes at least."""
        size = self.parent.size
        more = HistoryTree.of(max(size, n))
        columns = (np.concatenate(pair) for pair in zip(self, more, strict=True))
        free = np.concatenate([more.free + size, self.free])
        return HistoryTree(*columns)._replace(free=free, n_free=self.n_free + more.n_free)


@inlined
def _let_go(of: HistoryTree, node: int) -> None:
    """Drop a reference to a node, and free what nobody refers to any more."""
    while node != NONE:
        of.references[node] -= 1
        if of.references[node] > 0:
            break
        of.free[of.n_free[0]] = node
        of.n_free[0] += 1
        node = of.parent[node]


@leaf
def _release(of: HistoryTree, nodes: Any) -> None:
    for i in range(nodes.size):
        _let_go(of, nodes[i])


@leaf
def _grow(
    of: HistoryTree,
    live: Any,
    scan: int,
    parent: Any,
    made: Any,
    logw: FloatArray,
    place_m: FloatArray,
    to: Any,
) -> None:
    """Fill `to` with the nodes of new tracks."""
    of.n_free[0] -= to.size
    for i in range(to.size):
        node = of.free[of.n_free[0] + i]
        to[i], born = node, parent[i] - live.size
        of.references[node], of.scan[node], of.birth[node] = 1, scan, born
        of.parent[node], of.made[node], of.logw[node] = NONE, made[i], logw[i]
        if born < 0:
            of.parent[node] = live[parent[i]]
            of.references[live[parent[i]]] += 1
        if made[i] >= 0:
            of.z_m[node, 0], of.z_m[node, 1] = place_m[made[i], 0], place_m[made[i], 1]


@leaf
def _note(of: HistoryTree, live: Any, tracks: Any, believed: Posterior, labels: Any, nodes: Any) -> None:
    """Fill in label and node of each track that is in the estimate; the node is referred to once more."""
    for i in range(tracks.size):
        label, nodes[i] = believed.track_label[tracks[i]], live[tracks[i]]
        labels[i, 0], labels[i, 1] = believed.labels[label, 0], believed.labels[label, 1]
        of.references[nodes[i]] += 1


@kernel
def grow(
    of: HistoryTree,
    live: Any,
    scan: int,
    believed: Posterior,
    parent: Any,
    made: Any,
    logw: FloatArray,
    place_m: FloatArray,
) -> Any:
    """Replace the tracks' nodes `live` by those after a scan; there must be room.

    Each track (n,) comes from the track `parent`, or from a birth behind them, with what it `made` in the
    scan: a row of `place_m`, or negative. Returns the new nodes, and labels and nodes of those estimated.
    """
    new = np.empty(parent.size, np.int64)
    _grow(of, live, scan, parent, made, logw, place_m, new)
    _release(of, live)
    tracks = map_tracks(believed.groups)
    labels, nodes = np.empty((tracks.size, 2), np.int64), np.empty(tracks.size, np.int64)
    _note(of, new, tracks, believed, labels, nodes)
    return new, labels, nodes


@kernel
def release(of: HistoryTree, nodes: Any) -> None:
    """Refer to nodes no more."""
    _release(of, nodes)
