"""Association histories as a tree of reference-counted nodes.

A node is one track after one scan and refers to the track before it. Current tracks, later nodes and
estimated labels hold references. A node without references is free and is used again.

============  ===========  =======  ==================================================
HistoryTree   shape        dtype    meaning (N nodes)
============  ===========  =======  ==================================================
references    (N,)         int64    number of references
parent        (N,)         int64    node of the track before, or NO_NODE
scan          (N,)         int64    scan number
birth         (N,)         int64    birth index in its scan, for nodes without parent
meas          (N,)         int64    detection of its scan, negative for none
z_m           (N, 2)       float64  that detection, east and north
logw          (N,)         float64  log eta of the option
free          (N,)         int64    the first `n_free` entries are the free nodes
n_free        (1,)         int64
============  ===========  =======  ==================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from gcs.jit import inlined, kernel, leaf
from gcs.tracking.glmb.marginals import map_tracks

if TYPE_CHECKING:
    from gcs.model import FloatArray, IntArray
    from gcs.tracking.glmb.recursion import Posterior

NO_NODE: Final = -1


class HistoryTree(NamedTuple):
    """Nodes, used and free (see the table above)."""

    references: IntArray
    parent: IntArray
    scan: IntArray
    birth: IntArray
    meas: IntArray
    z_m: FloatArray
    logw: FloatArray
    free: IntArray
    n_free: IntArray

    @classmethod
    def allocate(cls, n: int) -> HistoryTree:
        """Return a tree of n free nodes."""
        references, parent, scan, birth, meas = np.zeros((5, n), np.int64)
        z_m = np.zeros((n, 2))
        logw = np.zeros(n)
        free = np.arange(n)
        return cls(references, parent, scan, birth, meas, z_m, logw, free, np.full(1, n))

    def larger(self, n: int) -> HistoryTree:
        """Return a copy with at least n more free nodes and at least twice as many nodes."""
        size = self.parent.size
        more = HistoryTree.allocate(max(size, n))
        columns = (np.concatenate(pair) for pair in zip(self, more, strict=True))
        free = np.concatenate([more.free + size, self.free])
        return HistoryTree(*columns)._replace(free=free, n_free=self.n_free + more.n_free)


@inlined
def _release_chain(tree: HistoryTree, node: int) -> None:
    """Drop a reference to a node, and free all nodes without references."""
    while node != NO_NODE:
        tree.references[node] -= 1
        if tree.references[node] > 0:
            break
        tree.free[tree.n_free[0]] = node
        tree.n_free[0] += 1
        node = tree.parent[node]


@leaf
def _release_nodes(tree: HistoryTree, nodes: IntArray) -> None:
    for i in range(nodes.size):
        _release_chain(tree, nodes[i])


@leaf
def _fill_nodes(
    tree: HistoryTree,
    nodes_before: IntArray,
    scan: int,
    parent: IntArray,
    meas: IntArray,
    logw: FloatArray,
    position_m: FloatArray,
    to: IntArray,
) -> None:
    """Fill `to` with the nodes of new tracks."""
    tree.n_free[0] -= to.size
    for i in range(to.size):
        node = tree.free[tree.n_free[0] + i]
        to[i] = node
        born = parent[i] - nodes_before.size
        tree.references[node] = 1
        tree.scan[node] = scan
        tree.birth[node] = born
        tree.parent[node] = NO_NODE
        tree.meas[node] = meas[i]
        tree.logw[node] = logw[i]
        if born < 0:
            tree.parent[node] = nodes_before[parent[i]]
            tree.references[nodes_before[parent[i]]] += 1
        if meas[i] >= 0:
            tree.z_m[node, 0] = position_m[meas[i], 0]
            tree.z_m[node, 1] = position_m[meas[i], 1]


@leaf
def _record_estimated(
    tree: HistoryTree,
    nodes_before: IntArray,
    tracks: IntArray,
    posterior: Posterior,
    labels: IntArray,
    nodes: IntArray,
) -> None:
    """Fill label and node of each estimated track, and add a reference to the node."""
    for i in range(tracks.size):
        label = posterior.track_label[tracks[i]]
        nodes[i] = nodes_before[tracks[i]]
        labels[i, 0] = posterior.labels[label, 0]
        labels[i, 1] = posterior.labels[label, 1]
        tree.references[nodes[i]] += 1


@kernel
def extend_tree(
    tree: HistoryTree,
    nodes_before: IntArray,
    scan: int,
    posterior: Posterior,
    parent: IntArray,
    meas: IntArray,
    logw: FloatArray,
    position_m: FloatArray,
) -> tuple[IntArray, IntArray, IntArray]:
    """Replace the nodes `nodes_before` of the tracks by those after a scan; enough nodes must be free.

    Each track (n,) comes from the track `parent`, or from a birth numbered behind these, with the detection
    `meas` (row of `position_m`, or negative). Returns the new nodes, and labels and nodes of the estimated
    tracks.
    """
    new = np.empty(parent.size, np.int64)
    _fill_nodes(tree, nodes_before, scan, parent, meas, logw, position_m, new)
    _release_nodes(tree, nodes_before)
    tracks = map_tracks(posterior.clusters)
    labels = np.empty((tracks.size, 2), np.int64)
    nodes = np.empty(tracks.size, np.int64)
    _record_estimated(tree, new, tracks, posterior, labels, nodes)
    return new, labels, nodes


@kernel
def release_nodes(tree: HistoryTree, nodes: IntArray) -> None:
    """Drop a reference to each of the nodes."""
    _release_nodes(tree, nodes)
