"""Flat arrays of clusters, hypotheses and association options.

A delta-GLMB density is a list of weighted hypotheses; each is a set of tracks (Vo, Vo & Phung 2014). Weights
are logarithms. Hypotheses of a cluster are sorted, the best first, and their weights sum to 1. List i of a
list of lists is ``items[start[i]:start[i + 1]]``.

The items of a hypothesis are tracks before a scan's update. After it they are option indices: each option
names a (track, detection) pair, which is a track of the next scan. How kernels are compiled: `gcs.jit`.

======================  ============  =======  ========================================================
array                   shape         dtype    meaning (C clusters, H hypotheses, T tracks, O options)
======================  ============  =======  ========================================================
Clusters.first          (C + 1,)      int64    hypotheses of cluster g: ``first[g]`` to ``first[g + 1]``
Clusters.start          (H + 1,)      int64    items of hypothesis h: ``start[h]`` to ``start[h + 1]``
Clusters.items          (start[H],)   int64    tracks, or options
Clusters.logw           (H,)          float64  log-weight of each hypothesis
AssociationOptions      .start        int64    (T + 1,) options of track t: ``start[t]`` to ``start[t + 1]``
AssociationOptions      .meas         int64    (O,) row of the ordered detections, or MISSED or ABSENT
AssociationOptions      .logw         float64  (O,) log eta, the best option of a track first
======================  ============  =======  ========================================================
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gcs.jit import inlined, leaf
from gcs.model import FloatArray, IntArray
from gcs.tracking.numerics.sorting import head

# Values of `AssociationOptions.meas` that are no detection: missed; dead or not born.
MISSED = -1
ABSENT = -2


class Clusters(NamedTuple):
    """Independent clusters of hypotheses (see the table above)."""

    first: IntArray
    start: IntArray
    items: IntArray
    logw: FloatArray

    @classmethod
    def example(cls) -> Clusters:
        """Return the smallest value that kernels can be called with."""
        return cls(np.arange(2), np.arange(2), np.zeros(1, np.int64), np.zeros(1))


class AssociationOptions(NamedTuple):
    """Association options of each track (see `gating.association_options`)."""

    start: IntArray
    meas: IntArray
    logw: FloatArray


@inlined
def mix64(x: np.uint64) -> np.uint64:
    """Scramble 64 bits, one to one (finaliser of SplitMix64, Steele et al. 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@inlined
def item_key(item: int) -> np.uint64:
    """Return a pseudo-random 64-bit key of an item; the key of a set is the sum of these.

    It is computed at every use: a table of keys costs more in cache misses.
    """
    return mix64(np.uint64(item + 1) * np.uint64(0x9E3779B97F4A7C15))


@inlined
def allocate_clusters(n_clusters: int, n_hyps: int, n_items: int) -> Clusters:
    """Allocate arrays for so many clusters, hypotheses and items."""
    return Clusters(
        np.empty(n_clusters + 1, np.int64),
        np.empty(n_hyps + 1, np.int64),
        np.empty(n_items, np.int64),
        np.empty(n_hyps),
    )


@leaf
def append_clusters(
    clusters: Clusters, g: int, h: int, size: int, first_item: int, out: Clusters
) -> tuple[int, int, int]:
    """Append clusters behind g clusters, h hypotheses and `size` items of `out`; return the new numbers."""
    for i in range(clusters.items.size):
        out.items[size + i] = first_item + clusters.items[i]
    for i in range(clusters.logw.size):
        out.logw[h + i] = clusters.logw[i]
        out.start[h + i + 1] = size + clusters.start[i + 1]
    for i in range(clusters.first.size - 1):
        out.first[g + i + 1] = h + clusters.first[i + 1]
    return g + clusters.first.size - 1, h + clusters.logw.size, size + clusters.items.size


@inlined
def trim_clusters(clusters: Clusters, count: int, n: int) -> Clusters:
    """Return the filled part: `count` clusters with n hypotheses."""
    return Clusters(
        head(clusters.first, count + 1),
        head(clusters.start, n + 1),
        head(clusters.items, clusters.start[n]),
        head(clusters.logw, n),
    )
