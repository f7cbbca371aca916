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

NO_NODE: Final = -1


class HistoryTree(NamedTuple):
    """Nodes, in use or free."""

    references: Any
    parent: Any
    scan: Any
    birth: Any
    """Which birth of its scan, in a node without parent."""
    meas: Any
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
    def allocate(cls, n: int) -> HistoryTree:
        """Return a forest of n free nodes."""
        references, parent, scan, birth, meas = np.zeros((5, n), np.int64)
        z_m, logw, free = np.zeros((n, 2)), np.zeros(n), np.arange(n)
        return cls(references, parent, scan, birth, meas, z_m, logw, free, np.full(1, n))

    def larger(self, n: int) -> HistoryTree:
        """Return the same with n more free nodes, and twice as many nodes at least."""
        size = self.parent.size
        more = HistoryTree.allocate(max(size, n))
        columns = (np.concatenate(pair) for pair in zip(self, more, strict=True))
        free = np.concatenate([more.free + size, self.free])
        return HistoryTree(*columns)._replace(free=free, n_free=self.n_free + more.n_free)


@inlined
def _release_chain(tree: HistoryTree, node: int) -> None:
    """Drop a reference to a node, and free what nobody refers to any more."""
    while node != NO_NODE:
        tree.references[node] -= 1
        if tree.references[node] > 0:
            break
        tree.free[tree.n_free[0]] = node
        tree.n_free[0] += 1
        node = tree.parent[node]


@leaf
def _release_nodes(tree: HistoryTree, nodes: Any) -> None:
    for i in range(nodes.size):
        _release_chain(tree, nodes[i])


@leaf
def _fill_nodes(
    tree: HistoryTree,
    nodes_before: Any,
    scan: int,
    parent: Any,
    meas: Any,
    logw: FloatArray,
    position_m: FloatArray,
    to: Any,
) -> None:
    """Fill `to` with the nodes of new tracks."""
    tree.n_free[0] -= to.size
    for i in range(to.size):
        node = tree.free[tree.n_free[0] + i]
        to[i], born = node, parent[i] - nodes_before.size
        tree.references[node], tree.scan[node], tree.birth[node] = 1, scan, born
        tree.parent[node], tree.meas[node], tree.logw[node] = NO_NODE, meas[i], logw[i]
        if born < 0:
            tree.parent[node] = nodes_before[parent[i]]
            tree.references[nodes_before[parent[i]]] += 1
        if meas[i] >= 0:
            tree.z_m[node, 0], tree.z_m[node, 1] = position_m[meas[i], 0], position_m[meas[i], 1]


@leaf
def _record_estimated(
    tree: HistoryTree, nodes_before: Any, tracks: Any, posterior: Posterior, labels: Any, nodes: Any
) -> None:
    """Fill in label and node of each track that is in the estimate; the node is referred to once more."""
    for i in range(tracks.size):
        label, nodes[i] = posterior.track_label[tracks[i]], nodes_before[tracks[i]]
        labels[i, 0], labels[i, 1] = posterior.labels[label, 0], posterior.labels[label, 1]
        tree.references[nodes[i]] += 1


@kernel
def extend_tree(
    tree: HistoryTree,
    nodes_before: Any,
    scan: int,
    posterior: Posterior,
    parent: Any,
    meas: Any,
    logw: FloatArray,
    position_m: FloatArray,
) -> Any:
    """Replace the tracks' nodes `live` by those after a scan; there must be room.

    Each track (n,) comes from the track `parent`, or from a birth behind them, with what it `made` in the
    scan: a row of `place_m`, or negative. Returns the new nodes, and labels and nodes of those estimated.
    """
    new = np.empty(parent.size, np.int64)
    _fill_nodes(tree, nodes_before, scan, parent, meas, logw, position_m, new)
    _release_nodes(tree, nodes_before)
    tracks = map_tracks(posterior.clusters)
    labels, nodes = np.empty((tracks.size, 2), np.int64), np.empty(tracks.size, np.int64)
    _record_estimated(tree, new, tracks, posterior, labels, nodes)
    return new, labels, nodes


@kernel
def release_nodes(tree: HistoryTree, nodes: Any) -> None:
    """Refer to nodes no more."""
    _release_nodes(tree, nodes)
