"""Product of clusters whose labels compete for the same detections: merged before a scan's update.

Labels whose gates share no detection are associated independently, so the density is a product of delta-GLMBs
over clusters of labels (Reuter et al. 2014; Beard, Vo & Vo 2020). The cost grows with the number of objects,
and the limit on hypotheses cuts only where objects interact.

Clusters that compete (`contention`) become the product of their hypotheses. That is exact but for the limit
on hypotheses. They are split again after the update (`factorisation`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.jit import ZERO, inlined, kernel, leaf, spliced
from gcs.model import FloatArray, IntArray
from gcs.tracking.clusters.contention import allocate_contention, find_contending_clusters, find_root
from gcs.tracking.glmb.hypotheses import AssociationOptions, Clusters, allocate_clusters, trim_clusters
from gcs.tracking.glmb.params import Limits
from gcs.tracking.numerics.sorting import SortBuffers, allocate_sort, argsort_descending, head


@inlined
def _max_size(start: IntArray, low: int, high: int) -> int:
    """Return the most items of a hypothesis from `low` to `high` - 1."""
    max_size = 0
    for h in range(low, high):
        max_size = max(max_size, start[h + 1] - start[h])
    return max_size


class _ProductBuffers(NamedTuple):
    """Buffers for pairs of hypotheses, and for two products of clusters."""

    logw: FloatArray
    left: IntArray
    right: IntArray
    order: SortBuffers
    first_buffer: Clusters
    second_buffer: Clusters


@spliced
def _cluster_product(
    left: Clusters,
    low: int,
    high: int,
    clusters: Clusters,
    g: int,
    limits: Limits,
    buffers: _ProductBuffers,
    out: Clusters,
) -> int:
    """Write the best products of hypotheses `low` to `high` - 1 of `left` and of another cluster g.

    Both lists are sorted, so at least (i + 1)(j + 1) - 1 pairs are no worse than the pair (i, j), and the
    best `limits.max_hypotheses` pairs lie under that hyperbola. Returns the number of hypotheses.
    """
    max_pairs = limits.max_hypotheses
    rows = min(high - low, limits.max_hypotheses)
    g_low = clusters.first[g]
    columns = clusters.first[g + 1] - clusters.first[g]
    count = ZERO
    floor = left.logw[low] + clusters.logw[g_low] + limits.log_prune
    for i in range(rows):
        for j in range(min(columns, max_pairs // (i + 1))):
            w = left.logw[low + i] + clusters.logw[g_low + j]
            if w < floor:
                break
            buffers.logw[count] = w
            buffers.left[count] = low + i
            buffers.right[count] = g_low + j
            count += 1
    argsort_descending(buffers.logw, ZERO, count, buffers.order)
    n = min(count, max_pairs)
    total = 0.0
    size = 0
    out.start[0] = 0
    for h in range(n):
        pair = buffers.order.index[h]
        a = buffers.left[pair]
        b = buffers.right[pair]
        for i in range(left.start[a], left.start[a + 1]):
            out.items[size] = left.items[i]
            size += 1
        for i in range(clusters.start[b], clusters.start[b + 1]):
            out.items[size] = clusters.items[i]
            size += 1
        out.start[h + 1] = size
        out.logw[h] = buffers.logw[pair]
        total += math.exp(out.logw[h])
    log_total = math.log(total)
    for h in range(n):
        out.logw[h] -= log_total
    return n


@inlined
def _max_pairs(rows: int, columns: int, max_pairs: int) -> int:
    """Bound the number of pairs that `_cluster_product` forms."""
    bound = 0
    for i in range(min(rows, max_pairs)):
        bound += min(columns, max_pairs // (i + 1))
    return bound


@inlined
def _is_single_label(clusters: Clusters, g: int, track_label: IntArray) -> bool:
    """Return True if all tracks of cluster g have one label."""
    begin = clusters.start[clusters.first[g]]
    for i in range(begin, clusters.start[clusters.first[g + 1]]):
        if track_label[clusters.items[i]] != track_label[clusters.items[begin]]:
            return False
    return True


class _Unions(NamedTuple):
    """Unions of C clusters, all arrays (C,) int64.

    ============  ==================================================================
    parent        first cluster of the union; -1 for a singleton without competitors
    next_cluster  next cluster in the union, or -1
    last          scratch
    max_hyps      bound on the hypotheses of the union, at its first cluster
    max_size      bound on the items of such a hypothesis
    ============  ==================================================================
    """

    parent: IntArray
    next_cluster: IntArray
    last: IntArray
    max_hyps: IntArray
    max_size: IntArray


@leaf
def _link_unions(
    clusters: Clusters, track_label: IntArray, limits: Limits, out: _Unions, singletons: IntArray
) -> tuple[int, int, int, int, int, int]:
    """Turn the trees in `out.parent` into chains, and list the singleton clusters.

    Returns the number of singletons, the hypotheses and items of all unions and of the largest one, and the
    pairs of a product.
    """
    first = clusters.first
    n_clusters = clusters.first.size - 1
    pairs = 1
    for g in range(n_clusters):
        root = find_root(out.parent, g)
        count = first[g + 1] - first[g]
        out.parent[g] = root
        out.next_cluster[g] = -1
        out.last[g] = g
        out.max_hyps[g] = count
        out.max_size[g] = _max_size(clusters.start, first[g], first[g + 1])
        if root != g:
            out.next_cluster[out.last[root]] = g
            out.last[root] = g
            pairs = max(pairs, _max_pairs(out.max_hyps[root], count, limits.max_hypotheses))
            out.max_hyps[root] = min(out.max_hyps[root] * count, limits.max_hypotheses)
            out.max_size[root] += out.max_size[g]
    n_singletons = 0
    n_hyps = 0
    n_items = 0
    hyps = 0
    items = 0
    for g in range(n_clusters):
        if out.parent[g] != g:
            continue
        if out.next_cluster[g] < 0 and _is_single_label(clusters, g, track_label):
            singletons[n_singletons] = g
            out.parent[g] = -1
            n_singletons += 1
            continue
        n_hyps += out.max_hyps[g]
        n_items += out.max_hyps[g] * out.max_size[g]
        if out.next_cluster[g] >= 0:
            hyps = max(hyps, out.max_hyps[g])
            items = max(items, out.max_hyps[g] * out.max_size[g])
    return n_singletons, n_hyps, n_items, hyps, items, pairs


@leaf
def _multiply_unions(
    clusters: Clusters, unions: _Unions, limits: Limits, buffers: _ProductBuffers, out: Clusters
) -> tuple[int, int]:
    """Fill `out` with the product of each union; return the number of clusters and hypotheses."""
    first = clusters.first
    count = 0
    n = 0
    out.first[0] = out.start[0] = 0
    for g in range(first.size - 1):
        if unions.parent[g] != g:
            continue
        low = first[g]
        high = first[g + 1]
        second = unions.next_cluster[g]
        left = clusters
        use_first = True
        while second >= 0:
            product = buffers.first_buffer if use_first else buffers.second_buffer
            high = _cluster_product(left, low, high, clusters, second, limits, buffers, product)
            left = product
            low = 0
            use_first = not use_first
            second = unions.next_cluster[second]
        for h in range(low, high):
            out.logw[n] = left.logw[h]
            size = out.start[n]
            for i in range(left.start[h], left.start[h + 1]):
                out.items[size] = left.items[i]
                size += 1
            n += 1
            out.start[n] = size
        count += 1
        out.first[count] = n
    return count, n


@kernel
def merge_clusters(
    clusters: Clusters, options: AssociationOptions, track_label: IntArray, n_detections: int, limits: Limits
) -> tuple[IntArray, Clusters]:
    """Merge the clusters whose labels compete for the same detections (`contention`).

    Returns the indices of the singleton clusters, and all other clusters, merged.
    """
    n_clusters = clusters.first.size - 1
    unions = _Unions(
        np.empty(n_clusters, np.int64),
        np.empty(n_clusters, np.int64),
        np.empty(n_clusters, np.int64),
        np.empty(n_clusters, np.int64),
        np.empty(n_clusters, np.int64),
    )
    contention = allocate_contention(clusters.logw.size, track_label.size, options.meas.size, n_detections)
    find_contending_clusters(clusters, options, track_label, limits.max_conflict, contention, unions.parent)
    singletons = np.empty(n_clusters, np.int64)
    n_singletons, n_hyps, n_items, hyps, items, pairs = _link_unions(
        clusters, track_label, limits, unions, singletons
    )
    buffers = _ProductBuffers(
        np.empty(pairs),
        np.empty(pairs, np.int64),
        np.empty(pairs, np.int64),
        allocate_sort(pairs),
        allocate_clusters(0, hyps, items),
        allocate_clusters(0, hyps, items),
    )
    out = allocate_clusters(n_clusters, n_hyps, n_items)
    count, n = _multiply_unions(clusters, unions, limits, buffers, out)
    return head(singletons, n_singletons), trim_clusters(out, count, n)
